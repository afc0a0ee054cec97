"""Command line of the cockpit."""

from __future__ import annotations

import argparse
import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bicycle_cockpit.access import AccessPolicy
from bicycle_cockpit.token_source import find_token
from bicycle_common.command_line import OneLineParser
from bicycle_common.node_commands import checked_parameter

DEFAULT_PORT = 8765
RIDE = ("simulator", "controller")
"""Nodes that the cockpit starts, in this order."""
NAMESPACE = "__ns:="


@dataclass(frozen=True)
class CockpitOptions:
    """Options of a cockpit."""

    access_policy: AccessPolicy
    port: int
    bags: Path
    """Folder of the shown bags and of new ones."""
    models: Path
    """Folder of policy files that can be chosen."""
    ride: bool
    """True to start simulator and controller, too."""
    parameters: tuple[str, ...]
    """`NODE.name:=value`."""
    ros: tuple[str, ...]
    """Arguments for the cockpit's own node, such as `-r __ns:=/red`."""

    @property
    def namespace(self) -> str:
        """Return the namespace that the ROS arguments name; `/` without one."""
        named = [word.removeprefix(NAMESPACE) for word in self.ros if word.startswith(NAMESPACE)]
        return f"/{named[0].strip('/')}" if named else "/"

    @property
    def rules(self) -> tuple[str, ...]:
        """Return the ROS arguments without those that rename the node or name a namespace."""
        kept: list[str] = []
        for word in self.ros:
            if word.startswith((NAMESPACE, "__node:=", "__name:=")):
                kept = kept[:-1]  # the -r before it
            else:
                kept.append(word)
        return tuple(kept)

    def url(self, port: int) -> str:
        """Return the address for the browser; the token is behind #, which is never sent."""
        address = self.access_policy.address
        host = "localhost" if address in ("0.0.0.0", "::") else address
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{port}/" + (
            f"#token={self.access_policy.token}" if self.access_policy.token else ""
        )


def parse(arguments: Sequence[str], workspace: Path) -> CockpitOptions:
    """Read the command line; on an error end the program with status 2 and one line."""
    words = list(arguments)
    at = words.index("--ros-args") if "--ros-args" in words else len(words)
    own, ros = words[:at], words[at:]
    spaces = [word for word in own if word.startswith(NAMESPACE)]
    if spaces:
        own = [word for word in own if word not in spaces]
        ros = ["--ros-args", "-r", spaces[0], *ros[1:]]
    parser = OneLineParser(prog="cockpit.sh", add_help=False, allow_abbrev=False)
    add = parser.add_argument
    add("--port", type=int, default=DEFAULT_PORT)
    add("--bind", default="127.0.0.1")
    add("--token")
    add("--token-file", type=Path)
    add("--host-name", action="append", default=[])
    add("--bags", type=Path, default=workspace / "runs")
    add("--models", type=Path, default=workspace.parent / "runs")
    add("--no-ride", action="store_true")
    add("parameters", nargs="*")
    given = parser.parse_intermixed_args(own)
    try:
        return _checked(given, ros)
    except ValueError as error:
        parser.error(str(error))


def _checked(given: argparse.Namespace, ros: list[str]) -> CockpitOptions:
    """Return the options.

    Raises:
        ValueError: on a value out of range, unsafe access rules or an unknown word.
    """
    if not 0 <= given.port <= 65535:
        raise ValueError(f"--port is {given.port}: choose 1 to 65535, or 0 for a free one")
    for word in given.parameters:
        if ":=" not in word:
            raise ValueError(f"unknown argument {word!r}")
    if given.no_ride and given.parameters:
        raise ValueError(f"{given.parameters[0]!r} sets nothing with --no-ride: leave one out")
    for option, folder in (("--bags", given.bags), ("--models", given.models)):
        if _is_another_thing(folder):
            raise ValueError(f"{option} {str(folder)[:200]} is no folder")
    token = find_token(given.token, given.token_file, os.environ)
    names = frozenset(name.lower() for name in given.host_name)
    return CockpitOptions(
        access_policy=AccessPolicy(given.bind, token, names),
        port=given.port,
        bags=given.bags,
        models=given.models,
        ride=not given.no_ride,
        parameters=tuple(checked_parameter(word) for word in given.parameters),
        ros=tuple(ros),
    )


def _is_another_thing(path: Path) -> bool:
    """Return True if something is there that is no folder."""
    try:
        return not stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False
