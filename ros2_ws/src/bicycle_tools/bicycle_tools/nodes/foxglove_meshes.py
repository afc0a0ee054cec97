"""Meshes that Foxglove asks for by the names that the URDF gives them.

Foxglove cannot read files of this machine; it asks the server that sent the URDF.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from bicycle_sim.nodes.robot_urdf import MESHES


@cache
def folder() -> Path | None:
    """Return the installed folder of the meshes; None if bicycle_sim is not installed."""
    inner = MESHES.removeprefix("package://").replace("bicycle_sim", "share/bicycle_sim", 1)
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix and (Path(prefix) / inner).is_dir():
            return Path(prefix) / inner
    return None


def mesh(uri: str) -> bytes | None:
    """Return the contents of a mesh; None for every other file, which no client may have."""
    place, _, name = uri.rpartition("/")
    found = folder()
    if place != MESHES or found is None:
        return None
    files = {path.name: path for path in found.glob("*.stl")}
    try:
        return files[name].read_bytes() if name in files else None
    except OSError:
        return None
