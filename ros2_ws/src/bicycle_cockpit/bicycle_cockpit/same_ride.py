"""A recorded ride ridden again by another controller: same start, goals and pushes.

It is simulated step by step, without the safety layer: a fall ends it.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bicycle_bag.errors import BagError
from bicycle_cockpit import goal_words
from bicycle_cockpit.bags import session, setting_of
from bicycle_cockpit.fit import misfit
from bicycle_cockpit.marks import push_text
from bicycle_cockpit.policy_catalogue import file_title
from bicycle_cockpit.riders import lqr_names, rider, shipped_names
from bicycle_cockpit.samples import COLUMNS, REWARDED, Sample, plain, plain_column, reward_columns
from bicycle_common.conventions import mirror
from bicycle_common.observation import goal_bearing
from bicycle_common.types import BicycleState, Command, InitialPose, Point2D
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.goals import Event, GoalTracker, Status
from bicycle_controller.policy.policy import PolicyError, load_controller
from bicycle_sim.runtime.simulator import Simulator
from bicycle_tools.ride_log import read_ride

LONGEST = 2.0
"""Time that the controller gets, as a multiple of the recorded ride."""
MOST_STEPS = 24_000
QUEUED = 1.0
"""Time after a reached goal within which the next one belonged to the same list (s)."""
TIMEOUT, TURNS = 300.0, 2.0


class Plan(NamedTuple):
    """Tasks of a recorded ride, by the time since its start."""

    goals: list[tuple[float, list[Point2D]]]
    """s at which the points became the goals, in order, m."""
    pushes: dict[int, float]
    """rad/s to the right by the step that began with it."""
    duration: float
    """s."""


def same_ride(bag: Path, controller: str, title: str = "") -> dict[str, Any]:
    """Return the ride of another controller in the form of `bags.session`.

    `misfit` says besides why the controller does not suit the ride; it is empty if it does.

    Args:
        bag: folder or file.
        controller: the name of one that comes along, or a policy file.
        title: displayed name of the controller; by default that of its name or file.

    Raises:
        BagError: if the bag cannot be read, or the controller cannot ride its bicycle.
    """
    recorded = session(bag)
    plant, scenario = setting_of(read_ride(bag))
    try:
        policy = load_controller(controller, plant)
    except (PolicyError, ValueError) as error:
        raise BagError(f"{controller} cannot ride it: {error}") from None
    columns = dict(zip(recorded["columns"], recorded["data"], strict=True))
    plan = plan_of(recorded, columns, plant.time_step)
    if not plan.goals:
        raise BagError(f"{bag.name} has no goals that another controller could ride to")
    loop = ControlLoop(
        "ghost",
        policy,
        GoalTracker(scenario.goal_radius, TIMEOUT, TURNS),
        scenario.action_limits,
        plant=plant,
    )
    simulator = Simulator(scenario, plant)
    start = InitialPose(
        columns["x"][0], columns["y"][0], columns["heading"][0] - math.pi / 2, columns["speed"][0]
    )
    try:
        simulator.reset(start, 0)
    except ValueError as error:
        raise BagError(f"{bag.name} cannot be ridden again: {error}") from None
    rows, marks = _ride(simulator, loop, plan)
    names = {**shipped_names(), **lqr_names(plant)}
    names.setdefault(policy.policy_id, title or file_title(Path(controller)))
    table = np.array(rows, dtype=np.float64).T
    return recorded | {
        "data": [plain_column(column) for column in table],
        "columns": list(COLUMNS),
        "marks": marks,
        "riders": [asdict(rider(policy.policy_id, names))],
        "loop": {},
        "misfit": misfit(controller, plant, scenario),
        "duration": float(rows[-1].t),
    }


def plan_of(recorded: dict[str, Any], columns: dict[str, list[float]], period: float) -> Plan:
    """Return what a ride in the page's form was asked to do, in its first episode."""
    episodes = columns["episode"]
    end = next((n for n, one in enumerate(episodes) if one != episodes[0]), len(episodes))
    over = columns["t"][end - 1]
    goals: list[tuple[float, list[Point2D]]] = []
    pushes: dict[int, float] = {}
    reached = -math.inf
    for mark in recorded["marks"]:
        if mark["t"] > over:
            break
        if mark["kind"] == "reached":
            reached = mark["t"]
        elif mark["kind"] == "active":
            point = (float(mark["x"]), float(mark["y"]))
            if goals and mark["t"] - reached < QUEUED:
                goals[-1][1].append(point)
            else:
                goals.append((mark["t"], [point]))
        elif mark["kind"] == "push":
            step = round(mark["t"] / period)
            pushes[step] = pushes.get(step, 0.0) + mark["lean_rate"]
    return Plan(goals, pushes, over)


