"""Score how bicycles keep clear of one another at crossings.

Two bicycles ride straight on paths that cross at 20 to 180 degrees, at 2.5 to 4 m/s, and would be
at the crossing within about a second of one another. Each sees itself now and the other as the
controller node does: as it was at the last look, up to a tenth of a second ago. With a policy as
CONTROLLER they ride to goals instead, from the scenario's start speed; with cmd_vel by its
command straight on. The keys of the result, as `bicycle evaluate --crossings N --json` prints:

    rider                          preview, stanley, cmd_vel or the policy
    crossings, falls               of pairs of bicycles, and falls among them
    nearest_m                      the least distance of two rear contacts
    below_1_m                      crossings in which they came nearer than that: collisions
    below_1_m_blind, falls_blind   the same where nobody gives way
    delay_s                        mean of the time that giving way cost a pair
    seed                           of the crossings
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_common import topic_names
from bicycle_common.geometry import wrap_angle
from bicycle_common.validation import require
from bicycle_controller.control import followers
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.keep_clear import LOOK_PERIOD, Mover
from bicycle_controller.evaluation.crossing_riders import (
    GoalRider,
    PathRider,
    Rider,
    TwistRider,
)
from bicycle_sim.plants.base import FALL_ANGLE, Plant
from bicycle_sim.task.scenario import Scenario

TOUCH = 1.0
"""m between two rear contacts below which bicycles are taken to touch."""
DURATION = 25.0
"""s."""
SPEED_LIMITS = (1.0, 8.0)
"""m/s."""
CMD_VEL = topic_names.CMD_VEL
"""Rider that takes commands of that topic."""

MakeRider = Callable[[int, np.ndarray, np.ndarray], Rider]
"""Returns the first or second bicycle of N pairs, for directions (N,) rad and speeds (N,) m/s."""


@dataclass(frozen=True)
class Crossed:
    """Results of N crossings; every field is (N,)."""

    least: np.ndarray
    """m between the rear contacts, the least."""
    fallen: np.ndarray
    """bool: True if one of the two fell."""
    ridden: np.ndarray
    """m that both rode together."""


def cross(
    plant: Plant[Any],
    count: int,
    seed: int,
    make: MakeRider,
    rule: bool = True,
    start_speed: float | None = None,
    speed_limits: tuple[float, float] | None = SPEED_LIMITS,
) -> Crossed:
    """Ride `count` crossings at once.

    Args:
        plant: the bicycles.
        count: N.
        seed: of angles, speeds and times.
        make: makes the riders.
        rule: False lets them ride on blindly.
        start_speed: m/s of all; drawn by default.
        speed_limits: m/s.
    """
    rng = np.random.default_rng(seed)
    angle = rng.uniform(np.radians(20.0), np.pi, count) * rng.choice((-1, 1), count)
    wanted = [rng.uniform(2.5, 4.0, count) for _ in range(2)]
    if start_speed is not None:
        wanted = [np.full(count, start_speed)] * 2
    meet, late = rng.uniform(8.0, 14.0, count), rng.normal(0.0, 0.8, count)
    psi = [np.zeros(count), np.asarray(wrap_angle(angle))]
    begin = [-wanted[0] * meet, -wanted[1] * (meet + late)]
    riders = [make(i, psi[i], wanted[i]) for i in range(2)]
    states = []
    for i in range(2):
        x, y = -np.sin(psi[i]) * begin[i], np.cos(psi[i]) * begin[i]
        states.append(plant.initial(x, y, psi[i], wanted[i]))
    least, fallen = np.full(count, np.inf), np.zeros(count, dtype=bool)
    between = max(1, round(LOOK_PERIOD / plant.time_step))
    seen: list[Mover] = []
    for step in range(round(DURATION / plant.time_step)):
        movers = [Mover(s.rear_x, s.rear_y, s.heading, s.speed) for s in states]
        if step % between == 0:
            seen = movers
        apart = np.hypot(movers[0].x - movers[1].x, movers[0].y - movers[1].y)
        least = np.where(fallen, least, np.minimum(least, apart))
        for i, rider in enumerate(riders):
            torque, displacement, pedal = rider.act(states[i], seen[1 - i] if rule else None).T
            states[i] = plant.step(states[i], torque, displacement, pedal, speed_limits)
            fallen |= plant.fallen(states[i], FALL_ANGLE)
    ridden = sum(
        -np.sin(psi[i]) * s.rear_x + np.cos(psi[i]) * s.rear_y - begin[i]
        for i, s in enumerate(states)
    )
    return Crossed(least, fallen, np.asarray(ridden))


def score(
    plant: Plant[Any],
    count: int,
    seed: int = 0,
    rider: str = "preview",
    policy: Controller | None = None,
    scenario: Scenario | None = None,
) -> dict[str, Any]:
    """Ride crossings with the rule and without; return the keys named above.

    Args:
        plant: the bicycles.
        count: of crossings.
        seed: of the crossings.
        rider: a follower, `cmd_vel`, or the policy's name.
        policy: rides to goals, if it is given.
        scenario: its limits and start speed.

    Raises:
        ValueError: on a number of crossings out of range.
    """
    require(1 <= count <= 100_000, f"{count} crossings: choose 1 to 100,000")
    given: dict[str, Any] = {}
    if policy is not None:
        assert scenario is not None
        limits = scenario.action_limits
        given = {"start_speed": scenario.start_speed, "speed_limits": scenario.speed_limits}

        def make(i: int, psi: np.ndarray, wanted: np.ndarray) -> Rider:
            return GoalRider(policy, plant, psi, limits, f"b{i}")
    else:
        follower = followers.make("preview" if rider == CMD_VEL else rider, plant)

        def make(i: int, psi: np.ndarray, wanted: np.ndarray) -> Rider:
            if rider == CMD_VEL:
                return TwistRider(follower, wanted, f"b{i}")
            return PathRider(follower, psi, wanted, later=i == 1)

    kept = cross(plant, count, seed, make, **given)
    blind = cross(plant, count, seed, make, rule=False, **given)
    speed = blind.ridden / DURATION
    return {
        "rider": rider,
        "crossings": count,
        "falls": int(kept.fallen.sum()),
        "nearest_m": float(kept.least.min()),
        "below_1_m": int((kept.least < TOUCH).sum()),
        "below_1_m_blind": int((blind.least < TOUCH).sum()),
        "falls_blind": int(blind.fallen.sum()),
        "delay_s": float(np.mean((blind.ridden - kept.ridden) / speed)),
        "seed": seed,
    }


def as_text(result: dict[str, Any]) -> str:
    """Return a result in one line."""
    return (
        f"{result['crossings']} crossings: nearest {result['nearest_m']:.2f} m, "
        f"{result['below_1_m']} nearer than {TOUCH:g} m (without the rule "
        f"{result['below_1_m_blind']}), {result['falls']} falls, {result['delay_s']:.1f} s lost "
        "by giving way, on average"
    )
