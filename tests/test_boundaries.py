"""The import law of docs/architecture.md, by walking the sources and by asking a fresh Python."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = {
    "bicycle_sim": ROOT / "bicycle_sim" / "bicycle_sim",
    "bicycle_controller": ROOT / "bicycle_controller" / "bicycle_controller",
    "bicycle_common": ROOT / "ros2_ws" / "src" / "bicycle_common" / "bicycle_common",
    "bicycle_tools": ROOT / "ros2_ws" / "src" / "bicycle_tools" / "bicycle_tools",
    "bicycle_bag": ROOT / "ros2_ws" / "src" / "bicycle_bag" / "bicycle_bag",
    "bicycle_bringup": ROOT / "ros2_ws" / "src" / "bicycle_bringup" / "bicycle_bringup",
    "bicycle_cockpit": ROOT / "ros2_ws" / "src" / "bicycle_cockpit" / "bicycle_cockpit",
}
ROS = ("rclpy", "rcl_interfaces", "rosgraph_msgs", "builtin_interfaces", "std_srvs")


def imported(path: Path) -> Iterator[str]:
    """Full names of the modules that a source file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def sources(package: str) -> list[Path]:
    found = sorted(PACKAGES[package].rglob("*.py"))
    assert found, f"no sources of {package}"
    return found


def is_ros(module: str) -> bool:
    top = module.partition(".")[0]
    return top in ROS or top.endswith("_msgs")


@pytest.mark.parametrize("package", PACKAGES)
def test_only_nodes_import_ros(package: str) -> None:
    offenders = [
        f"{path.relative_to(ROOT)}: {module}"
        for path in sources(package)
        for module in imported(path)
        if "nodes" not in path.parts and (is_ros(module) or ".nodes" in module)
    ]
    assert offenders == []


def test_the_walk_sees_ros_where_it_is() -> None:
    assert any(
        is_ros(module)
        for path in sources("bicycle_sim")
        if "nodes" in path.parts
        for module in imported(path)
    )


def test_the_simulator_knows_no_controller() -> None:
    offenders = [
        f"{path.relative_to(ROOT)}: {module}"
        for path in sources("bicycle_sim")
        for module in imported(path)
        if module.partition(".")[0] in ("bicycle_controller", "bicycle_bag", "torch")
    ]
    assert offenders == []


@pytest.mark.parametrize(
    "module",
    [
        "bicycle_sim.runtime.simulator",
        "bicycle_controller.policy.policy",
        "bicycle_controller.control.lqr",
        "bicycle_controller.control.control_loop",
        "bicycle_controller.evaluation.evaluate",
        "bicycle_bag.reader",
        "bicycle_cockpit.server",
    ],
)
def test_what_rides_needs_neither_torch_nor_ros(module: str) -> None:
    code = (
        f"import sys, {module}\n"
        "print([m for m in ('torch', 'rclpy', 'gymnasium', 'ray') if m in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"


@pytest.mark.ros
@pytest.mark.parametrize(
    "module", ["bicycle_sim.nodes.sim_node", "bicycle_controller.nodes.controller_node"]
)
def test_the_control_processes_hold_no_torch(module: str) -> None:
    code = f"import sys, {module}\nprint('torch' in sys.modules)"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "False"
