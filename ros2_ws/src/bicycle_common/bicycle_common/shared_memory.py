"""Room in shared memory, without which a library that ROS brings dies of a bus error."""

from __future__ import annotations

import os
from pathlib import Path

FOLDER = Path("/dev/shm")
NEEDED = 64 * 1024
"""Bytes, for the tracing library's pages and the semaphores of a learning process."""
TRACING = "lttng-ust-wait-*"
"""Files, one of the system and one of each user, that the tracing library maps when it loads."""


def refusal(folder: Path = FOLDER) -> str:
    """Return the reason why ROS must not be loaded, with the remedy; empty if it may.

    A page of a mapped file is only given when it is touched: on a full file system the kernel
    ends the process then. Where the files have their pages already, nothing is needed.
    """
    try:
        found = os.statvfs(folder)
        free = found.f_bavail * found.f_frsize
        if free >= NEEDED or not found.f_blocks:
            return ""
        own = f"-{os.getuid()}"
        kept = [file.name for file in folder.glob(TRACING) if file.stat().st_blocks]
    except OSError:
        return ""
    if any(name.endswith(own) for name in kept) and any(name.count("-") == 3 for name in kept):
        return ""
    return (
        f"{folder} is full ({free // 1024} KiB free), and ROS's libraries would die of a bus "
        f"error: remove what fills it (ls -l {folder}; fastdds shm clean), or give it more, as a "
        "container's --shm-size=64m does"
    )
