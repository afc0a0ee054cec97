"""Bags of one folder: their list, and a description of each.

A bag is named by its path below the folder, and must be in the folder's listing.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from os.path import realpath  # unlike `Path.resolve` it raises nothing on links in a circle
from pathlib import Path
from typing import Any

from bicycle_bag import metadata
from bicycle_bag.errors import BagError
from bicycle_bag.folder import visible
from bicycle_bag.metadata import NO_START
from bicycle_bag.reader import BagReader
from bicycle_cockpit.ridden import ridden

MOST_BAGS = 200
"""Largest number of listed bags, the newest."""
DEEPEST = 3
"""Depth of the search for bags below the folder."""
FRESH = 10.0
"""Age of an unfinished bag's last write up to which it counts as being recorded (s)."""

FILES = (".mcap", ".db3")
"""Endings of a bag's files; the second kind is listed with the remedy."""

Signature = tuple[tuple[str, int, int], ...]
"""Name, size and time of change of each of a bag's files: equal while the bag is unchanged."""


class BagShelf:
    """Bags below one folder.

    Attributes:
        left_out: Number of bags that were too many for the last listing.
    """

    def __init__(self, folder: Path) -> None:
        """Use `folder`, which need not exist yet."""
        self.folder = folder
        self.left_out = 0

    def found(self) -> dict[str, Path]:
        """Return the paths by name, newest first; skip links that lead out of the folder."""
        root = realpath(self.folder)
        paths = [
            path
            for path in _bags_below(self.folder, DEEPEST)
            if Path(realpath(path)).is_relative_to(root)
        ]
        paths.sort(key=_changed, reverse=True)
        self.left_out = max(0, len(paths) - MOST_BAGS)
        return {path.relative_to(self.folder).as_posix(): path for path in paths[:MOST_BAGS]}

    def path(self, name: str) -> Path:
        """Return a bag's path.

        Raises:
            KeyError: if the folder's listing has no such bag.
        """
        return self.found()[name]


def entry(name: str, path: Path) -> dict[str, Any]:
    """Return a bag's entry in the list.

    Returns:
        `name`, `start` (s since 1970, None if unknown), `duration` (s), `ridden` (s of simulated
        time, None if unknown) and `messages`; of a bag that cannot be shown `name` and
        `problem`, one line.
    """
    if not _is_text(name):
        return {"name": name, "problem": "its name is not UTF-8: rename it"}
    try:
        reader = BagReader(path)
    except BagError as error:
        fresh = time.time() - _written(path) < FRESH
        return {"name": name, "problem": "it is being written" if fresh else str(error)}
    about, messages = reader.metadata, reader.message_count
    if not messages:
        return {"name": name, "problem": "it holds no message"}
    known = 0 < about.starting_time_ns < 2**64 and about.starting_time_ns != NO_START
    return {
        "name": name,
        "start": about.starting_time_ns / 1e9 if known else None,
        "duration": about.duration_ns / 1e9,
        "ridden": ridden(reader.files),
        "messages": messages,
    }


def left_out(count: int) -> dict[str, Any]:
    """Return the entry that stands for bags which are not listed."""
    return {
        "name": f"{count} older bag{'s' * (count > 1)}",
        "problem": f"not listed: only the newest {MOST_BAGS} are; --bags takes another folder",
    }


def _is_text(name: str) -> bool:
    """Return True if a page can ask for this name."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _written(path: Path) -> float:
    """Return the time of the bag's last change, s since 1970."""
    return max((when for _, _, when in signature(path)), default=0) * 1e-9


def signature(path: Path) -> Signature:
    """Return a value that changes with the bag; empty if there is none."""
    found = []
    try:
        files = [path] if path.is_file() else sorted(path.iterdir())
    except OSError:
        return ()
    for file in files:
        try:
            about = file.stat()
        except OSError:
            continue  # removed in the meantime, or a broken link
        found.append((file.name, about.st_size, about.st_mtime_ns))
    return tuple(found)


def _bags_below(folder: Path, depth: int) -> Iterator[Path]:
    """Yield folders that contain a bag, and the files in `folder` itself."""
    try:
        inside = sorted(folder.iterdir())
    except OSError:
        return
    for path in inside:
        if not path.is_dir():
            if path.suffix == ".mcap" and path.name[0] != "." and path.is_file():
                yield path
        elif (path / metadata.FILE_NAME).is_file() or any(
            visible(path, ending) for ending in FILES
        ):
            yield path
        elif depth > 1:
            yield from _bags_below(path, depth - 1)


def _changed(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
