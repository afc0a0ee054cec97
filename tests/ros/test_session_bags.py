"""Bags that begin in mid-session: what a report and the cockpit say of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess
from test_scripts import script

from bicycle_bag.reader import BagReader
from bicycle_cockpit.bags import session
from bicycle_tools.report_page.loading import load

pytestmark = pytest.mark.ros

Start = Callable[..., NodeProcess]
WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"


def test_the_report_and_the_cockpit_count_only_goals_of_the_recording(
    start_node: Start, tmp_path: Path
) -> None:
    """Two goals before the recording, one that is under way when it begins, one during it."""
    start_node(WORKSPACE / "sim.sh", ["pace:=lockstep"]).wait_for_line("waits for its")
    # Straight on, lock-step would take it miles away while a busy machine starts the next script.
    words = ["policy:=lqr", "after_goal:=circle"]
    start_node(WORKSPACE / "controller.sh", words).wait_for_line("waits for a goal")
    for place in ((12, -3), (30, -3)):
        assert script("goal", *place, "--wait").returncode == 0
    assert script("goal", 900, 30).returncode == 0
    recorder = start_node(WORKSPACE / "record.sh", ["--output", tmp_path / "ride"])
    recorder.wait_for_line("recording /bicycle/goal_status")
    last = (round(place_of_bicycle() + 60.0), -3.0)
    assert script("goal", *last, "--wait").returncode == 0
    assert recorder.stop() == 0, recorder.output
    bag = tmp_path / "ride"
    assert BagReader(bag).counts["/bicycle/goal_status"] >= 6, "latched ones too"
    page = load(bag, "ride")
    found = [(goal.position, goal.status.name) for goal in page.outcomes]
    assert found == [((900.0, 30.0), "REPLACED"), (last, "REACHED")]
    assert [goal.begun_before for goal in page.outcomes] == [True, False]
    marks = [mark for mark in session(bag)["marks"] if mark["kind"] in ("active", "reached")]
    assert {(mark["x"], mark["y"]) for mark in marks} == {(900.0, 30.0), last}
    done = script("report", bag)
    assert done.returncode == 0, done.stderr
    assert "1 of 2 goals reached" in Path(done.stdout.strip()).read_text()


def place_of_bicycle() -> float:
    """m, x of the rear contact."""
    done = script("topic", "echo", "bicycle/state", "--once", "--field", "rear_contact.x")
    return float(done.stdout.splitlines()[0].partition(": ")[2])
