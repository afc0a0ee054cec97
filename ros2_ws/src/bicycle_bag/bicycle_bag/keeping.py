"""Second names for files that a repair replaces, so that nothing is lost by it."""

from __future__ import annotations

import contextlib
import itertools
import os
from pathlib import Path


def keep(file: Path, as_what: str = "damaged") -> Path:
    """Give a file a second name, which it has alone once another takes its first; return it.

    Args:
        file: The file.
        as_what: Suffix of the name; a number follows where earlier copies have it.

    Raises:
        OSError: The disk does not take it.
    """
    for number in itertools.count(1):
        kept = file.with_name(f"{file.name}.{as_what}{f'.{number}' if number > 1 else ''}")
        with contextlib.suppress(FileExistsError):
            os.link(file, kept)
            return kept
        if kept.samefile(file):
            return kept
    raise AssertionError
