"""One command for every state: goals, the policy in charge, exploration, and its fallback."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass

import numpy as np

from bicycle_controller.controllers import Controller
from bicycle_controller.goals import Event, GoalTracker, Pose
from bicycle_controller.noise import Noise
from bicycle_sim.simulator import Command, Snapshot
from bicycle_sim.transitions import observation

TIMES_KEPT = 4000
"""Answers whose computing times are kept: 100 s at 40 Hz."""


@dataclass(frozen=True)
class Answer:
    """What follows from one state."""

    command: Command | None
    """None where there is nothing to steer by, or the bicycle lies."""
    events: list[Event]
    """What has become of goals."""
    warning: str = ""
    """One line for the log; empty unless something has just gone wrong."""


class Driver:
    """Answers states in the order they come; the same state again gets the same command.

    Attributes:
        policy: in charge; may be replaced between two answers.
        limits: (3,) largest |T| (N m), |d| (m), |F| (N) that are sent; infinite where unknown.
        answered: states answered.
        missed: steps that were never seen.
        handed_over: answers that the fallback gave.
        failing: the policy failed at the last answer.
        times: s that the latest answers took to compute.
    """

    def __init__(
        self,
        name: str,
        policy: Controller,
        tracker: GoalTracker,
        limits: np.ndarray,
        noise: Noise | None = None,
        fallback: Controller | None = None,
        take_over: bool = True,
    ) -> None:
        """Begin before the first state.

        Args:
            name: unique, in every command.
            policy: in charge.
            tracker: of the goals.
            limits: (3,) N m, m, N.
            noise: exploration in normalised actions of one bicycle; none by default.
            fallback: answers where the policy fails; zero input without one.
            take_over: whether a bicycle that is found riding is ridden on, to the goal it had.
        """
        self.name = name
        self.policy = policy
        self.tracker = tracker
        self.limits = limits
        self.answered = self.missed = self.handed_over = 0
        self.times: deque[float] = deque(maxlen=TIMES_KEPT)
        self._noise = noise
        self._fallback = fallback
        self._take_over = take_over
        self._last: tuple[int, int] | None = None
        self._command: Command | None = None
        self.failing = False

    def answer(self, snapshot: Snapshot, simulated_time: float) -> Answer:
        """Answer one state; `simulated_time` in s.

        A state that came before another that is answered already, or answers after a fall, get
        no command.
        """
        started = time.perf_counter()
        found_riding = self._last is None and snapshot.step > 0
        self._count(snapshot)
        again = self._last == (snapshot.episode, snapshot.step)
        pose = _pose(snapshot, simulated_time)
        if found_riding and self._take_over and not snapshot.fallen:
            self._ride_on(snapshot)
        events = self.tracker.update(pose)
        if again and self._command is not None:
            return Answer(self._command, events)
        self._last = (snapshot.episode, snapshot.step)
        self._command, warning = None, ""
        if self.tracker.steers and not snapshot.fallen:
            self._command, warning = self._decide(snapshot, pose)
            self.answered += 1
            self.times.append(time.perf_counter() - started)
        return Answer(self._command, events, warning)

    def _count(self, snapshot: Snapshot) -> None:
        """Notice steps that were skipped, and start anew with a new episode."""
        if self._last is None:
            return
        episode, step = self._last
        if snapshot.episode == episode:
            self.missed += max(0, snapshot.step - step - 1)
        elif self._noise is not None:
            self._noise.reset(np.array([True]))

    def _ride_on(self, snapshot: Snapshot) -> None:
        """Take a riding bicycle over from a controller that is gone."""
        self.tracker.hold(snapshot.heading)
        if snapshot.goal is not None and self.tracker.waiting == 0:
            self.tracker.replace([snapshot.goal])

    def _decide(self, snapshot: Snapshot, pose: Pose) -> tuple[Command, str]:
        """The command for a state, and a line if the policy has just begun to fail."""
        seen = observation(snapshot, self.tracker.heading_error(pose))[None]
        speed = np.array([snapshot.speed])
        action, trouble = _act(self.policy, seen, speed)
        in_charge, warning = self.policy.policy_id, ""
        if action is None:
            self.handed_over += 1
            in_charge = self._fallback.policy_id if self._fallback else "none"
            if not self.failing:
                warning = f"policy {self.policy.policy_id} {trouble}: {in_charge} takes over"
            action = _act(self._fallback, seen, speed)[0] if self._fallback else None
            action = np.zeros(3) if action is None else action
        self.failing = bool(trouble)
        if self._noise is not None:
            known = np.where(np.isfinite(self.limits), self.limits, 0.0)
            action = action + self._noise.sample()[0] * known
        torque, displacement, pedal = np.clip(action, -self.limits, self.limits)
        goal = self.tracker.active
        command = Command(
            episode=snapshot.episode,
            step=snapshot.step,
            torque=float(torque),
            displacement=float(displacement),
            pedal_force=float(pedal),
            goal=goal.point if goal else None,
            goal_id=goal.goal_id if goal else 0,
            controller=self.name,
            policy=in_charge,
        )
        return command, warning


def _act(policy: Controller, seen: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray | None, str]:
    """A policy's action, shape (3,), or None and what was wrong with it."""
    try:
        action = np.asarray(policy.act(seen, speed), dtype=np.float64)
    except Exception as error:
        return None, f"fails with {type(error).__name__}"
    if action.shape != (1, 3):
        return None, f"gives an action of shape {action.shape}"
    if not np.isfinite(action).all():
        return None, "gives an action that is not finite"
    return action[0], ""


def _pose(snapshot: Snapshot, simulated_time: float) -> Pose:
    """What the goal tracker must know."""
    return Pose(
        episode=snapshot.episode,
        time=simulated_time,
        x=snapshot.rear_x,
        y=snapshot.rear_y,
        heading=snapshot.heading,
        fallen=snapshot.fallen,
    )
