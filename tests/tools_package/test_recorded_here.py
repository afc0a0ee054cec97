"""Messages in a bag from before its start, whatever clocks did, and its drivers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bicycle_tools.recorded_here import driving, goals_of_recording, sent_before

QUEUED, ACTIVE, REACHED = 0, 1, 2
BEGUN = 1000.0


def messages(*times: tuple[float, float]) -> dict[str, Any]:
    """Columns of messages that were sent and received at these times, s."""
    sent, received = np.array(times, dtype=np.float64).reshape(-1, 2).T
    return {"publish_time": sent, "log_time": received, "header.stamp": sent}


def statuses(*rows: tuple[int, int, float, float]) -> dict[str, Any]:
    """Goal, status, time of sending and of receiving, s."""
    return {
        **messages(*((row[2], row[3]) for row in rows)),
        "goal_id": np.array([row[0] for row in rows]),
        "status": np.array([row[1] for row in rows]),
        "position.x": np.array([float(row[0]) for row in rows]),
        "position.y": np.zeros(len(rows)),
    }


@pytest.mark.parametrize(
    ("what", "sent", "received", "early"),
    [
        ("live", 1005.0, 1005.001, False),
        ("latched, heard at the start", 990.0, 1000.0, True),
        ("latched, heard later", 990.0, 1007.0, True),
        ("the first message, live on a busy machine", 999.95, 1000.0, False),
        ("live, heard late by a recorder that was held up", 1003.0, 1008.0, False),
        ("live, after the clock was set back by an hour", -2600.0, -2599.999, False),
        ("latched, before the clock was set back by an hour", 4590.0, 1000.0, True),
    ],
)
def test_what_was_sent_before_a_recording_is_told_from_its_times(
    what: str, sent: float, received: float, early: bool
) -> None:
    commands = messages((1000.0, 1000.001), (1001.0, 1001.001))
    found = sent_before(messages((sent, received)), BEGUN, commands)
    assert found.tolist() == [early], what


def test_a_controller_whose_clock_is_off_is_believed_less_its_error() -> None:
    commands = messages((900.0, 1000.0), (901.0, 1001.0))
    found = sent_before(messages((902.0, 1002.0), (890.0, 1000.0)), BEGUN, commands)
    assert found.tolist() == [False, True]


def test_a_bag_without_times_of_sending_goes_by_the_messages_stamps() -> None:
    statuses_sent = messages((990.0, 1000.0), (1002.0, 1002.001))
    commands = messages((1000.0, 1000.001), (1001.0, 1001.001))
    for columns in (statuses_sent, commands):
        columns["publish_time"] = columns["log_time"]
    assert sent_before(statuses_sent, BEGUN, commands).tolist() == [True, False]
    # Stamps of simulated time in lock-step say nothing.
    commands["header.stamp"] = np.array([1.0, 90.0])
    assert sent_before(statuses_sent, BEGUN, commands).tolist() == [False, False]
    assert sent_before(statuses_sent, BEGUN, {}).tolist() == [False, False]


def test_goals_that_were_over_are_dropped_and_those_under_way_stay() -> None:
    statuses_sent = statuses(
        (1, ACTIVE, 980.0, 1000.0),
        (1, REACHED, 985.0, 1000.0),
        (3, QUEUED, 986.0, 1000.0),
        (2, ACTIVE, 987.0, 1000.0),
        (2, REACHED, 1004.0, 1004.0),
        (3, ACTIVE, 1004.0, 1004.0),
        (3, ACTIVE, 1004.0, 1006.0),  # heard again by a recorder that subscribed anew
    )
    found = goals_of_recording(statuses_sent, BEGUN, messages((1001.0, 1001.0)))
    assert list(zip(found["goal_id"], found["status"], found["before"], strict=True)) == [
        (3, QUEUED, True),
        (2, ACTIVE, True),
        (2, REACHED, False),
        (3, ACTIVE, False),
    ]
    assert goals_of_recording({}, BEGUN, {}) == {}


def test_the_controller_that_a_state_names_drove() -> None:
    states = {
        "episode": np.ones(4, int),
        "step": np.arange(4),
        "controller": np.array(["", "a", "a", "b"], dtype=object),
    }
    commands = {
        "episode": np.ones(7, int),
        "step": np.array([0, 0, 1, 1, 2, 2, 3]),
        "controller": np.array(["a", "b", "a", "b", "a", "b", "a"], dtype=object),
    }
    assert driving(commands, states).tolist() == [True, False, True, False, False, True, True]
    assert driving({}, states).tolist() == []
