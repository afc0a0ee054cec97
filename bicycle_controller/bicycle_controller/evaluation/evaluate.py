"""Score a controller over many rides, or two controllers over the same rides.

The keys of an evaluation, as `bicycle evaluate --json` prints them:

    controller, scenario, physics, disturbance, seed     what was ridden
    episodes                       rides
    reach_rate, fall_rate, timeout_rate, orbit_rate      shares of the rides; the first three
                                   sum to 1, an orbit is also a time-out
    ..._rate_interval              95 % interval of each, [low, high] (Wilson)
    median_time_s, p95_time_s      s from start to goal, over rides that reached it
    path_ratio, path_ratio_mean    path over the straight line less the goal's radius; median
                                   and mean over rides that reached a goal at least two radii away
    peak_lean, peak_lean_max       rad; median and largest of the rides' largest lean angles
    mean_torque, mean_displacement, mean_pedal_force     N m, m, N: mean size over all steps
    mean_speed                     m/s over all rides
    mean_return                    sum of rewards (eq. 20), a fall's repeated to the step limit
    unlike_training                in what the rides differ from those that the controller was
                                   trained on or designed for, a list of texts

What no ride gives (the time of none that reached the goal) is null.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.evaluation.rollouts import Disturbance, Rollouts, ride
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

NORMAL_95 = 1.959963984540054
"""97.5 % quantile of the standard normal distribution."""
ORBIT_TURNS = 2.0
"""Net turns around the goal, either way, from which a ride that ends upright at the step limit
counts as an orbit."""


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of `hits` in `count` (Wilson 1927, no continuity correction).

    Raises:
        ValueError: unless 0 <= hits <= count.
    """
    require(0 <= hits <= count, f"{hits} hits in {count} cannot be")
    if count == 0:
        return 0.0, 1.0
    square = NORMAL_95**2
    rate = hits / count
    centre = (rate + square / (2 * count)) / (1 + square / count)
    spread = rate * (1 - rate) / count + square / (4 * count**2)
    half = NORMAL_95 * math.sqrt(spread) / (1 + square / count)
    # At the ends the formula gives 0 and 1 up to rounding.
    low = 0.0 if hits == 0 else centre - half
    return low, 1.0 if hits == count else centre + half


@dataclass(frozen=True)
class Evaluation:
    """Rides of one controller, with their scenario, physics and disturbance."""

    controller: str
    """The policy id."""
    scenario: Scenario
    plant: Plant[Any]
    disturbance: Disturbance
    seed: int
    rides: Rollouts

    @property
    def times(self) -> np.ndarray:
        """Duration of each ride, s, (N,)."""
        return self.rides.steps * self.plant.time_step

    @property
    def path_ratios(self) -> np.ndarray:
        """Path over the shortest path, (N,); NaN if the goal was missed or too near."""
        radius = self.scenario.goal_radius
        valid = self.rides.reached & (self.rides.straight >= 2.0 * radius)
        shortest = np.where(valid, self.rides.straight - radius, np.nan)
        return self.rides.path / shortest

    @property
    def orbits(self) -> np.ndarray:
        """bool, (N,): True for an orbit, see ORBIT_TURNS."""
        late = ~self.rides.reached & ~self.rides.fallen
        return late & (np.abs(self.rides.winding) >= ORBIT_TURNS * 2.0 * math.pi)

    def summary(self) -> dict[str, Any]:
        """Return the keys listed above, ready for JSON."""
        rides = self.rides
        late = ~rides.reached & ~rides.fallen
        result: dict[str, Any] = {
            "controller": self.controller,
            "scenario": asdict(self.scenario),
            "physics": json.loads(self.plant.to_json()),
            "disturbance": asdict(self.disturbance),
            "seed": self.seed,
            "episodes": len(rides.steps),
        }
        for name, mask in (
            ("reach", rides.reached),
            ("fall", rides.fallen),
            ("timeout", late),
            ("orbit", self.orbits),
        ):
            hits = int(mask.sum())
            result[f"{name}_rate"] = hits / len(mask)
            result[f"{name}_rate_interval"] = list(wilson(hits, len(mask)))
        times, ratios = self.times[rides.reached], self.path_ratios
        ratios = ratios[np.isfinite(ratios)]
        seconds = float(self.times.sum())
        return result | {
            "median_time_s": _statistic(np.median, times),
            "p95_time_s": _statistic(lambda values: np.quantile(values, 0.95), times),
            "path_ratio": _statistic(np.median, ratios),
            "path_ratio_mean": _statistic(np.mean, ratios),
            "peak_lean": _statistic(np.median, rides.peak_lean),
            "peak_lean_max": _statistic(np.max, rides.peak_lean),
            "mean_torque": float(np.average(rides.torque, weights=rides.steps)),
            "mean_displacement": float(np.average(rides.displacement, weights=rides.steps)),
            "mean_pedal_force": float(np.average(rides.pedal_force, weights=rides.steps)),
            "mean_speed": float(rides.path.sum()) / seconds,
            "mean_return": float(rides.score.mean()),
        }


