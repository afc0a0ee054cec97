"""Rides by estimates: upright under delay, motor, friction and wind; the command's errors."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bicycle_controller.cli.main import main
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.evaluation import sensing
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors

HARD: dict[str, Any] = {"delay": 0.05, "motor_lag": 0.03, "friction": 0.5, "wind": 2.0}


@pytest.mark.parametrize("bicycle", ["browser-rider", "steer-by-wire"])
def test_rides_from_estimates_only_stay_upright(bicycle: str) -> None:
    given = sensing.Conditions(sensors=sensors.load("mpu6050"), duration=10.0, **HARD)
    plant = given.applied(registry.named("whipple", bicycle))
    found = sensing.ride(LqrController.named("lqr", plant, 7.0), plant, given, 60, seed=2)
    assert found.fall_rate == 0.0
    assert found.summary()["roll_error_rms_deg"] < 1.0


def test_any_bicycle_rides_from_estimates_through_friction() -> None:
    given = sensing.Conditions(sensors=sensors.load("mpu6050"), speeds=(2.0, 2.5), **HARD)
    plant = given.applied(registry.named("whipple", "balance-assist-rider"))
    found = sensing.ride(load_controller("any-bicycle", plant), plant, given, 40, seed=2)
    # An estimator that does not know the friction costs a third of these rides.
    assert found.fall_rate == 0.0


def test_same_seed_same_rides_another_seed_others() -> None:
    given = sensing.Conditions(sensors=sensors.load("mpu6050"), duration=2.0)
    plant = registry.named("whipple", "browser-rider")
    who = LqrController.named("lqr", plant, 7.0)
    first, again, other = (
        sensing.ride(who, plant, given, 5, seed=seed).summary() for seed in (4, 4, 5)
    )
    assert first == again
    assert first != other


def test_command_tells_what_each_imperfection_costs(capsys: pytest.CaptureFixture[str]) -> None:
    words = "sensing lqr --bicycles browser-rider --episodes 4 --duration 2 --costs --json"
    assert main([*words.split(), "--delay", "0.05", "--wind", "2"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["with"] for row in rows] == ["nothing", "sensors", "delay", "wind", "everything"]
    assert rows[0]["roll_error_rms_deg"] == 0.0 < rows[1]["roll_error_rms_deg"] < 1.0


def test_command_tells_what_a_wrong_friction_of_the_model_costs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = "sensing lqr --bicycles browser-rider --episodes 6 --duration 6 --friction 0.5 --json"
    assert main(words.split()) == 0
    known = json.loads(capsys.readouterr().out)["rows"][0]
    assert main([*words.split(), "--model-friction", "0,0.5"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"command", "commit", "processor"} <= found.keys()
    none, right = found["rows"]
    assert [none["with"], right["with"]] == ["model friction 0", "model friction 0.5"]
    assert right["roll_error_rms_deg"] == known["roll_error_rms_deg"]
    assert none["roll_error_rms_deg"] > 1.2 * right["roll_error_rms_deg"]


def test_a_policy_of_another_bicycle_is_warned_of(capsys: pytest.CaptureFixture[str]) -> None:
    words = "--bicycles browser-rider --episodes 1 --duration 1 --sensors none --json"
    for name, unlike in (("fixed-speed", ["plant whipple, not choi"]), ("any-bicycle", [])):
        assert main(["sensing", name, *words.split()]) == 0
        printed = capsys.readouterr()
        assert json.loads(printed.out)["rows"][0]["unlike_training"] == unlike
        assert printed.err.count("\n") == bool(unlike)
        assert ("bicycle browser-rider; plant whipple, not choi" in printed.err) == bool(unlike)


@pytest.mark.parametrize("name", ["fixed-speed", "any-bicycle"])
def test_a_lost_link_needs_an_lqr(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sensing", name, "--link-loss", "--bicycles", "benchmark"]) == 2
    error = capsys.readouterr().err
    assert "--link-loss rides by an LQR: choose one of lqr" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--sensors mpu605", "did you mean 'mpu6050'"),
        ("--bicycles broswer", "did you mean 'browser'"),
        ("--speeds 4", "write LOW,HIGH"),
        ("--speeds 6,2", "speeds must lie within"),
        ("--delay -1", "delay must lie within"),
        ("--episodes 0", "at least one ride"),
        ("--link-loss --costs", "choose one of"),
        ("--model-friction x", "write N_M[,N_M...]"),
        ("--model-friction -1", "friction must lie within"),
        ("--model-friction 1 --costs", "choose one of"),
        ("--model-friction 1 --sensors none", "needs --sensors"),
        ("--model-friction 1 --link-loss", "has no estimator"),
    ],
)
def test_mistakes_are_told_in_one_line(
    words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(["sensing", "lqr", *words.split()])
    except SystemExit as error:
        status = int(error.code or 0)
    assert status == 2
    error_text = capsys.readouterr().err
    assert message in error_text
    assert error_text.count("\n") == 1
