"""Every parameter of every node at wrong types and beyond its range: one line and status 2.

The cases come from the settings classes, so a new parameter is covered when it is there. Each
node is started as a user starts it, by its command line, but in this process.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from bicycle_common.nodes.declare_parameters import declare
from bicycle_common.nodes.runner import run
from bicycle_common.parameters import Parameter, parameters_of
from bicycle_controller.nodes.controller_node import ControllerNode
from bicycle_controller.nodes.controller_settings import ControllerSettings
from bicycle_controller.nodes.trainer_settings import TrainerSettings
from bicycle_hardware.nodes.driver_settings import DriverSettings
from bicycle_sim.nodes.sim_settings import SimSettings
from bicycle_tools.foxglove_settings import FoxgloveSettings

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("signals_as_they_were")]

SETTINGS = (
    SimSettings,
    ControllerSettings,
    TrainerSettings,
    FoxgloveSettings,
    DriverSettings,
)
NODES = {
    SimSettings: ("bicycle_sim.nodes.sim_node", "SimNode"),
    ControllerSettings: ("bicycle_controller.nodes.controller_node", "ControllerNode"),
    TrainerSettings: ("bicycle_controller.nodes.trainer_node", "TrainerNode"),
    DriverSettings: ("bicycle_hardware.nodes.driver_node", "DriverNode"),
}


def wrong(item: Parameter) -> Iterator[str]:
    """Yield values, as a user writes them, that a parameter cannot have."""
    default = item.default
    yield from ("[1, 2]", "[]")
    if isinstance(default, bool):
        yield from ("3", "maybe")
        return
    if isinstance(default, str):
        yield from ("3", "true", ".nan")
        yield from ("nonsense", "'3'", "Ä") if item.choices else ()
        return
    yield from ("true", "nonsense", ".nan", "-.inf")
    if isinstance(default, int):
        yield "1.5"
    if item.low is not None and item.high is not None:
        below, above = (item.low - 1, item.high * 2 + 1)
        yield from (
            (str(below), str(above))
            if isinstance(default, int)
            else (
                f"{float(below):.6f}",
                f"{float(above):.6f}",
                str(int(above)),
            )
        )


def refused(capfd: pytest.CaptureFixture[str], make: object, *words: str) -> str:
    """Return the one line with which a node refuses to start."""
    status = run("node", make, args=["node", "--ros-args", *words])  # type: ignore[arg-type]
    printed = capfd.readouterr().err
    own = [line for line in printed.splitlines() if line.startswith("node: ")]
    assert status == 2, f"{words}: {printed}"
    assert len(own) == 1, f"{words}: {printed}"
    assert "Traceback" not in printed
    return own[0]


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("kind", SETTINGS, ids=lambda kind: kind.__name__)
def test_no_wrong_value_of_any_parameter_gets_in(
    kind: type, capfd: pytest.CaptureFixture[str]
) -> None:
    import rclpy
    from rclpy.node import Node

    def make() -> Node:
        result = Node("node", enable_rosout=False, start_parameter_services=False)
        try:
            declare(result, kind)
        finally:
            result.destroy_node()
        rclpy.try_shutdown()
        raise AssertionError("let in")

    for item in parameters_of(kind):
        for value in wrong(item):
            line = refused(capfd, make, "-p", f"{item.name}:={value}")
            assert item.name in line, line
        line = refused(capfd, make, "-p", f"{item.name}s:=1")
        assert f"did you mean {item.name!r}" in line, line


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("kind", NODES, ids=lambda kind: kind.__name__)
def test_the_nodes_themselves_refuse_so(kind: type, capfd: pytest.CaptureFixture[str]) -> None:
    module, name = NODES[kind]
    make = getattr(importlib.import_module(module), name)
    item = next(found for found in parameters_of(kind) if found.choices)
    assert item.name in refused(capfd, make, "-p", f"{item.name}:=nonsense")
    assert "unknown parameter" in refused(capfd, make, "-p", "nonsense:=1")


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("2b", "holds '2b'"),
        ("b2,b//3", "holds 'b//3'"),
        ("é", "holds 'é'"),
        ("b-2", "holds 'b-2'"),
        ("b" * 240, "holds 'bbb"),
        ("b2,b1", "holds 'b1', this bicycle"),
    ],
)
def test_what_is_no_other_bicycle_is_not_kept_clear_of(
    names: str, said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    line = refused(capfd, ControllerNode, "-r", "__ns:=/b1", "-p", f"keep_clear:={names}")
    assert f"parameter keep_clear {said}" in line


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    "words", [("-p", "x"), ("-p", "x:=["), ("--params-file", "/none.yaml"), ("--what",), ("-p",)]
)
def test_ros_arguments_that_cannot_be_read_are_one_line(
    words: tuple[str, ...], capfd: pytest.CaptureFixture[str]
) -> None:
    def make() -> object:
        raise AssertionError("let in")

    refused(capfd, make, *words)


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("rule", ["__ns", "__node", "__name"])
@pytest.mark.parametrize("name", ["", "ü", "a b", "9x", "a//b", "/x/", "-", "x" * 300])
def test_a_name_that_ros_refuses_is_one_line_with_the_remedy(
    rule: str, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    def make() -> object:
        raise AssertionError("let in")

    for value in (name, f"/{name}") if rule == "__ns" and name[:1] != "/" else (name,):
        if value == "/":
            continue
        line = refused(capfd, make, "-r", f"{rule}:={value}")
        assert f"{rule}:=" in line
        assert "rcl" not in line
        assert "letters, digits and _" in line


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{a: " * 10**6, "nested deeper"),
        ("x" * 10**7, "longer than"),
        ("node: {ros__parameters: {rate: " + "9" * 10**6 + "}}", "unknown parameter 'rate'"),
        ("".join(f"%TAG !a{i}! tag:x\n" for i in range(10**5)) + "---\na", "%TAG directives"),
    ],
    ids=["nesting", "length", "digits", "tags"],
)
def test_a_yaml_bomb_as_parameter_file_is_refused_in_one_line(
    text: str, said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    import rclpy
    from rclpy.node import Node

    def make() -> Node:
        result = Node("node", enable_rosout=False, start_parameter_services=False)
        try:
            declare(result, SimSettings)
        finally:
            result.destroy_node()
        rclpy.try_shutdown()
        raise AssertionError("let in")

    file = tmp_path / "parameters.yaml"
    file.write_text(text)
    line = refused(capfd, make, "--params-file", str(file))
    assert said in line
    assert len(line) < 1000
