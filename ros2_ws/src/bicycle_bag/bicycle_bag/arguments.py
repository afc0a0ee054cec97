"""Command lines whose mistakes are one line."""

from __future__ import annotations

import argparse
import sys
from typing import Any, NoReturn

from bicycle_sim.config import empty_word


class OneLineParser(argparse.ArgumentParser):
    """A parser for a script that has its own `--help`."""

    def error(self, message: str) -> NoReturn:
        """End the program with status 2 and one line, without the usage."""
        print(f"{self.prog}: {message}; see {self.prog.split()[0]} --help", file=sys.stderr)
        raise SystemExit(2)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As always, but a word that is empty is a mistake."""
        words = list(sys.argv[1:] if args is None else args)
        if mistake := empty_word(words):
            self.error(mistake)
        return super().parse_known_args(words, namespace)
