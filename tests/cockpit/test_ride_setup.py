"""Conditions of a ride that a page may choose, and the nodes' parameters that make it so."""

from __future__ import annotations

import pytest

from bicycle_cockpit import setup_labels
from bicycle_cockpit.ride_setup import (
    PLANTS,
    RideSetup,
    choices,
    command,
    merged,
    of_parameters,
    own_bicycle,
    with_policy,
)
from bicycle_sim.nodes.sim_settings import SimSettings
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import SCENARIOS

WHIPPLE = RideSetup(plant="whipple", bicycle="browser-rider", sensors="mpu6050", speed=4.0)


def test_parameters_are_read_back_and_what_is_the_same_is_left_alone() -> None:
    words = ("simulator.reset_after_fall:=2.0", "controller.policy:=lqr", "simulator.bicycle:=''")
    before = of_parameters(words)
    assert before == RideSetup()
    found = merged(words, WHIPPLE, before)
    assert of_parameters(found) == WHIPPLE
    assert set(words[:2]) < set(found)
    assert "controller.state:=estimated" in found
    assert not [word for word in found if "real_time_factor" in word]
    back = merged(found, before, WHIPPLE)
    assert of_parameters(back) == before
    assert "controller.state:=truth" in back
    assert with_policy(back, "naf")[-1] == "controller.policy:=naf"
    assert "controller.policy:=lqr" not in with_policy(back, "naf")


def test_what_is_offered_has_short_labels_of_its_own_without_ids() -> None:
    offered = choices()
    assert {name for name, *_ in offered["bicycles"]} == set(setup_labels.BICYCLES)
    assert {name for name, *_ in offered["sensors"]} == set(setup_labels.SENSORS)
    for kind in ("scenarios", "plants", "bicycles", "sensors", "courses"):
        labels = [label for _, label, *_ in offered[kind]]
        assert len(set(labels)) == len(labels), kind
        assert max(map(len, labels)) <= 60, labels
        ids = [name for name, *_ in offered[kind] if "-" in name]
        assert not [label for label in labels if any(name in label for name in ids)]


def test_a_bicycle_of_ones_own_stays_unless_another_is_chosen() -> None:
    words = ("simulator.plant:=whipple", "simulator.bicycle:=mine.yaml")
    before = of_parameters(words)
    faster = before.changed({"rate": 2})
    assert merged(words, faster, before)[:2] == words
    assert "simulator.real_time_factor:=2.0" in merged(words, faster, before)


def test_first_values_are_those_that_the_nodes_have_and_words_win() -> None:
    told = {"simulator.plant": "whipple", "simulator.bicycle": "browser-rider"}
    told |= {"simulator.start_speed": 4.0, "simulator.real_time_factor": 0.5}
    found = of_parameters((), told)
    assert found == RideSetup(plant="whipple", bicycle="browser-rider", speed=4.0, rate=0.5)
    words = ("simulator.start_speed:=3.0",)
    assert of_parameters(words, told) == found.changed({"speed": 3.0})
    back = merged(words, found.changed({"plant": "choi", "bicycle": ""}), found)
    assert "simulator.plant:=choi" in back
    assert "simulator.bicycle:=''" in back


def test_a_bicycle_of_ones_own_is_named() -> None:
    mine = {"simulator.plant": "whipple", "simulator.bicycle": "mine.yaml"}
    assert own_bicycle((), mine) == "mine.yaml"
    assert own_bicycle(("simulator.plant:=choi",), mine) == ""
    assert own_bicycle(("simulator.bicycle:='browser'",), mine) == ""
    assert own_bicycle(()) == ""


def test_the_simulator_takes_all_that_is_offered() -> None:
    assert set(PLANTS) == set(registry.PLANTS)
    offered = choices()
    assert [name for name, _ in offered["scenarios"]] == list(SCENARIOS)
    for name, _, about in offered["bicycles"]:
        assert about
        setup = RideSetup(plant="whipple", bicycle=name)
        settings = SimSettings(scenario=setup.scenario, plant=setup.plant, bicycle=setup.bicycle)
        assert settings.make_plant().label
    for name, _ in offered["sensors"]:
        assert SimSettings(sensors=name).make_sensors() is not None


def test_a_ride_that_was_started_elsewhere_gets_the_commands_to_type() -> None:
    assert command(WHIPPLE, RideSetup()) == (
        "./ros2_ws/sim.sh plant:=whipple bicycle:=browser-rider sensors:=mpu6050 start_speed:=4.0 "
        "and ./ros2_ws/controller.sh state:=estimated"
    )


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"plant": "whippel"}, "did you mean 'whipple'"),
        ({"bicycle": "/etc/passwd", "plant": "whipple"}, "not offered"),
        ({"sensors": "mpu"}, "which is not offered"),
        ({"speed": 99.0}, "speed is 99, not -1 to 20 m/s"),
        ({"rate": 0.0}, "rate is 0, not"),
        ({"noise": 0.5}, "noise is 0.5"),
        ({"noise": 0.1, "plant": "whipple"}, "only the paper's bicycle has noise"),
        ({"bicycle": "benchmark"}, "choose another model"),
        ({"colour": "red"}, "no 'colour'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(values: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why) as caught:
        RideSetup().changed(values)
    assert "\n" not in str(caught.value)
