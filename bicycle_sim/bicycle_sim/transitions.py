"""A ride as learning sees it: (s, a, r, s') with the ends of episodes marked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bicycle_sim.reward import reward_terms
from bicycle_sim.scenario import Scenario
from bicycle_sim.simulator import Command, Point, Snapshot, goal_bearing


@dataclass(frozen=True)
class Transition:
    """One step towards one goal, in the paper's signs; see `task.OBSERVATION_FIELDS`."""

    episode: int
    step: int
    """Of the state that the action was taken in."""
    goal: Point
    """m."""
    goal_id: int
    observation: np.ndarray
    """(6,)."""
    action: tuple[float, float, float]
    """(T, d, F) as commanded, N m, m, N."""
    reward: float
    """Equation 20, of the next state."""
    next_observation: np.ndarray
    """(6,)."""
    terminated: bool
    """The goal was reached."""
    truncated: bool
    """The pursuit was cut here: reset, new goal, or no command."""
    fallen: bool
    """The next state is a fallen one."""
    speed: float
    """m/s before the step."""
    policy: str
    """Id of the policy that chose the action."""


class TransitionLog:
    """Makes transitions of steps; each waits for the next one, which may show that it was cut."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._pending: Transition | None = None

    def add(self, before: Snapshot, after: Snapshot, command: Command | None) -> list[Transition]:
        """Take in one step; returns the transitions that are complete now, in order."""
        made = self._make(before, after, command)
        last = self._pending
        goes_on = (
            made is not None
            and last is not None
            and (
                (made.episode, made.step, made.goal_id, made.goal)
                == (last.episode, last.step + 1, last.goal_id, last.goal)
            )
        )
        complete = [last] if goes_on and last is not None else self.cut()
        self._pending = made
        if made is not None and (made.terminated or made.fallen):
            complete += self.cut()
        return complete

    def cut(self) -> list[Transition]:
        """End the pursuit here; returns the last transition, truncated unless it was an end."""
        last, self._pending = self._pending, None
        if last is None:
            return []
        return [last if last.terminated or last.fallen else replace(last, truncated=True)]

    def _make(
        self, before: Snapshot, after: Snapshot, command: Command | None
    ) -> Transition | None:
        """The transition of one step; None when it pursued no goal."""
        if command is None or command.goal is None:
            return None
        observation, _ = _observe(before, command.goal)
        following, distance = _observe(after, command.goal)
        _, _, lean, rate, acceleration, error = following
        terms = reward_terms(lean, rate, acceleration, error, self._scenario.reward)
        return Transition(
            episode=before.episode,
            step=before.step,
            goal=command.goal,
            goal_id=command.goal_id,
            observation=observation,
            action=command.action,
            reward=float(sum(terms.values())),
            next_observation=following,
            terminated=not after.fallen and distance <= self._scenario.goal_radius,
            truncated=False,
            fallen=after.fallen,
            speed=before.speed,
            policy=command.policy,
        )


def _observe(snapshot: Snapshot, goal: Point) -> tuple[np.ndarray, float]:
    """The six states towards `goal`, shape (6,), and the distance to it in m."""
    error, distance = goal_bearing(vars(snapshot), goal)
    return observation(snapshot, error), distance


def observation(snapshot: Snapshot, heading_error: float) -> np.ndarray:
    """The six states of the paper, shape (6,), with a heading error psi_g in rad."""
    return np.array(
        [
            snapshot.steer_angle,
            snapshot.steer_rate,
            snapshot.lean_angle,
            snapshot.lean_rate,
            snapshot.lean_acceleration,
            heading_error,
        ]
    )
