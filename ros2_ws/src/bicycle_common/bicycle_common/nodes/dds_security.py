"""Refuse to start a node without DDS security if the environment asks for it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import rclpy

PREFIX = "ROS_SECURITY_"
MEANINGS = {
    f"{PREFIX}ENABLE": ("true", "false"),
    f"{PREFIX}STRATEGY": ("Enforce", "Permissive"),
}
"""Values that ROS knows; ROS treats any other as "open"."""
PLUGIN = b"builtin.PKI-DH"
"""Fast DDS's authentication plugin: the library contains this name only if built with security."""


def complaint(environment: Mapping[str, str], library: Path | None) -> str:
    """Return the reason why a node may not start, in one line; empty if it may.

    Args:
        environment: environment variables, with those of SROS2 if set.
        library: Fast DDS; None for another middleware, which checks for itself.
    """
    asked = sorted(name for name in environment if name.startswith(PREFIX) and environment[name])
    for name, known in MEANINGS.items():
        if name in asked and environment[name] not in known:
            return f"{name} is {environment[name]!r}: ROS knows {' and '.join(map(repr, known))}"
    if not asked or environment.get(f"{PREFIX}ENABLE") == "false":
        return ""
    if library is None or PLUGIN in library.read_bytes():
        return ""
    return (
        f"DDS security is asked for ({', '.join(asked)}), but {library.name} is built without it: "
        "unset that to run open on this machine alone, or take ROS 2 from apt (docs/security.md)"
    )


def fast_dds() -> Path | None:
    """Return the Fast DDS library of this process; None if another middleware is used."""
    rclpy.get_rmw_implementation_identifier()  # loads the middleware
    for line in Path("/proc/self/maps").read_text().splitlines():
        path = Path(line.partition("/")[1] + line.partition("/")[2])
        if path.name.startswith(("libfastrtps.so", "libfastdds.so")):
            return path
    return None


def refusal() -> str:
    """Return the reason why no node may start in this process, in one line; empty if it may."""
    if not any(name.startswith(PREFIX) for name in os.environ):
        return ""
    return complaint(os.environ, fast_dds())
