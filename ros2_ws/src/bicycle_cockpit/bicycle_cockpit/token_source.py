"""Source of the cockpit's token: not the command line, which every user can read."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import MutableMapping
from pathlib import Path

VARIABLE = "BICYCLE_COCKPIT_TOKEN"
AUTO = "auto"
LARGEST_FILE = 4096
"""Bytes."""


def find_token(word: str | None, file: Path | None, environment: MutableMapping[str, str]) -> str:
    """Return the token that a page must know; empty for none.

    Args:
        word: of the option `--token`, which accepts AUTO only; None if it is not given.
        file: of the option `--token-file`.
        environment: may hold VARIABLE, with a token or AUTO; it is removed, because child
            processes need not know it.

    Raises:
        ValueError: on another word, on two sources, and on a file that cannot be read or that
            others can read.
    """
    given = environment.pop(VARIABLE, "")
    if word not in (None, AUTO):
        raise ValueError(
            f"--token takes only {AUTO}: every user of this machine can read a command line; "
            f"write the secret into a file for --token-file, or into {VARIABLE}"
        )
    if (word is not None) + (file is not None) + (given != "") > 1:
        raise ValueError(f"--token, --token-file and {VARIABLE}: give one of them")
    if AUTO in (word, given):
        return secrets.token_hex(16)
    return _read(file) if file is not None else given


def _read(file: Path) -> str:
    try:
        with file.open("rb") as opened:
            about = os.fstat(opened.fileno())
            data = opened.read(LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ValueError(f"cannot read --token-file {str(file)[:200]!r}: {why}") from None
    if stat.S_ISREG(about.st_mode) and about.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ValueError(f"others can read {file}: chmod 600 it first")
    text = data[: LARGEST_FILE + 1].decode(errors="replace").strip()
    if len(data) > LARGEST_FILE or not text:
        raise ValueError(f"{file} holds no secret: write one line of letters and digits into it")
    return text
