"""Launch files: what they start exists, and what they set are parameters.

The launch library is not on PyPI, so they run on stand-ins for its classes.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest
from launch_stand_in import describe

from bicycle_controller.nodes.controller_settings import ControllerSettings
from bicycle_controller.nodes.trainer_settings import TrainerSettings
from bicycle_hardware.nodes.driver_settings import DriverSettings
from bicycle_sim.nodes.sim_settings import SimSettings

ROOT = Path(__file__).parents[2]
LAUNCH = ROOT / "ros2_ws/src/bicycle_bringup/launch"
FILES = sorted(LAUNCH.glob("*.launch.py"))
SETTINGS = {
    "bicycle_sim": SimSettings,
    "bicycle_controller": ControllerSettings,
    "bicycle_trainer": TrainerSettings,
    "bicycle_driver": DriverSettings,
}
"""Parameters of each program that a launch file gives some."""

each_file = pytest.mark.parametrize("file", FILES, ids=[file.name for file in FILES])


def test_there_is_one_for_each_way_to_ride() -> None:
    names = {file.name.partition(".")[0] for file in FILES}
    assert names >= {"ride", "cockpit", "trainer", "fleet", "hardware"}


@each_file
def test_what_it_starts_exists(file: Path) -> None:
    nodes = describe(file).nodes
    assert nodes
    for node in nodes:
        package, program = node["package"], node["executable"]
        setup = (ROOT / "ros2_ws/src" / package / "setup.py").read_text()
        assert f'"{program} = ' in setup, f"{package} has no program {program}"


@each_file
def test_what_it_sets_are_parameters(file: Path) -> None:
    for node in describe(file).nodes:
        parameters = node.get("parameters", [])
        if not parameters:
            continue
        known = {item.name for item in fields(SETTINGS[node["executable"]])}
        for given in parameters:
            if isinstance(given, dict):
                assert given.keys() - known == set()
            else:
                assert (LAUNCH.parent / "config" / given.values[0][-1]).is_file()


@each_file
def test_it_uses_the_arguments_that_it_declares(file: Path) -> None:
    found = describe(file)
    assert found.used == found.arguments.keys()


def test_a_ride_keeps_what_the_yaml_file_says_unless_it_is_asked_for() -> None:
    file = LAUNCH / "ride.launch.py"
    plain = describe(file)
    assert plain.parameters("bicycle_controller").keys() == {"policy"}
    assert plain.commands == [["ros2", "bag", "record", "--all"]]
    simulated = plain.parameters("bicycle_sim").keys()
    assert simulated == {"scenario", "plant", "bicycle", "pace"}
    given = {"state": "estimated", "sensors": "mpu6050", "keep_clear": "b2", "after_goal": "slow"}
    asked = describe(file, **given)
    assert asked.parameters("bicycle_controller").keys() == {"policy"} | given.keys()
    assert asked.parameters("bicycle_sim").keys() == simulated | {"sensors"}


def test_the_cockpit_passes_arguments_that_a_ride_declares() -> None:
    ((name, passed),) = describe(LAUNCH / "cockpit.launch.py").included
    assert name == "ride.launch.py"
    assert passed.keys() <= describe(LAUNCH / name).arguments.keys()


def test_bicycles_of_a_fleet_keep_clear_of_one_another() -> None:
    nodes = describe(LAUNCH / "fleet.launch.py", bicycles="3").nodes
    assert [node["namespace"] for node in nodes] == ["b1", "b1", "b2", "b2", "b3", "b3"]
    clear = [item for node in nodes[1::2] for item in node["parameters"] if isinstance(item, dict)]
    assert [item["keep_clear"] for item in clear] == ["b2,b3", "b1,b3", "b1,b2"]


def test_a_real_bicycle_is_controlled_by_estimates() -> None:
    found = describe(LAUNCH / "hardware.launch.py")
    assert found.parameters("bicycle_controller")["state"] == "estimated"
    assert found.nodes[1]["remappings"] == [("bicycle/estimate", "bicycle/state")]
