"""Progress of long work: a bar in a terminal, elsewhere a line every while."""

from __future__ import annotations

import sys
from typing import Any

from tqdm import tqdm

EVERY = 15.0
"""Time before the first line, and between two (s)."""
_LINE = "{desc}: {n_fmt} of {total_fmt} {unit}s after {elapsed}, {remaining} to go"


class ProgressBar(tqdm):  # type: ignore[misc]  # untyped
    """`tqdm` on standard error that writes whole lines where there is no terminal."""

    def __init__(self, *args: Any, shown: bool = True, **options: Any) -> None:
        """Begin.

        Args:
            args: `tqdm`'s.
            shown: False for no word at all.
            options: `tqdm`'s.
        """
        stream = options.setdefault("file", sys.stderr)
        self._in_lines = stream is None or not stream.isatty()
        if self._in_lines:
            options.setdefault("desc", "done")
            options |= {"mininterval": EVERY, "miniters": 1, "delay": EVERY, "bar_format": _LINE}
        super().__init__(*args, disable=not shown, **options)

    def display(self, msg: str | None = None, pos: int | None = None) -> bool | None:
        """Draw the bar, or write a line."""
        if not self._in_lines:
            shown: bool | None = super().display(msg, pos)
            return shown
        self.fp.write(f"{msg or self}\n".lstrip("\r"))
        self.fp.flush()
        return True

    def set_description(self, desc: str | None = None, refresh: bool | None = True) -> None:
        """Name what is being done; a line waits for its time."""
        if not self._in_lines:
            super().set_description(desc, refresh)
        else:
            self.desc = desc or ""

    def close(self) -> None:
        """End; lines leave nothing to clean up."""
        if self._in_lines and not getattr(self, "disable", True):
            self.disable = True
            self._decr_instances(self)
        super().close()
