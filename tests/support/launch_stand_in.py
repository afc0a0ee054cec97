"""Run launch files without ROS 2's launch, which is not on PyPI, and tell what they describe.

Only the classes that the launch files use exist here, and they only keep what they are given.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

PARTS = "bicycle_bringup.launch_parts"


class Kept:
    """Object that keeps the arguments of its constructor."""

    def __init__(self, *values: Any, **options: Any) -> None:
        self.values, self.options = values, options


@dataclass
class Described:
    """Description that a launch file gives."""

    arguments: dict[str, str] = field(default_factory=dict)
    """Default of each argument that it declares."""
    used: set[str] = field(default_factory=set)
    """Names of the arguments that it reads."""
    nodes: list[dict[str, Any]] = field(default_factory=list)
    """Options of each node."""
    commands: list[list[str]] = field(default_factory=list)
    """Command lines of its other processes."""
    included: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    """Name and arguments of each launch file that it includes."""

    def parameters(self, executable: str) -> dict[str, Any]:
        """Return the parameters that the only node of that program gets, without its YAML."""
        (node,) = [node for node in self.nodes if node["executable"] == executable]
        found: dict[str, Any] = {}
        for item in node["parameters"]:
            found |= item if isinstance(item, dict) else {}
        return found


def describe(file: Path, **given: str) -> Described:
    """Run a launch file with arguments and return what it describes."""
    result = Described()
    with _libraries(result.used):
        actions = runpy.run_path(str(file))["generate_launch_description"]().values[0]
        for action in actions:
            if type(action).__name__ == "DeclareLaunchArgument":
                result.arguments[action.values[0]] = action.options["default_value"]
        _note(result, actions, result.arguments | given)
    return result


def _note(result: Described, actions: list[Any], context: dict[str, str]) -> None:
    """Note the actions in `result`; a function's are asked of it."""
    for action in actions:
        kind = type(action).__name__
        if kind == "OpaqueFunction":
            _note(result, action.options["function"](context), context)
        elif kind == "Node":
            result.nodes.append(action.options)
        elif kind == "ExecuteProcess":
            result.commands.append(action.options["cmd"])
        elif kind == "IncludeLaunchDescription":
            name = action.values[0].values[0][-1]
            result.included.append((name, dict(action.options["launch_arguments"])))


@contextmanager
def _libraries(used: set[str]) -> Iterator[None]:
    """Put stand-ins for the libraries in place; reading an argument notes its name in `used`."""

    class LaunchConfiguration(Kept):
        def __init__(self, name: str) -> None:
            super().__init__(name)
            used.add(name)

        def perform(self, context: dict[str, str]) -> str:
            return context[str(self.values[0])]

    names = {
        "launch": ("LaunchDescription",),
        "launch.actions": (
            "DeclareLaunchArgument",
            "ExecuteProcess",
            "IncludeLaunchDescription",
            "OpaqueFunction",
        ),
        "launch.conditions": ("IfCondition",),
        "launch.launch_context": ("LaunchContext",),
        "launch.substitutions": ("PathJoinSubstitution", "PythonExpression"),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
        "launch_ros.parameter_descriptions": ("ParameterValue",),
        "launch_ros.substitutions": ("FindPackageShare",),
    }
    modules = {name: ModuleType(name) for name in names}
    for name, classes in names.items():
        for class_name in classes:
            setattr(modules[name], class_name, type(class_name, (Kept,), {}))
    modules["launch.substitutions"].LaunchConfiguration = LaunchConfiguration  # type: ignore[attr-defined]
    before = {name: sys.modules.pop(name, None) for name in (*modules, PARTS)}
    sys.modules.update(modules)
    try:
        yield
    finally:
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module
