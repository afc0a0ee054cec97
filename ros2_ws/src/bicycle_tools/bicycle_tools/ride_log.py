"""Data of a bag for a summary, a picture and a verification, as numpy columns."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_bag import messages
from bicycle_bag.columns import load_topics
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader
from bicycle_bag.steps import steps
from bicycle_common import topic_names
from bicycle_tools.recorded_here import driving, goals_of_recording, sent_before

Columns = Mapping[str, NDArray[Any]]
"""One array per field of a message, one row per message, in recorded order."""

STATE = topic_names.in_bag(topic_names.STATE)
COMMAND = topic_names.in_bag(topic_names.COMMAND)
ECHO = topic_names.in_bag(topic_names.COMMAND_ECHO)
TIMING = topic_names.in_bag(topic_names.TIMING)
GOAL_STATUS = topic_names.in_bag(topic_names.GOAL_STATUS)
EPISODE = topic_names.in_bag(topic_names.EPISODE)
PATH_STATUS = topic_names.in_bag(topic_names.PATH_STATUS)
PATH = topic_names.in_bag(topic_names.FOLLOWED_PATH)
ESTIMATE = topic_names.in_bag(topic_names.ESTIMATE)
PUSHED = topic_names.in_bag(topic_names.PUSHED)
HAND_OVER = topic_names.in_bag(topic_names.HAND_OVER)
ACTIVE_GOAL = topic_names.in_bag(topic_names.ACTIVE_GOAL)
EXPECTED = (STATE, COMMAND, ECHO, TIMING, GOAL_STATUS, EPISODE)
"""Topics that every whole ride has."""
READ = (*EXPECTED, PATH_STATUS, ESTIMATE, PUSHED, HAND_OVER, ACTIVE_GOAL)
"""Topics of a ride, in the bicycle's namespace."""
RIDDEN = (STATE, COMMAND, TIMING)
"""Topics that are not latched: a bag without any of them contains no ride."""


@dataclass(frozen=True)
class RideLog:
    """One bicycle's messages of a bag."""

    path: Path
    states: Columns
    """BicycleState; each step once, see `distinct`; with the command that led to it, see
    `bicycle_bag.steps`."""
    commands: Columns
    """BicycleCommand; without answers of a controller that ran beside the driving one."""
    timing: Columns
    statuses: Columns
    """GoalStatus, of the goals of this recording alone; see `goals_of_recording`."""
    episodes: Columns
    segment: NDArray[np.intp]
    """(n,) of `states`: number of the unbroken ride of each, from 0; a reset begins the next."""
    message_count: int
    """Number of messages of all topics of the bag."""
    idle_commands: int = 0
    """Number of commands of controllers that ran beside the driving one."""
    path_statuses: Columns = field(default_factory=dict)
    """PathStatus."""
    paths: tuple[NDArray[np.float64], ...] = ()
    """Followed paths, (n, 2) m each."""
    path_orders: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """(n,) of `paths`: the place of each in the bag among all its messages."""
    estimates: Columns = field(default_factory=dict)
    """BicycleState of an estimator; empty where the controller saw the truth."""
    pushes: Columns = field(default_factory=dict)
    """Push."""
    hand_overs: Columns = field(default_factory=dict)
    """HandOver, of this recording alone."""
    active_goals: Columns = field(default_factory=dict)
    """PoseStamped, each goal as it became active; see `bicycle_common.arrival`."""
    old_statuses: int = 0
    """Number of goal statuses from before the recording, about goals that were over by then."""


def read_ride(path: Path | str) -> RideLog:
    """Read one bicycle's ride from a bag.

    Args:
        path: bag directory or MCAP file.

    Raises:
        BagError: if it cannot be read, or holds no bicycle or more than one.
    """
    reader = BagReader(path)
    return load_ride(reader, prefix_of(reader))


