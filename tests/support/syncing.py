"""A note of what is brought to the disk, in its order."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def noted_syncs(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, object]]:
    """Return a list that takes name and content of what `os.fsync` brings to the disk.

    Content is the bytes of a file, and the sorted names in a folder.
    """
    really = os.fsync
    synced: list[tuple[str, object]] = []

    def note(descriptor: int) -> None:
        place = Path(f"/proc/self/fd/{descriptor}").readlink()
        names = sorted(path.name for path in place.iterdir()) if place.is_dir() else None
        synced.append((place.name, names or place.read_bytes()))
        really(descriptor)

    monkeypatch.setattr(os, "fsync", note)
    return synced
