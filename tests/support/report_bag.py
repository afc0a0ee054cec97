"""A short made-up ride as a real bag, with all that a report can show: a fall, a reset, a stop."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from clocks import CLOCKS, with_clock
from ride_bag import PERIOD_NS, START_NS, schemas, serialise

from bicycle_bag.metadata import Topic
from bicycle_bag.writer import BagWriter

__all__ = ["CLOCKS", "with_clock"]

TYPES = {
    "/bicycle/state": "BicycleState",
    "/bicycle/command": "BicycleCommand",
    "/bicycle/command_echo": "CommandEcho",
    "/bicycle/timing": "LoopTiming",
    "/bicycle/goal_status": "GoalStatus",
    "/bicycle/episode": "EpisodeInfo",
}
STEPS = 200
"""Steps of each of the two episodes; the first ends with a fall 10 steps before."""
FELL_AT = STEPS - 10
WATCHDOG = range(50, 60)
EVIL = '<script>alert("x")</script>'
"""The second policy's id: what comes from a bag must never become a part of the page."""
Message = tuple[str, dict[str, Any], int, int]
SentStatus = tuple[int, int, float, float]
"""Goal, its status, s after the start of the bag when that was sent, and when received."""


def messages(
    statuses: Sequence[SentStatus] | None = None, late_from: int = 0
) -> Iterator[Message]:
    """Yield topic, fields, ns since the start at which it was received and was sent."""
    for name, fields, received in _ride(late_from):
        if statuses is None or name != "/bicycle/goal_status":
            yield name, fields, received, received
    for goal, status, sent_s, received_s in statuses or ():
        ridden = _status(goal, status, 0.0 if status == 1 else 9.9)
        yield "/bicycle/goal_status", ridden, round(1e9 * received_s), round(1e9 * sent_s)


def _ride(late_from: int) -> Iterator[tuple[str, dict[str, Any], int]]:
    count = 0
    for episode in (1, 2):
        info = {"episode": episode, "seed": 7, "pace": "realtime", "version": "0.1.0"}
        yield "/bicycle/episode", {**info, "scenario": '{"name": "made-up"}'}, count * PERIOD_NS
        yield "/bicycle/goal_status", _status(episode, 1, 0.0), count * PERIOD_NS + 1
        for step in range(STEPS):
            now = count * PERIOD_NS
            yield "/bicycle/command_echo", _echo(episode, step), now + 2
            yield "/bicycle/state", _state(episode, step, count), now + 2
            yield "/bicycle/command", _command(episode, step), now + 3
            if step:
                late = {"late_steps": late_from}
                yield "/bicycle/timing", _timing(episode, step) | late, now + 4
            count += 1
        end = 6 if episode == 1 else 2
        yield "/bicycle/goal_status", _status(episode, end, 9.9), count * PERIOD_NS + 5
    rejected = {"status": 7, "message": "its frame is 'moon'"}
    yield "/bicycle/goal_status", rejected, count * PERIOD_NS + 6


def _state(episode: int, step: int, count: int) -> dict[str, Any]:
    now = count * PERIOD_NS
    return {
        "header": {"stamp": {"sec": now // 10**9, "nanosec": now % 10**9}},
        "episode": episode,
        "step": step,
        "lean_angle": 0.1,
        "speed": 2.0,
        "rear_contact": {"x": 0.05 * step, "y": float(episode)},
        "fallen": episode == 1 and step >= FELL_AT,
    }


def _echo(episode: int, step: int) -> dict[str, Any]:
    """The command that led to a state: none at the start and in the watchdog's time."""
    silent = episode == 2 and step in WATCHDOG
    given = step and not silent
    return {
        "episode": episode,
        "step": step,
        "command_source": 3 if silent else 1 if given else 0,
        "command": _command(episode, step - 1) if given else {},
    }


def _command(episode: int, step: int) -> dict[str, Any]:
    policy = "lqr-1" if episode == 1 else EVIL
    place = {"x": 10.0, "y": float(episode)}
    given = {"torque": 0.5, "controller": "c", "policy": policy, "has_goal": True, "goal": place}
    return {"episode": episode, "step": step, **given}


def _timing(episode: int, step: int) -> dict[str, Any]:
    timing = {"episode": episode, "step": step, "latency": 0.004, "lateness": 0.001}
    return {**timing, "period": 0.025 if step % 2 else 0.026}


def _status(goal: int, status: int, path: float) -> dict[str, Any]:
    return {
        "goal_id": goal,
        "status": status,
        "position": {"x": 10.0, "y": float(goal)},
        "distance": 10.0 if status == 1 else 1.0,
        "path_length": path,
        "elapsed": 0.5 * path,
    }


def write(
    path: Path,
    leave_out: Collection[str] = (),
    namespaces: Collection[str] = ("",),
    statuses: Sequence[SentStatus] | None = None,
    late_from: int = 0,
    second_controller: bool = False,
    change: Callable[[str, dict[str, Any]], dict[str, Any]] = lambda _, fields: fields,
    **options: Any,
) -> Path:
    """Record the ride at `path`, but for some topics, once in each namespace.

    Args:
        path: of the bag.
        leave_out: topics.
        namespaces: of the bicycles.
        told: goal statuses in place of the ride's own.
        late_from: steps that were late before the recording.
        second_controller: True if another one answers each state, too.
        change: gives the fields of a message, by its topic and the fields that it would have.
        options: of the writer.
    """
    with BagWriter(path, **options) as writer:
        for prefix in namespaces:
            for name, short in TYPES.items():
                if name not in leave_out:
                    kind = f"bicycle_msgs/msg/{short}"
                    writer.add_topic(Topic(prefix + name, kind), schemas().definition(kind))
        for name, fields, received, sent in messages(statuses, late_from):
            for prefix in namespaces:
                if name not in leave_out:
                    data = serialise(TYPES[name], change(name, fields))
                    writer.write(prefix + name, data, START_NS + received, START_NS + sent)
            if second_controller and name == "/bicycle/command":
                data = serialise(TYPES[name], fields | {"controller": "d", "policy": "idle"})
                writer.write(name, data, START_NS + received + 1, START_NS + sent)
    return path