def _statistic(function: Any, values: np.ndarray) -> float | None:
    """Return `function` of the values, or None if there are none."""
    return float(function(values)) if len(values) else None


def evaluate(
    controller: Controller,
    scenario: Scenario,
    plant: Plant[Any] | None = None,
    episodes: int = 1000,
    seed: int = 0,
    disturbance: Disturbance | None = None,
    progress: bool = False,
) -> Evaluation:
    """Ride `episodes` rides; see `rollouts.ride` for arguments and errors."""
    plant = plant if plant is not None else registry.default()
    disturbance = disturbance or Disturbance()
    rides = ride(controller, scenario, plant, episodes, seed, disturbance, progress)
    name = controller.policy_id
    return Evaluation(name, scenario, plant, disturbance, seed, rides)


def compare(first: Evaluation, second: Evaluation) -> dict[str, Any]:
    """Compare two controllers over the same starts, ride by ride.

    Returns:
        Over all rides: `first_better`, `equal` and `second_better`, counts that sum to
        `episodes`. The better one of a ride reached the goal alone, or sooner; equal are rides
        in which both took the same number of steps or neither reached it. Their `..._share` are
        of all rides, each with its interval.

        Of the rides in which both reached the goal (`both_reach`): `first_sooner`, `same_time`
        and `second_sooner`; `median_time_s` of each; `time_ratio` and `time_saved_s`, the
        medians of the first's time over the second's and of the second's less the first's;
        `total_time_ratio`, the sum of the first's times over the sum of the second's.

        Counts of rides that only one or none reached the goal in.

    Raises:
        ValueError: when they did not ride from the same starts.
    """
    for name in ("scenario", "plant", "disturbance", "seed"):
        same = getattr(first, name) == getattr(second, name)
        require(same, f"the two evaluations differ in their {name}; evaluate again")
    straight = np.array_equal(first.rides.straight, second.rides.straight)
    require(straight, "the two evaluations did not ride from the same starts; evaluate again")
    both = first.rides.reached & second.rides.reached
    alone = int((first.rides.reached & ~second.rides.reached).sum())
    other_alone = int((~first.rides.reached & second.rides.reached).sum())
    mine, other = first.times[both], second.times[both]
    sooner, later = int((mine < other).sum()), int((mine > other).sum())
    count = len(both)
    found: dict[str, Any] = {
        "controllers": [first.controller, second.controller],
        "episodes": count,
    }
    better, worse = sooner + alone, later + other_alone
    for name, hits in (
        ("first_better", better),
        ("equal", count - better - worse),
        ("second_better", worse),
    ):
        found[name] = hits
        found[f"{name}_share"] = hits / count if count else None
        found[f"{name}_share_interval"] = list(wilson(hits, count))
    return found | {
        "both_reach": int(both.sum()),
        "only_first_reaches": alone,
        "only_second_reaches": other_alone,
        "neither_reaches": int((~first.rides.reached & ~second.rides.reached).sum()),
        "first_sooner": sooner,
        "same_time": len(mine) - sooner - later,
        "second_sooner": later,
        "median_time_s": [_statistic(np.median, mine), _statistic(np.median, other)],
        "time_ratio": _statistic(np.median, mine / other),
        "time_saved_s": _statistic(np.median, other - mine),
        "total_time_ratio": float(mine.sum() / other.sum()) if len(mine) else None,
    }
