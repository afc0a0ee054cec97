"""Command lines whose mistakes are one line."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn


class OneLineParser(argparse.ArgumentParser):
    """A parser for a script that has its own `--help`."""

    def error(self, message: str) -> NoReturn:
        """End the program with status 2 and one line, without the usage."""
        print(f"{self.prog}: {message}; see {self.prog.split()[0]} --help", file=sys.stderr)
        raise SystemExit(2)
