"""What a run tells: JSON lines always, TensorBoard where it is installed, and a progress bar."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

from tqdm import tqdm


class Log:
    """`log.jsonl` of a run folder and, where TensorBoard is installed, its event files."""

    def __init__(self, folder: Path, keep: int | None, first_step: int, tensorboard: bool) -> None:
        """Open it.

        Args:
            folder: the run folder.
            keep: bytes of an interrupted run's log that its checkpoint knows; None starts anew.
            first_step: environment steps made so far; later events of before are hidden.
            tensorboard: whether to write event files too.
        """
        path = folder / "log.jsonl"
        self._file = path.open("ab" if keep is not None else "wb")
        if keep is not None:
            self._file.truncate(keep)
        self._writer = _event_writer(folder, first_step) if tensorboard else None

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
        """Put all lines on the disk; how many bytes they are."""
        self._file.flush()
        os.fsync(self._file.fileno())
        return self._file.seek(0, os.SEEK_END)

    def close(self) -> None:
        """Finish the files."""
        self._file.close()
        if self._writer is not None:
            self._writer.close()


def _event_writer(folder: Path, first_step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder / "tensorboard"), purge_step=first_step)


def _json_number(value: Any) -> Any:
    """JSON has no infinity and no NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def progress_bar(total: int, done: int, shown: bool) -> tqdm:
    """A bar over environment steps: rate and time left are the bar's own."""
    return tqdm(
        total=total,
        initial=done,
        unit="step",
        unit_scale=True,
        dynamic_ncols=True,
        disable=not shown,
        mininterval=0.5,
    )
