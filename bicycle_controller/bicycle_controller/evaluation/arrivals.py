"""Score arrivals: how far from the direction asked for do rides reach random poses?

One bicycle after another rides to a chain of random poses, each drawn in a square around the
place where the last one was reached, by the same loop as in a ride with nodes. The keys of the
result, as `bicycle evaluate --arrivals N --json` prints them:

    poses, reached                 asked for, and reached within the goal's radius
    possible                       those that the bicycle said it can arrive at as asked
    within_10_degrees              share of the possible ones reached in that direction
    median_degrees, p95_degrees    of the direction's error at the goal
    worst_degrees                  the largest
    falls, missed                  of the possible ones
    detour                         mean of the distance ridden by the straight one
    refused                        reasons why a direction was not kept, with their number
    side_m, seed                   of the square; of the poses
"""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import Any

import numpy as np

from bicycle_common.geometry import heading_to_yaw, wrap_angle
from bicycle_common.progress import ProgressBar
from bicycle_common.types import Command, InitialPose
from bicycle_common.validation import require
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.goals import GoalTracker, Status
from bicycle_controller.control.guidance import Guidance, GuidanceConfig
from bicycle_controller.control.lqr import fitting
from bicycle_sim.plants.base import Plant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import Scenario

CHAIN = 20
"""Poses ridden to before the next bicycle starts."""
LONGEST = 300.0
"""s for one pose."""
SETTLE = 60.0
"""Longest wait for the follower's gains (s)."""
ENDS = (Status.REACHED, Status.MISSED, Status.GIVEN_UP, Status.FALLEN, Status.CANCELLED)


def score(
    plant: Plant[Any],
    scenario: Scenario,
    poses: int = 200,
    seed: int = 0,
    side: float = 60.0,
    config: GuidanceConfig | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Ride to random poses; return the keys named above.

    Args:
        plant: the bicycle.
        scenario: its limits and start speed.
        poses: number of them.
        seed: of the poses.
        side: m of the square that each pose is drawn in.
        config: the guidance's configuration.
        progress: True to tell it on standard error.

    Raises:
        ValueError: on a number of poses or a side out of range.
    """
    require(1 <= poses <= 100_000, f"{poses} arrivals: choose 1 to 100,000")
    require(1.0 <= side <= 1000.0, f"a side of {side:g} m: choose 1 to 1000")
    rng = np.random.default_rng(seed)
    off: list[float] = []
    ends: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    detours: list[float] = []
    ride: _Ride | None = None
    for number in ProgressBar(range(poses), desc="arrivals", unit="pose", shown=progress):
        if ride is None or number % CHAIN == 0 or ride.simulator.snapshot.fallen:
            ride = _Ride(plant, scenario, config or GuidanceConfig())
        now = ride.simulator.snapshot
        dx, dy = rng.uniform(-0.5 * side, 0.5 * side, 2)
        yaw = float(rng.uniform(-math.pi, math.pi))
        goal = now.rear_x + float(dx), now.rear_y + float(dy)
        status, why, ridden = ride.to(goal, yaw)
        ends[status.name] += 1
        if why:
            refused[why] += 1
            continue
        if status is Status.REACHED:
            error = float(heading_to_yaw(ride.simulator.snapshot.heading)) - yaw
            off.append(abs(math.degrees(float(wrap_angle(error)))))
            detours.append(ridden / max(1.0, math.hypot(float(dx), float(dy))))
    possible = poses - sum(refused.values())
    return {
        "poses": poses,
        "reached": ends["REACHED"],
        "possible": possible,
        "within_10_degrees": sum(one <= 10.0 for one in off) / possible if possible else None,
        "median_degrees": float(np.median(off)) if off else None,
        "p95_degrees": float(np.quantile(off, 0.95)) if off else None,
        "worst_degrees": max(off, default=None),
        "falls": ends["FALLEN"],
        "missed": sum(ends[one.name] for one in (Status.MISSED, Status.GIVEN_UP)),
        "detour": float(np.mean(detours)) if detours else None,
        "refused": dict(refused),
        "side_m": side,
        "seed": seed,
    }


def as_text(result: dict[str, Any]) -> str:
    """Return a result in three lines."""
    share = result["within_10_degrees"]
    lines = [
        f"{result['reached']} of {result['poses']} random poses reached, {result['falls']} falls, "
        f"{result['missed']} missed"
    ]
    if share is not None and result["median_degrees"] is not None:
        lines.append(
            f"within 10° of the direction asked for: {100.0 * share:.1f} % of "
            f"{result['possible']} (median {result['median_degrees']:.1f}°, "
            f"95 % within {result['p95_degrees']:.1f}°, "
            f"at most {result['worst_degrees']:.1f}°)"
        )
    lines += [f"{count} not as asked: {why}" for why, count in result["refused"].items()]
    return "\n".join(lines)


class _Ride:
    """A bicycle, its loop and its guidance, without processes."""

    def __init__(self, plant: Plant[Any], scenario: Scenario, config: GuidanceConfig) -> None:
        limits = np.array(scenario.suited(plant.input_names).action_limits)
        self.simulator = Simulator(scenario, plant)
        self.simulator.reset(InitialPose(0.0, 0.0, 0.0, scenario.start_speed))
        self._loop = ControlLoop(
            "arrivals", fitting(limits, plant), GoalTracker(scenario.goal_radius), limits
        )
        self._guidance = Guidance(self._loop, config)
        self._guidance.ride(plant, limits)
        deadline = time.monotonic() + SETTLE
        while not self._guidance.ready and time.monotonic() < deadline:
            self._guidance.poll(self.simulator.snapshot)
            time.sleep(0.005)

    def to(self, goal: tuple[float, float], yaw: float) -> tuple[Status, str, float]:
        """Ride to a pose; return its end, why the direction is not kept, and the metres ridden."""
        simulator, step = self.simulator, self.simulator.plant.time_step
        self._guidance.stop("a newer goal came")
        number = self._loop.tracker.replace([goal])[0].goal_id
        self._guidance.poll(simulator.snapshot)
        why = self._guidance.arrive([goal], yaw)
        ridden = 0.0
        for _ in range(math.ceil(LONGEST / step)):
            now = simulator.snapshot
            self._guidance.poll(now)
            out = self._loop.answer(now, now.step * step)
            self._guidance.reports()
            for event in out.events:
                if event.goal.goal_id == number and event.status in ENDS:
                    return event.status, why, ridden
            command = out.command or Command(now.episode, now.step, 0.0, 0.0, 0.0)
            simulator.step(command)
            ridden += now.speed * step
        return Status.GIVEN_UP, why, ridden
