"""Origin of a result: the command, the commit, the time and the processor that made it."""

from __future__ import annotations

import platform
import shlex
import subprocess
import sys
from datetime import datetime, timezone
from pathlib import Path


def origin() -> dict[str, str]:
    """Return command, commit, time and processor, to stand beside a result in its file."""
    return {
        "command": shlex.join([_program(), *sys.argv[1:]]),
        "commit": _commit(),
        "started": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "processor": processor(),
    }


def made_by() -> dict[str, str]:
    """Return command, commit and processor alone: the same words for the same run."""
    found = origin()
    return {name: found[name] for name in ("command", "commit", "processor")}


def _program() -> str:
    """Return the words that start this program in a shell; `python -m` names a file instead."""
    name = Path(sys.argv[0]).name
    return "bicycle" if name == "__main__.py" else name


def processor() -> str:
    """Return the processor's name, as the kernel tells it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _commit() -> str:
    """Return this source tree's commit, followed by `+` if files have changed, or `unknown`."""
    here = Path(__file__).parent
    found = []
    for words in (("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no")):
        try:
            done = subprocess.run(
                ["git", "-C", str(here), *words],
                capture_output=True,
                text=True,
                timeout=10,
                check=True,
            )
        except (OSError, subprocess.SubprocessError):
            return "unknown"
        found.append(done.stdout.strip())
    return found[0] + ("+" if found[1] else "")
