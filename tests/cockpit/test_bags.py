"""A bag's ride as the page gets it, and the controllers that a page may choose from."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from clocks import CLOCKS, with_clock
from made_bag import PERIOD, STEPS, write_bag

from bicycle_cockpit import bags
from bicycle_cockpit.bags import session
from bicycle_cockpit.followed_paths import MOST_POINTS
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_controller.policy.policy import load_policy, save_policy


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("made") / "bag")


def test_a_ride_as_the_page_gets_it(bag: Path) -> None:
    data = session(bag)
    json.dumps(data, allow_nan=False)
    columns = dict(zip(data["columns"], data["data"], strict=True))
    assert columns["t"][:STEPS] == pytest.approx([0.025 * step for step in range(STEPS)])
    assert columns["x"][STEPS - 1] == pytest.approx(0.05 * (STEPS - 1))
    assert columns["goal_distance"] == [None] * (STEPS + 1)
    assert columns["torque"][0] is None, "the first command came after the first state"
    assert columns["torque"][50] == pytest.approx(0.49)
    assert data["duration"] == pytest.approx(0.025 * (STEPS - 1))
    assert [one["name"] for one in data["riders"]] == ["first", "naf"]
    assert columns["policy"][0] is None
    assert (columns["policy"][100], columns["policy"][101]) == (0.0, 1.0)


def test_the_estimate_of_a_step_stands_beside_its_truth(tmp_path: Path, bag: Path) -> None:
    data = session(write_bag(tmp_path / "bag", estimated=True))
    columns = dict(zip(data["columns"], data["data"], strict=True))
    first = STEPS // 5
    assert columns["est_lean"][first - 1 : first + 1] == [None, 0.1]
    assert columns["est_x"][first] == columns["x"][first]
    assert columns["est_y"][first] == 0.2
    assert columns["est_t"] == columns["t"]
    assert columns["est_lean"][STEPS] is None, "the episode after the reset has no estimate"
    without = session(bag)
    assert set(without["data"][without["columns"].index("est_lean")]) == {None}


def test_marks_are_where_it_happened_also_beside_a_reset(bag: Path) -> None:
    marks = {mark["kind"]: mark for mark in session(bag)["marks"]}
    push, goal, fell = marks["push"], marks["reached"], marks["fell"]
    assert push["text"] == "pushed to the left, 0.30 rad/s"
    assert (push["t"], push["x"]) == (pytest.approx(1.0), pytest.approx(2.0))
    assert (goal["x"], goal["t"]) == (8.0, pytest.approx(4.0))
    assert goal["text"] == "goal (8.0, 0.0) reached after 4.0 s"
    # The state after the reset has the same time as the one in which it fell.
    assert fell["t"] == marks["reset"]["t"] == pytest.approx((STEPS - 1) * PERIOD * 1e-9)
    assert fell["x"] == pytest.approx(0.05 * (STEPS - 1))
    assert marks["reset"]["x"] == 0.0


def test_the_hand_over_says_who_took_over_and_why(bag: Path) -> None:
    (mark,) = [mark for mark in session(bag)["marks"] if mark["kind"] == "hand_over"]
    assert mark["text"] == (
        "LQR takes over: it leaned too fast (lean rate 34.4°/s is beyond 28.6°/s)"
    )
    assert (mark["level"], mark["x"]) == ("warn", pytest.approx(7.5))


def test_a_goal_has_the_heading_of_arrival_that_was_asked_for(tmp_path: Path, bag: Path) -> None:
    (found,) = session(write_bag(tmp_path / "bag", arrival=1.25))["arrivals"]
    assert found == {"t": pytest.approx(0.75), "x": 8.0, "y": 0.0, "heading": 1.25}
    assert session(bag)["arrivals"] == []


def test_a_followed_path_has_its_times_and_its_end(tmp_path: Path, bag: Path) -> None:
    (path,) = session(write_bag(tmp_path / "bag", course=True))["paths"]
    assert (path["from"], path["to"]) == (pytest.approx(1.0), pytest.approx(3.0))
    assert len(path["points"]) <= MOST_POINTS
    assert path["points"][0] == [0.0, 1.0]
    assert path["points"][-1] == [20.0, 1.0]
    assert session(bag)["paths"] == []


def test_a_goal_that_is_active_already_is_not_told_again(bag: Path) -> None:
    texts = [mark["text"] for mark in session(bag)["marks"] if mark["kind"] == "active"]
    assert texts == ["rides to goal (8.0, 0.0): 8.0 m to go"]


def test_a_long_one_is_thinned_evenly(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bags, "MOST_ROWS", 60)
    steps = session(bag)["data"][2]
    assert steps == [*range(0, STEPS, 4), 0]


def test_a_page_can_name_only_the_controllers_it_was_offered(tmp_path: Path) -> None:
    policy = load_policy()
    for path in ("loose.safetensors", "mine/best.safetensors", "tuned/2/best.safetensors"):
        save_policy(policy, tmp_path / path)
    choices = PolicyCatalogue(tmp_path)
    offered = {one["name"]: one["group"] for one in choices.offered()}
    assert {offered[name] for name in ("fixed-speed", "naf", "ppo")} == {"shipped"}
    assert offered["lqr"] == "classical"
    assert {"loose", "mine", "tuned/2"} == {k for k, v in offered.items() if v == "trained here"}
    save_policy(policy, tmp_path / "mine" / "policies" / "00000500.safetensors")
    labels = {one["name"]: one["label"] for one in choices.offered()}
    assert labels["mine/policies/00000500"] == "mine after 500 updates"
    assert choices.path("mine") == str(tmp_path / "mine" / "best.safetensors")
    assert choices.path("lqr") == "lqr"
    for name in ("../mine", str(tmp_path / "loose.safetensors"), "nobody"):
        with pytest.raises(KeyError):
            choices.path(name)


@pytest.mark.parametrize("publishers", [False, True])
@pytest.mark.parametrize("name", CLOCKS)
def test_the_recordings_clock_does_not_matter(
    bag: Path, tmp_path: Path, name: str, publishers: bool
) -> None:
    """Set back, set ahead, standing still: the page draws the same ride."""
    assert session(with_clock(bag, tmp_path / "bag", CLOCKS[name], publishers)) == session(bag)
