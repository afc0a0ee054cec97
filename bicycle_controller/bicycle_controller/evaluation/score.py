"""Score of a policy for the training loop: batched calls on fixed starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from bicycle_controller.config.run import EvaluationConfig, StartsConfig
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.exploration_noise import Noise, NoiseConfig
from bicycle_controller.control.riding import Riding
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Region, Scenario
from bicycle_sim.task.task import BicycleTask

NEAR_STEPS = 1_200
"""Step limit of a ride to a near goal: half a minute, several times the usual duration."""
SHAKEN = 128
"""Number of bicycles that ride with exploration noise, for as many steps."""
SHAKE_THETA = 0.15
"""Pull of that noise towards zero per step (Table 3)."""


Hardship: TypeAlias = tuple[Plant[Any], Disturbance]
"""Another bicycle, or something that disturbs it."""


def hardships(
    plant: Plant[Any], plant_too: Plant[Any] | None, starts: StartsConfig
) -> list[Hardship]:
    """Return each hardship of the training starts alone, at its largest."""
    found = [] if plant_too is None else [(plant_too, Disturbance())]
    trials = []
    if starts.delay:
        trials.append(Disturbance(action_delay=starts.delay))
    if starts.kick > 0:
        trials.append(Disturbance(roll_kick=starts.kick))
    if starts.noise > 0:
        trials.append(Disturbance(observation_noise=(starts.noise,) * 6))
    trials += [Disturbance(speed=speed) for speed in starts.speeds or ()]
    return [*found, *((plant, trial) for trial in trials)]


@dataclass(frozen=True)
class Score:
    """Shares of the rides, and the median time of those that reached their goal."""

    reach_rate: float
    fall_rate: float
    orbit_rate: float
    median_time_s: float | None
    near_reach_rate: float | None = None
    """Same for goals near the start; None if not tested."""
    near_fall_rate: float | None = None
    near_median_time_s: float | None = None
    mean_return: float | None = None
    """Mean sum of rewards of the rides to goals that are not near."""
    shaken_fall_rate: float | None = None
    """Share that falls within half a minute of exploration noise; None if not tested."""
    hard_miss_rates: tuple[float, ...] | None = None
    """Share that does not reach a near goal under each hardship; None if not tested."""

    @property
    def rank(self) -> tuple[float, float]:
        """Rank of a policy, larger is better: goals minus falls, then the shorter time.

        Falls under noise count too, if tested: a policy that reaches its goals slightly sooner but
        falls when it explores is no better.
        """
        worth = self.reach_rate - self.fall_rate
        time = _or_infinite(self.median_time_s)
        if self.near_reach_rate is not None and self.near_fall_rate is not None:
            worth = 0.5 * (worth + self.near_reach_rate - self.near_fall_rate)
            time += _or_infinite(self.near_median_time_s)
        missed = sum(self.hard_miss_rates or ())
        return (worth - (self.shaken_fall_rate or 0.0) - missed, -time)


def score(
    policy: Controller,
    scenario: Scenario,
    plant: Plant[Any],
    fixed: EvaluationConfig,
    hard: Sequence[Hardship] = (),
) -> Score:
    """Ride the fixed starts to their end and return the score.

    Args:
        policy: chooses the actions.
        scenario: where from and where to.
        plant: which bicycle.
        fixed: how many starts.
        hard: hardships for `hard_episodes` rides each.
    """
    scenario = dataclasses.replace(scenario, max_steps=fixed.max_steps or scenario.max_steps)
    far = evaluate(policy, scenario, plant, fixed.episodes, fixed.seed).summary()
    names = ("reach_rate", "fall_rate", "orbit_rate", "median_time_s")
    values = {name: far[name] for name in (*names, "mean_return")}
    if fixed.near_episodes > 0:
        near_goals = near(scenario, fixed.near_distance)
        found = evaluate(policy, near_goals, plant, fixed.near_episodes, fixed.seed).summary()
        values |= {f"near_{name}": found[name] for name in names if name != "orbit_rate"}
    if fixed.hard_episodes > 0 and hard:
        goals = near(scenario, fixed.near_distance)
        rides = (
            evaluate(policy, goals, bicycle, fixed.hard_episodes, fixed.seed, trial)
            for bicycle, trial in hard
        )
        values["hard_miss_rates"] = tuple(1.0 - ride.summary()["reach_rate"] for ride in rides)
    if fixed.shake > 0:
        steps = min(NEAR_STEPS, fixed.max_steps or NEAR_STEPS)
        values["shaken_fall_rate"] = shaken(
            policy, scenario, plant, fixed.shake, fixed.seed, steps
        )
    return Score(**values)


def shaken(
    policy: Controller,
    scenario: Scenario,
    plant: Plant[Any],
    sigma: float,
    seed: int,
    steps: int = NEAR_STEPS,
) -> float:
    """Return the share of SHAKEN bicycles that falls within `steps` of Ornstein-Uhlenbeck noise.

    The noise is the controller's exploration noise: `sigma` is a share of each action's limit.
    """
    start, source = (np.random.default_rng((seed, use)) for use in (0, 1))
    task = BicycleTask(scenario, plant, SHAKEN, start)
    noise = Noise(NoiseConfig("ou", sigma, SHAKE_THETA), SHAKEN, 3, source)
    limits = scenario.action_limits
    observation = task.observation()
    riding = Riding(policy, SHAKEN, plant)
    for _ in range(steps):
        speed = task.state.speed
        action = riding.act(observation, speed) + noise.sample() * limits
        riding.acted(observation, speed, np.clip(action, -limits, limits))
        result = task.step(action)
        observation = result.observation
        if result.terminated.any():
            task.reset(result.terminated)
            riding.reset(result.terminated)
            observation = task.observation()
    return float(task.fallen.mean())


def near(scenario: Scenario, distance: float) -> Scenario:
    """Return the scenario with goals in a square of half width `distance`, m, about the start."""
    return dataclasses.replace(
        scenario,
        start=Region.point(0.0, 0.0),
        goal=Region((-distance, -distance), (distance, distance)),
        max_steps=NEAR_STEPS,
    )


def _or_infinite(seconds: float | None) -> float:
    return float("inf") if seconds is None else seconds
