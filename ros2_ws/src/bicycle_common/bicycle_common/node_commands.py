"""Commands that start the stack's programs, and the location of their files."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from bicycle_common.ros_names import TOKEN
from bicycle_common.validation import nearest

MODULES = {
    "recorder": "bicycle_bag.nodes.recorder_node",
    "simulator": "bicycle_sim.nodes.sim_node",
    "controller": "bicycle_controller.nodes.controller_node",
}
"""Modules of the nodes of a ride, in start order."""

BENCH = {
    "recorder": MODULES["recorder"],
    "simulator": "bicycle_hardware.nodes.bench_node",
    "driver": "bicycle_hardware.nodes.driver_node",
    "controller": MODULES["controller"],
}
"""The same of a ride whose commands reach the bicycle through a simulated microcontroller."""


CONFIGURED = ("simulator", "controller", "driver")
"""Nodes that have parameters."""


def program(name: str, modules: Mapping[str, str] = MODULES) -> list[str]:
    """Return the command of one node, a key of `modules`, without arguments."""
    return [sys.executable, "-m", modules[name]]


def node_command(
    name: str,
    config: Path,
    parameters: Sequence[str],
    parameter_files: Sequence[Path] = (),
    modules: Mapping[str, str] = MODULES,
) -> list[str]:
    """Return the command that starts a node with parameters.

    Args:
        name: one of `CONFIGURED`.
        config: folder with one parameter file per node.
        parameters: `NODE.name:=value` of any node; those of other nodes are ignored.
        parameter_files: read after the node's own.
        modules: of the nodes, by name.
    """
    ros = ["--ros-args"]
    for file in (config / f"{name}.yaml", *parameter_files):
        ros += ["--params-file", str(file)]
    for entry in parameters:
        node, _, assignment = entry.partition(".")
        if node == name:
            ros += ["-p", assignment]
    return [*program(name, modules), *ros]


def workspace() -> Path:
    """Return the scripts' workspace, or the current folder if there is none."""
    return Path(os.environ.get("BICYCLE_WS", Path.cwd()))


def config_folder() -> Path:
    """Return the folder of the parameter files: beside the sources, or colcon's installed one.

    Raises:
        ValueError: if it is in neither place.
    """
    sources = Path(__file__).resolve().parents[2] / "bicycle_bringup"
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    installed = [Path(prefix) / "share" / "bicycle_bringup" for prefix in prefixes if prefix]
    for place in (sources, *installed):
        if (place / "config").is_dir():
            return place / "config"
    raise ValueError("bicycle_bringup's config folder is not found: source the workspace")


def checked_parameter(word: str) -> str:
    """Return `NODE.name:=value` unchanged.

    Raises:
        ValueError: if NODE is no node with parameters, if no parameter can have that name, or
            without a value.
    """
    rule, _, value = word.partition(":=")
    node, dot, name = rule.partition(".")
    if not dot or node not in CONFIGURED:
        raise ValueError(
            f"{word!r} names no node{nearest(node, CONFIGURED)}: write it as NODE.name:=value "
            f"with {' or '.join(CONFIGURED)}"
        )
    if not re.fullmatch(rf"{TOKEN}(\.{TOKEN})*", name):
        raise ValueError(f"{word!r} names no parameter of {node}: write it as {node}.name:=value")
    if not value.strip():
        raise ValueError(f"{word!r} gives no value: write one behind :=, or leave it out")
    return word
