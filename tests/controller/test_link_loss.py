"""Loss of commands: the firmware's law keeps bicycles upright, hold-then-zero does not."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bicycle_controller.cli.main import main
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.evaluation import link_loss
from bicycle_controller.evaluation.sensing import Conditions
from bicycle_sim.plants import registry


@pytest.mark.parametrize("bicycle", ["browser-rider", "steer-by-wire"])
def test_fallback_keeps_upright_what_hold_then_zero_drops(bicycle: str) -> None:
    plant = registry.named("whipple", bicycle)
    given = Conditions(speeds=(1.5, 5.0), friction=0.5, motor_lag=0.03, wind=1.0)
    who = LqrController.named("lqr", plant, 7.0)
    law, held = (
        link_loss.ride(who, plant, given, name, 100, seed=3)
        for name in (link_loss.FIRMWARE, link_loss.HELD)
    )
    assert law.share >= 0.995
    assert held.share < 0.8
    assert np.isfinite(held.fall_time).any()


def test_a_motor_that_lags_needs_the_damping() -> None:
    plant = registry.named("whipple", "browser-rider")
    who = LqrController.named("lqr", plant, 7.0)
    for lag, fewest, most in ((0.0, 1.0, 1.0), (0.03, 0.0, 0.8)):
        given = Conditions(speeds=(1.5, 5.0), friction=0.5, motor_lag=lag, wind=1.0)
        found = link_loss.ride(who, plant, given, link_loss.UNDAMPED, 100, seed=3)
        assert fewest <= found.share <= most


def test_law_steers_into_the_lean_and_ends_at_the_stable_speed() -> None:
    roll, steer = np.array([0.1, 0.1, 5.0, 0.1]), np.array([0.0, 0.2, 0.0, 1.0])
    torque = link_loss.fallback(roll, np.array([2.0, 5.0, 2.0, 8.0]), 7.0, steer)
    assert torque == pytest.approx([4.0, 0.7, 7.0, 0.0])


def test_command_tells_all_laws(capsys: pytest.CaptureFixture[str]) -> None:
    words = "sensing lqr --link-loss --bicycles steer-by-wire --episodes 10 --speeds 2,4 --json"
    assert main(words.split()) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"command", "commit", "processor"} <= found.keys()
    assert found["conditions"]["speeds"] == [2.0, 4.0]
    rows = found["rows"]
    assert [row["law"] for row in rows] == list(link_loss.LAWS)
    assert rows[0]["upright"] == rows[0]["rides"] == 10
