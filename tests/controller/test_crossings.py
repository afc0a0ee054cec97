"""Bicycles, not points, keep clear at crossings."""

from __future__ import annotations

import pytest

from bicycle_controller.evaluation import crossings
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import named

GOALS = named("random-start-random-goal")


def test_no_collision_where_blind_ones_collide() -> None:
    found = crossings.score(registry.named(plant="whipple", bicycle="browser-rider"), 60, seed=3)
    assert found["below_1_m"] == found["falls"] == 0
    assert found["below_1_m_blind"] > 10
    assert "60 crossings: nearest" in crossings.as_text(found)


def test_a_number_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="choose 1 to"):
        crossings.score(registry.default(), 0)


def test_riders_to_goals_and_by_cmd_vel_keep_clear_too() -> None:
    policy = load_controller("learned-speed")
    found = [
        crossings.score(registry.default(), 40, 3, "cmd_vel"),
        crossings.score(registry.default(), 40, 3, "lqr", load_controller("lqr"), GOALS),
        crossings.score(
            registry.default(), 40, 3, "learned-speed", policy, named("learned-speed")
        ),
    ]
    for one in found:
        assert one["below_1_m"] == one["falls"] == one["falls_blind"] == 0, one
        assert one["below_1_m_blind"] > 10, one
    assert [one["rider"] for one in found] == ["cmd_vel", "lqr", "learned-speed"]
