"""Processor time of a browser that this process has started, as the kernel counts it."""

from __future__ import annotations

import os
from pathlib import Path


def processor_times() -> dict[str, float]:
    """Return the processor time so far, ms: of the pages' main threads, and of all that draws."""
    parents = {int(path.name): _status(path) for path in Path("/proc").glob("[0-9]*")}
    ours = {os.getpid()}
    while more := {pid for pid, (parent, _) in parents.items() if parent in ours} - ours:
        ours |= more
    words = {pid: parents[pid][1] for pid in ours if pid in parents}
    pages = [_thread_ms(f"/proc/{pid}") for pid, text in words.items() if "type=renderer" in text]
    drawing = [pid for pid, text in words.items() if "type=gpu-process" in text]
    threads = [path for pid in drawing for path in Path(f"/proc/{pid}/task").iterdir()]
    return {"page": sum(pages), "drawing": sum(_thread_ms(str(path)) for path in threads)}


def _status(process: Path) -> tuple[int, str]:
    """Return parent and command line of a process; 0 and nothing for one that is gone."""
    try:
        parent = int((process / "stat").read_text().rpartition(") ")[2].split()[1])
        return parent, (process / "cmdline").read_text()
    except OSError:
        return 0, ""


def _thread_ms(folder: str) -> float:
    try:
        return int(Path(folder, "schedstat").read_text().split()[0]) / 1e6
    except OSError:
        return 0.0
