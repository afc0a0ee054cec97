"""Machine of a benchmark, for its results file."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from typing import Any

from bicycle_common.origin import processor


def machine(*packages: str) -> dict[str, Any]:
    """Processor, load and versions of Python and `packages`; None for one that is not there."""
    return {
        "cpu": processor(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        **{name: _version(name) for name in packages},
    }


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
