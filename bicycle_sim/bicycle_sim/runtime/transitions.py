"""Transitions of a ride for learning: (s, a, r, s') with the ends of episodes marked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bicycle_common.observation import goal_bearing, observation
from bicycle_common.types import BicycleState, Command, Point2D, Transition
from bicycle_sim.task.reward import reward_terms
from bicycle_sim.task.scenario import Scenario


class TransitionLog:
    """Builds transitions from steps; each waits for the next step, which may show a cut."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._pending: Transition | None = None

    def add(
        self, before: BicycleState, after: BicycleState, command: Command | None
    ) -> list[Transition]:
        """Take in one step; return the transitions that are complete now, in order."""
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
        """End the pursuit here; return the last transition, truncated unless the episode ended."""
        last, self._pending = self._pending, None
        if last is None:
            return []
        return [last if last.terminated or last.fallen else replace(last, truncated=True)]

    def _make(
        self, before: BicycleState, after: BicycleState, command: Command | None
    ) -> Transition | None:
        """Return the transition of one step; None if it pursued no goal."""
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


def _observe(snapshot: BicycleState, goal: Point2D) -> tuple[np.ndarray, float]:
    """Return the six states towards `goal`, shape (6,), and the distance to it in m."""
    error, distance = goal_bearing(vars(snapshot), goal)
    return observation(snapshot, error), distance
