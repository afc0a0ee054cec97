"""Score how bicycles keep clear of one another at crossings.

Two bicycles ride straight on paths that cross at 20 to 180 degrees, at 2.5 to 4 m/s, and would be
at the crossing within about a second of one another. Each sees itself now and the other as the
controller node does: as it was at the last look, up to a tenth of a second ago. The keys of the
result, as `bicycle evaluate --crossings N --json` prints them:

    crossings, falls               of pairs of bicycles, and falls among them
    nearest_m                      the least distance of two rear contacts
    below_1_m                      crossings in which they came nearer than that: collisions
    below_1_m_blind                the same where nobody gives way
    delay_s                        mean of the time that giving way cost a pair
    seed                           of the crossings
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_common.validation import require
from bicycle_controller.control import followers
from bicycle_controller.control.keep_clear import LOOK_PERIOD, Mover, Way, keep_clear
from bicycle_controller.control.path import Paths, Place
from bicycle_controller.control.path_follower import PathFollower
from bicycle_controller.control.path_making import path_through
from bicycle_sim.plants.base import FALL_ANGLE, Plant

TOUCH = 1.0
"""m between two rear contacts below which bicycles are taken to touch."""
SLOWEST = 2.0
"""m/s."""
DURATION = 25.0
"""s."""
SPEED_LIMITS = (1.0, 8.0)
"""m/s."""


@dataclass(frozen=True)
class Crossed:
    """Results of N crossings; every field is (N,)."""

    least: np.ndarray
    """m between the rear contacts, the least."""
    fallen: np.ndarray
    """bool: True if one of the two fell."""
    ridden: np.ndarray
    """m that both rode together."""


def cross(plant: Plant[Any], count: int, seed: int, rule: bool = True) -> Crossed:
    """Ride `count` crossings at once.

    Args:
        plant: the bicycles.
        count: N.
        seed: of angles, speeds and times.
        rule: False lets them ride on blindly.
    """
    rng = np.random.default_rng(seed)
    angle = rng.uniform(np.radians(20.0), np.pi, count) * rng.choice((-1, 1), count)
    wanted = [rng.uniform(2.5, 4.0, count) for _ in range(2)]
    meet, late = rng.uniform(8.0, 14.0, count), rng.normal(0.0, 0.8, count)
    follower = followers.make("preview", plant)
    straight = Paths([path_through([(0.0, 0.0), (0.0, 10.0)], closed=False)], np.zeros(count, int))
    psi = [np.zeros(count), np.asarray(wrap_angle(angle))]
    begin = [-wanted[0] * meet, -wanted[1] * (meet + late)]
    states = []
    for i in range(2):
        x, y = -np.sin(psi[i]) * begin[i], np.cos(psi[i]) * begin[i]
        states.append(plant.initial(x, y, psi[i], wanted[i]))
    least, fallen = np.full(count, np.inf), np.zeros(count, dtype=bool)
    shifts = [np.zeros(count), np.zeros(count)]
    between = max(1, round(LOOK_PERIOD / plant.time_step))
    seen: list[Mover] = []
    for step in range(round(DURATION / plant.time_step)):
        movers = [Mover(s.rear_x, s.rear_y, s.heading, s.speed) for s in states]
        if step % between == 0:
            seen = movers
        least = np.minimum(least, np.hypot(movers[0].x - movers[1].x, movers[0].y - movers[1].y))
        for i in range(2):
            way = Way(wanted[i], np.zeros(count), np.zeros(count, dtype=bool))
            if rule:
                later = np.full(count, i == 1)
                beside = -movers[i].x * np.cos(psi[i]) - movers[i].y * np.sin(psi[i])
                own = movers[i]._replace(heading=psi[i])
                way = keep_clear(own, seen[1 - i], later, wanted[i], SLOWEST, beside, shifts[i])
                shifts[i] = way.shift
            states[i] = _step(plant, follower, straight, states[i], psi[i], way)
            fallen |= plant.fallen(states[i], FALL_ANGLE)
    ridden = sum(
        -np.sin(psi[i]) * s.rear_x + np.cos(psi[i]) * s.rear_y - begin[i]
        for i, s in enumerate(states)
    )
    return Crossed(least, fallen, np.asarray(ridden))


def _step(
    plant: Plant[Any],
    follower: PathFollower,
    straight: Paths,
    state: Any,
    psi: np.ndarray,
    way: Way,
) -> Any:
    """Ride one period along the line through the origin in the direction psi."""
    left = -state.rear_x * np.cos(psi) - state.rear_y * np.sin(psi)
    zero = np.zeros(len(psi))
    error = np.asarray(wrap_angle(state.heading - psi))
    place = Place(zero + 5.0, left - way.shift, error, zero)
    columns = [state.steer_angle, state.steer_rate, state.lean_angle, state.lean_rate]
    seen = np.column_stack([*columns, state.lean_acceleration, zero])
    action = follower.act(seen, state.speed, place, straight, way.speed)
    return plant.step(state, action[:, 0], zero, action[:, 2], SPEED_LIMITS)


def score(plant: Plant[Any], count: int, seed: int = 0) -> dict[str, Any]:
    """Ride crossings with the rule and without; return the keys named above.

    Raises:
        ValueError: on a number of crossings out of range.
    """
    require(1 <= count <= 100_000, f"{count} crossings: choose 1 to 100,000")
    kept, blind = cross(plant, count, seed), cross(plant, count, seed, rule=False)
    speed = blind.ridden / DURATION
    return {
        "crossings": count,
        "falls": int(kept.fallen.sum()),
        "nearest_m": float(kept.least.min()),
        "below_1_m": int((kept.least < TOUCH).sum()),
        "below_1_m_blind": int((blind.least < TOUCH).sum()),
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
