"""Output of a run: JSON lines, TensorBoard if it is installed, and its progress."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from tqdm import tqdm

BETWEEN_LINES = 10.0
"""s between two lines of progress where there is no terminal."""
Shown = bool | Literal["lines"]
"""A bar, or nothing, or lines."""


class Logger:
    """Writes `log.jsonl` of a run folder and, if TensorBoard is installed, its event files."""

    def __init__(self, folder: Path, keep: int, first_step: int, tensorboard: bool) -> None:
        """Open it.

        Args:
            folder: the run folder.
            keep: bytes of the log that the checkpoint knows; the rest is cut off.
            first_step: environment steps made so far; later events are hidden.
            tensorboard: True to write event files too.
        """
        self._file = (folder / "log.jsonl").open("ab")
        self._file.truncate(keep)
        self._writer = _event_writer(folder, first_step) if tensorboard else None

    def __enter__(self) -> Logger:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
        if self._writer is not None:
            self._writer.close()

    def write(self, kind: str, step: int, values: dict[str, Any]) -> None:
        """Add one line; `kind` is `train` or `evaluation`."""
        row = {"kind": kind, "step": step} | {k: _json_number(v) for k, v in values.items()}
        self._file.write(json.dumps(row).encode() + b"\n")
        self._file.flush()
        if self._writer is not None:
            for name, value in values.items():
                if isinstance(value, (int, float)) and math.isfinite(value):
                    self._writer.add_scalar(f"{kind}/{name}", value, step)

    def sync(self) -> int:
        """Flush all lines to the disk; return their total size in bytes."""
        self._file.flush()
        os.fsync(self._file.fileno())
        return self._file.seek(0, os.SEEK_END)


def _event_writer(folder: Path, first_step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder / "tensorboard"), purge_step=first_step)


def _json_number(value: Any) -> Any:
    """Convert infinities and NaN, which JSON lacks."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


class Progress:
    """Progress over environment steps, with both rates and the time left."""

    def __init__(self, total: int, done: int, shown: Shown, unit: str = "step") -> None:
        """Draw a bar on standard error, or print lines; `unit` names what is counted."""
        self._lines = shown == "lines"
        self._total, self._unit, self._done, self._first = total, unit, done, done
        self._begun = time.monotonic()
        self._next = self._begun + BETWEEN_LINES
        self._bar = tqdm(
            total=total,
            initial=done,
            unit=unit,
            unit_scale=True,
            dynamic_ncols=True,
            disable=shown is not True,
            mininterval=0.5,
        )
        self._shown: dict[str, str] = {}
        self._last: tuple[float, float] | None = None

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.close()

    def advance(self, steps: int) -> None:
        """Count steps, or other units as named by `unit`."""
        self._bar.update(steps)
        self._done += steps
        if self._lines and time.monotonic() >= self._next:
            self._print()

    def show(self, updates: int | None = None, **values: float) -> None:
        """Show values behind the bar; from the second count of `updates` on also their rate."""
        if updates is not None:
            now = time.monotonic()
            if self._last is not None:
                rate = (updates - self._last[0]) / max(now - self._last[1], 1e-9)
                self._shown["updates/s"] = f"{rate:.0f}"
            self._last = (updates, now)
        self._shown |= {name: f"{value:.3g}" for name, value in values.items()}
        self._bar.set_postfix(self._shown, refresh=False)

    def _print(self) -> None:
        """Print one line: how far, how fast, how long still, and what the bar would show."""
        now = time.monotonic()
        self._next = now + BETWEEN_LINES
        spent = now - self._begun
        rate = (self._done - self._first) / max(spent, 1e-9)
        left = (self._total - self._done) / max(rate, 1e-9)
        share = f"{self._done / max(self._total, 1):.0%} of {self._total:,} {self._unit}s"
        values = "".join(f", {name} {value}" for name, value in self._shown.items())
        print(f"{share}, {spent:.0f} s, {left:.0f} s left{values}", file=sys.stderr, flush=True)
