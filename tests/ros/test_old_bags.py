"""Bags of earlier releases: today's code reads them, proves them and replays them."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from bicycle_msgs.msg import BicycleState, CommandEcho
from node_process import NodeProcess
from rclpy.serialization import deserialize_message, serialize_message

from bicycle_bag import messages
from bicycle_bag.columns import load_topics
from bicycle_bag.nodes.session import message_class
from bicycle_bag.reader import BagReader
from bicycle_bag.versions import ECHO, TodaysReader
from bicycle_cockpit.bags import session
from bicycle_controller.data.bag_transitions import (
    COMMAND,
    GOAL_STATUS,
    STATE,
    TRANSITION,
    built,
    extract,
)
from bicycle_controller.data.dataset import load as load_dataset
from bicycle_tools.nodes import ride_recording, verify_states
from bicycle_tools.report_page.loading import load
from bicycle_tools.ride_log import read_ride

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[2]
BAGS = sorted(path.parent for path in (ROOT / "tests" / "data").glob("*/metadata.yaml"))
DEFINITIONS = sorted((ROOT / "bicycle_msgs").glob("[ms][sr][gv]/*.[ms][sr][gv]"))
Start = Callable[..., NodeProcess]


@pytest.fixture(params=BAGS, ids=lambda path: path.name)
def old(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


def test_there_is_an_old_bag() -> None:
    names = {path.name for path in BAGS}
    assert names >= {
        *("ride-0.1.0", "ride-state-2", "whipple-state-2"),
        *("ride-state-4", "estimated-1"),
    }


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda path: path.name)
def test_every_definition_says_its_version(path: Path) -> None:
    comments = re.match(r"(#.*\n)+", path.read_text())
    assert comments is not None
    assert re.search(r"\bVersion \d+\.", comments[0]), path


def test_todays_messages_still_hold_what_it_says(old: Path) -> None:
    """Today's class reads what the definition in the bag says."""
    reader, today = BagReader(old), TodaysReader(old)
    decoded = 0
    pairs = zip(messages.read(reader), today.messages(reader.topics), strict=True)
    for by_bag, raw in pairs:
        by_class = deserialize_message(raw.data, message_class(raw.type))
        for name in by_class.get_fields_and_field_types():
            if not hasattr(by_bag.message, name):
                continue
            then, now = getattr(by_bag.message, name), getattr(by_class, name)
            if isinstance(now, (bool, int, str)) or (isinstance(now, float) and now == now):
                assert then == now, (raw.topic, name)
        decoded += 1
    assert decoded == reader.message_count > 100


def test_its_states_echo_their_commands(old: Path) -> None:
    """Each state is played after the command that led to it, whole, as it was recorded."""
    given = {}
    for item in messages.read(old, [COMMAND]):
        given[item.message.episode, item.message.step] = item.message
    *_, driven = _echoes(old)
    assert len(driven) > 70
    for echo, state in driven:
        assert (echo.episode, echo.step) == (state.episode, state.step)
        sent = given[echo.command.episode, echo.command.step]
        for name in ("torque", "pedal_force", "has_goal", "goal_id", "controller", "policy"):
            assert getattr(echo.command, name) == getattr(sent, name), name
        assert echo.command.goal.x == sent.goal.x


def _echoes(path: Path) -> list[list[tuple[CommandEcho, BicycleState]]]:
    """Echoes with the states after them: of starts, and of steps under a command."""
    found: list[list[tuple[CommandEcho, BicycleState]]] = [[], []]
    echo = None
    for item in TodaysReader(path).messages([ECHO, STATE]):
        if item.topic == ECHO:
            assert echo is None
            echo = deserialize_message(item.data, CommandEcho)
            continue
        assert echo is not None
        pair = echo, deserialize_message(item.data, BicycleState)
        found[echo.command_source == CommandEcho.SOURCE_FRESH].append(pair)
        echo = None
    return found


def test_its_states_come_out_again(old: Path) -> None:
    """States are equal to the bit on the recording processor's kind, else but for rounding."""
    (*_, verdict) = verify_states.verify(ride_recording.read(old))
    assert verdict.same, verdict
    assert verdict.largest < 1e-12
    assert verdict.checked + verdict.begun == len(read_ride(old).states["step"])


@pytest.mark.parametrize(
    ("apart", "rounding"),
    [(1e-15, True), (1e-11, True), (1e-8, False), (1e-6, False), (5e-4, False)],
)
def test_rounding_is_told_from_a_difference(old: Path, apart: float, rounding: bool) -> None:
    """Rounding differs by 1e-12 at most; a tolerance that is widened lets differences in."""
    recording = ride_recording.read(old)
    time_ns, data = recording.states[40]
    state = deserialize_message(data, BicycleState)
    state.lean_rate += apart
    recording.states[40] = time_ns, serialize_message(state)
    (*_, verdict) = verify_states.verify(recording)
    assert not verdict.proved
    assert verdict.same == rounding
    if rounding:
        assert verdict.rounded > 0
        assert "as another kind of processor rounds" in str(verdict)
    else:
        assert f"step {state.step} of episode 1: lean_rate" in verdict.difference


def test_it_is_played(old: Path, start_node: Start) -> None:
    player = start_node(ROOT / "ros2_ws" / "replay.sh", [old, "--rate", "8"])
    assert player.wait() == 0, player.output
    assert f"played {TodaysReader(old).message_count} messages" in player.lines[-1]


def test_it_teaches(old: Path) -> None:
    """The transitions that the simulator published then are what its states and commands give."""
    reader = BagReader(old)
    scenario = load_dataset([old]).scenario
    kept = extract(reader, "", scenario).transitions if TRANSITION in reader.topics else None
    columns = load_topics(reader, [STATE, COMMAND, GOAL_STATUS])
    transitions, lost = built(columns[STATE], {}, columns[COMMAND], columns[GOAL_STATUS], scenario)
    assert lost == {"states": 0, "commands": 0}
    assert len(transitions) > 70
    if kept is None:
        return
    for name in ("episode", "step", "terminated", "fallen", "policy"):
        assert np.array_equal(getattr(kept, name), getattr(transitions, name)[: len(kept)]), name
    for name in ("observation", "action", "reward", "next_observation"):
        # On another kind of processor than the recorder's, the last bits differ.
        np.testing.assert_allclose(
            getattr(transitions, name)[: len(kept)], getattr(kept, name), rtol=1e-12, atol=1e-12
        )


def test_it_opens_in_the_cockpit(old: Path) -> None:
    page = session(old)
    columns = dict(zip(page["columns"], page["data"], strict=True))
    assert {0.0, 1.0} <= set(columns["source"]) <= {0.0, 1.0, 2.0}
    left = [value for value in columns["goal_distance"] if value is not None]
    assert len(left) > 70
    assert all(before != after for before, after in pairwise(left))


def test_it_is_reported(old: Path) -> None:
    page = load(old, old.name)
    assert page.has_states
    assert not [note for note in page.notes if "not whole" in note]
