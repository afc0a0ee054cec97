"""Policies that fail in known ways, and many rides under them, with the safety layer or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from bicycle_controller.control.controller import Controller
from bicycle_controller.control.safety import Safety
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import Scenario
from bicycle_sim.task.task import BicycleTask

FINE = 400
"""Steps, 10 s, that a policy that fails late rides well."""
DRIFT = 0.05
"""N m of torque per s that a drifting policy's bias grows by."""


@dataclass
class Moment:
    """Inputs of a fault."""

    sound: Callable[[], np.ndarray]
    """Actions of the sound policy, (N, 3)."""
    limits: np.ndarray
    """(3,)."""
    count: int
    """N."""
    step: int
    rng: np.random.Generator

    def full(self) -> np.ndarray:
        return np.tile(self.limits, (self.count, 1))

    def random(self) -> np.ndarray:
        return self.rng.uniform(-self.limits, self.limits, (self.count, 3))


Fault = Callable[[Moment], np.ndarray]
"""Faulty actions, (N, 3)."""

FAULTS: dict[str, Fault] = {
    "sound": lambda now: now.sound(),
    "not a number": lambda now: np.full((now.count, 3), np.nan),
    "constant full": lambda now: now.full(),
    "random": lambda now: now.random(),
    "bang-bang at 40 Hz": lambda now: now.full() * (-1.0) ** now.step,
    "bang-bang at 1 Hz": lambda now: now.full() * (-1.0) ** (now.step // 20),
    "drifting torque": lambda now: now.sound() + np.array([DRIFT * 0.025 * now.step, 0, 0]),
    "fine for 10 s, then constant full": lambda now: (
        now.sound() if now.step < FINE else now.full()
    ),
    "fine for 10 s, then random": lambda now: now.sound() if now.step < FINE else now.random(),
}


@dataclass(frozen=True)
class Outcome:
    """Results of N rides, (N,) each; a ride ends at the goal, at a fall or at the step limit."""

    reached: np.ndarray
    fallen: np.ndarray
    steps: np.ndarray
    hand_overs: np.ndarray
    by_fallback: np.ndarray
    """Steps under the fallback."""
    limited: np.ndarray


def ride(
    policy: Controller,
    fault: Fault,
    scenario: Scenario,
    count: int,
    seed: int,
    safety: Safety | None = None,
    fallback: Controller | None = None,
) -> Outcome:
    """Ride `count` bicycles under a faulty policy; what is no number is no input."""
    task = BicycleTask(scenario, ChoiPlant(), count, np.random.default_rng(seed))
    rng, limits, none = np.random.default_rng(seed + 1), scenario.action_limits, np.zeros(count)
    reached, fallen, over = (np.zeros(count, dtype=bool) for _ in range(3))
    steps, by_fallback, hand_overs, limited = (np.zeros(count, np.int64) for _ in range(4))
    seen = task.observation()
    while not over.all() and task.steps[0] < scenario.max_steps:
        speed, step = task.state.speed, int(task.steps[0])
        if safety is not None:
            safety.judge(seen, speed, none)
        sound = partial(policy.act, seen, speed)
        action = np.array(fault(Moment(sound, limits, count, step, rng)))
        if safety is not None:
            assert fallback is not None
            driving = safety.fail(~np.isfinite(action).all(axis=1)) > 0
            if driving.any():
                action[driving] = fallback.act(seen[driving], speed[driving])
            action = safety.limit(np.clip(action, -limits, limits))
            by_fallback += driving & ~over
        result = task.step(np.clip(np.nan_to_num(action), -limits, limits))
        seen = result.observation
        reached |= result.terminated & ~over
        fallen |= result.fallen & ~over
        steps += ~over
        if safety is not None:
            hand_overs = np.where(over, hand_overs, safety.hand_overs)
            limited = np.where(over, limited, safety.limited)
        over |= result.terminated | result.fallen
    return Outcome(reached, fallen, steps, hand_overs, by_fallback, limited)