def load_ride(reader: BagReader, prefix: str) -> RideLog:
    """Load one bicycle's ride from an open bag, with any subset of its topics.

    Args:
        reader: the bag.
        prefix: namespace of the bicycle, such as "" or "/red".

    Raises:
        BagError: if the bag's messages of them cannot be read.
    """
    there = [name for name in READ if prefix + name in reader.topics]
    loaded = load_topics(reader, [prefix + name for name in there])
    columns = {name: loaded[prefix + name] if name in there else {} for name in READ}
    states, segment = distinct(columns[STATE]) if columns[STATE] else _no_states()
    commands, recorded_statuses = columns[COMMAND], columns[GOAL_STATUS]
    if columns[STATE]:
        states = steps(dict(states), dict(columns[ECHO]), dict(commands))
    drove = driving(commands, states)
    statuses = goals_of_recording(recorded_statuses, begun(reader), commands)
    return RideLog(
        path=reader.path,
        states=states,
        commands={name: column[drove] for name, column in commands.items()},
        timing=columns[TIMING],
        statuses=statuses,
        episodes=columns[EPISODE],
        segment=segment,
        message_count=reader.message_count,
        idle_commands=int((~drove).sum()),
        path_statuses=columns[PATH_STATUS],
        paths=_paths(reader, prefix + PATH),
        path_orders=_places(reader, prefix + PATH),
        estimates=columns[ESTIMATE],
        pushes=columns[PUSHED],
        hand_overs=_of_recording(columns[HAND_OVER], begun(reader), commands),
        active_goals=columns[ACTIVE_GOAL],
        old_statuses=len(recorded_statuses.get("status", ())) - len(statuses.get("status", ())),
    )


def _of_recording(changes: Columns, since: float, commands: Columns) -> Columns:
    """Return messages of a latched topic without those from before the recording."""
    if not len(changes.get("log_time", ())):
        return changes
    kept = ~sent_before(changes, since, commands)
    return {name: column[kept] for name, column in changes.items()}


def _paths(reader: BagReader, topic: str) -> tuple[NDArray[np.float64], ...]:
    """Return the paths of a topic, where the bag has it."""
    if topic not in reader.topics:
        return ()
    found = []
    for one in messages.read(reader, [topic]):
        places = [pose.pose.position for pose in one.message.poses]
        found.append(np.array([(place.x, place.y) for place in places]).reshape(-1, 2))
    return tuple(found)


def _places(reader: BagReader, topic: str) -> NDArray[np.int64]:
    """Return the places of a topic's messages in the bag, where the bag has it."""
    found = reader.messages([topic]) if topic in reader.topics else ()
    return np.array([message.number for message in found], dtype=np.int64)


def begun(reader: BagReader) -> float:
    """Return the log time of the first recorded message, s; clocks may be set back later."""
    first = next(iter(reader.messages()), None)
    return first.log_time_ns * 1e-9 if first is not None else 0.0


def _no_states() -> tuple[Columns, NDArray[np.intp]]:
    """Return empty columns of any name, and their segments."""
    return defaultdict(lambda: np.empty(0)), np.empty(0, dtype=np.intp)


def prefix_of(reader: BagReader) -> str:
    """Return the namespace of the bag's bicycle, such as "" or "/red"."""
    found = [name[: -len(STATE)] for name in reader.topics if name.endswith(STATE)]
    if not found:
        raise no_bicycle(reader)
    if len(found) > 1:
        raise BagError(f"{reader.path} holds {len(found)} bicycles: record one at a time")
    return found[0]


def no_bicycle(reader: BagReader) -> BagError:
    """Return the error for a bag in which no bicycle was recorded."""
    return BagError(
        f"{reader.path} holds no bicycle: nothing was recorded of {STATE}; name a bag of record.sh"
    )


BODY = ("rear_contact.x", "rear_contact.y", "heading", "speed")
"""Columns that tell two starts apart."""


def distinct(states: Columns) -> tuple[Columns, NDArray[np.intp]]:
    """Return each step once; a state is published again while the bicycle is held.

    Args:
        states: columns of BicycleState with `episode` and `step`.

    Returns:
        The columns without repetitions, and for each row the number of its segment: a new one
        begins where the episode changes, the step goes back (the simulator was started anew), or
        another place or speed has the same step (the one before had only stood at its start).
    """
    episode = states["episode"].astype(np.int64)
    step = states["step"].astype(np.int64)
    begins = np.ones(len(step), dtype=bool)
    body = [states[name] for name in BODY if name in states]
    moved = np.any([column[1:] != column[:-1] for column in body], axis=0) if body else False
    begins[1:] = (np.diff(episode) != 0) | (np.diff(step) < 0) | ((np.diff(step) == 0) & moved)
    repeats = np.zeros(len(step), dtype=bool)
    repeats[1:] = ~begins[1:] & (np.diff(step) == 0)
    kept = {name: column[~repeats] for name, column in states.items()}
    return kept, (np.cumsum(begins) - 1)[~repeats]
