"""Running of commands that a page prints, as a person would."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

LONGEST = 600.0
"""Longest run of a command on a busy machine (s)."""


def run_printed(
    command: str, folder: Path, shorter: str = "", statuses: Sequence[int] = (0,)
) -> None:
    """Run a command in a shell of the workspace in `folder`; it must succeed, without a traceback.

    Args:
        command: as it is printed.
        folder: to run in.
        shorter: words that are added, so that it takes less time.
        statuses: exit statuses of a success.
    """
    # A here-document's last line has nothing behind it.
    words = f"{command} {shorter}" if shorter else command
    done = subprocess.run(
        ["bash", "-c", f". ros2_ws/env.sh && {words}"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )
    assert done.returncode in statuses, f"{command}\n{done.stdout}{done.stderr}"
    assert "Traceback" not in done.stdout + done.stderr, command
