"""Files of a bag's folder, without those that an operating system leaves beside them."""

from __future__ import annotations

from pathlib import Path


def visible(folder: Path, ending: str) -> list[Path]:
    """Return the folder's files with a name's ending, sorted, except hidden ones.

    macOS lays a `._x.mcap` beside an `x.mcap` on disks that are not its own.

    Raises:
        OSError, ValueError: The folder has no name that a folder can have.
    """
    return sorted(path for path in folder.glob(f"*{ending}") if not path.name.startswith("."))
