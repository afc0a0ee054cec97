"""The same start, goals and pushes, ridden by another controller."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_bag import write_bag

from bicycle_bag.errors import BagError
from bicycle_cockpit.bags import session
from bicycle_cockpit.policy_catalogue import file_title
from bicycle_cockpit.same_ride import same_ride

RIDE = Path(__file__).resolve().parents[1] / "data" / "film-ride"
PUSHED = 343
"""Step with the first push, after which the bag's safety layer takes over for a while."""


def table(ride: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return a ride's columns by name."""
    numbers = (np.array(column, dtype=np.float64) for column in ride["data"])
    return dict(zip(ride["columns"], numbers, strict=True))


def times_of(ride: dict[str, Any], kind: str) -> list[float]:
    """The times of a kind of events, s."""
    return [mark["t"] for mark in ride["marks"] if mark["kind"] == kind]


def test_the_policy_that_rode_does_the_same_again_pushes_included() -> None:
    recorded = session(RIDE)
    again = same_ride(RIDE, "fixed-speed")
    was, now = table(recorded), table(again)
    assert (
        times_of(again, "push")[0]
        == times_of(recorded, "push")[0]
        == pytest.approx(PUSHED * 0.025)
    )
    alike = round(times_of(recorded, "hand_over")[0] / 0.025) + 1
    assert alike == PUSHED + 2, "the state after the push is still its own"
    for name in ("x", "y", "heading", "lean", "steer", "torque", "displacement"):
        assert now[name][:alike] == pytest.approx(was[name][:alike], abs=2e-4, nan_ok=True)


def test_another_controller_rides_to_the_same_goals_in_its_own_time() -> None:
    recorded = session(RIDE)
    again = same_ride(RIDE, "lqr")
    goals = [(m["x"], m["y"]) for m in recorded["marks"] if m["kind"] == "active"]
    assert [(m["x"], m["y"]) for m in again["marks"] if m["kind"] == "active"] == goals
    assert len(times_of(again, "reached")) == len(goals)
    assert times_of(again, "reached") != times_of(recorded, "reached")
    assert [one["label"] for one in again["riders"]] == ["LQR"]
    assert again["misfit"] == ""
    starts = [(one["x"][0], one["y"][0]) for one in map(table, (recorded, again))]
    assert starts[0] == pytest.approx(starts[1])


def test_who_was_made_for_another_ride_is_told() -> None:
    assert "plant choi, not whipple" in same_ride(RIDE, "any-bicycle")["misfit"]
    assert same_ride(RIDE, "fixed-speed")["misfit"] == ""


def test_what_cannot_be_ridden_again_is_told(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no-such-policy cannot ride it"):
        same_ride(RIDE, "no-such-policy")


def test_a_fall_ends_it(tmp_path: Path) -> None:
    # The bag by hand has a push of 0.3 rad/s at 1 s, at 2 m/s, which is too slow for this actor.
    again = same_ride(write_bag(tmp_path / "bag"), "fixed-speed")
    assert len(times_of(again, "fell")) == 1
    assert again["marks"][-1]["kind"] == "fell"
    assert again["duration"] == pytest.approx(times_of(again, "fell")[0])


def test_a_policy_file_has_the_name_of_its_run() -> None:
    assert file_title(Path("runs/mine/best.safetensors")) == "mine"
    kept = Path("runs/mine/policies/00001500.safetensors")
    assert file_title(kept) == "mine after 1,500 updates"
    assert file_title(Path("tuned.safetensors")) == "tuned"
    assert file_title(Path("lqr")) == "lqr"