def _ride(
    simulator: Simulator, loop: ControlLoop, plan: Plan
) -> tuple[list[Sample], list[dict[str, Any]]]:
    """Ride until the last goal is decided, the bicycle falls, or the time is up."""
    period = simulator.time_step
    rows: list[Sample] = []
    marks: list[dict[str, Any]] = []
    pending = list(plan.goals)
    before: Command | None = None  # a row has the newest command before its state, as in a bag
    steps = min(MOST_STEPS, math.ceil(LONGEST * plan.duration / period) + 400)
    for step in range(steps):
        now = step * period
        while pending and pending[0][0] <= now + period / 2:
            loop.tracker.replace(pending.pop(0)[1])
        state = simulator.snapshot
        answer = loop.answer(state, now, simulator.applied)
        command = answer.command
        rows.append(_sample(state, before, now, simulator))
        before = command or before
        marks += [_mark(event, now) for event in answer.events if _told(event)]
        if state.fallen:
            marks.append(_at(state, now, "fell", "bad", "the bicycle fell"))
            break
        if not pending and not loop.tracker.has_goal and loop.tracker.waiting == 0:
            break
        push = plan.pushes.get(step, 0.0)
        if push:
            marks.append(_at(state, now, "push", "info", push_text(push)))
        if command is not None:
            simulator.step(command, -push)  # the plant's lean is positive to the left
        elif state.step > 0:
            simulator.step(None, -push)
    return rows, marks


def _sample(
    state: BicycleState, command: Command | None, now: float, simulator: Simulator
) -> Sample:
    applied = simulator.applied
    error, distance = goal_bearing(state, applied.goal)
    numbers = {**vars(state), "heading_error": error}
    named = {name: mirror(name, numbers[name]) for name in REWARDED}
    action = command.action if command is not None else (math.nan,) * 3
    heading = math.remainder(state.heading + math.pi / 2, 2 * math.pi)
    return Sample(
        now,
        1,
        state.step,
        state.rear_x,
        state.rear_y,
        heading,
        named["lean_angle"],
        mirror("lean_rate", state.lean_rate),
        state.steer_angle,
        state.speed,
        distance,
        named["heading_error"],
        int(applied.source),
        *action,
        0 if command is not None else math.nan,
        *reward_columns(named, simulator.scenario.reward),
    )


def _told(event: Event) -> bool:
    return event.status not in goal_words.UNTOLD


def _mark(event: Event, now: float) -> dict[str, Any]:
    status: Status = event.status
    place = event.goal.point
    return {
        "t": round(now, 3),
        "kind": goal_words.kind(status),
        "level": goal_words.level(status),
        "text": goal_words.text(status, place, event.message),
        "x": plain(place[0]),
        "y": plain(place[1]),
    }


def _at(state: BicycleState, now: float, kind: str, level: str, text: str) -> dict[str, Any]:
    where = {"x": plain(state.rear_x), "y": plain(state.rear_y)}
    return {"t": round(now, 3), "kind": kind, "level": level, "text": text, **where}
