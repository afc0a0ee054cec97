"""One command for every state: goals, the active policy, its fallback, exploration."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_common.observation import observation
from bicycle_common.types import AppliedCommand, BicycleState, Command
from bicycle_controller.control.control_output import ControllerSwitch, ControlOutput
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.exploration_noise import Noise
from bicycle_controller.control.goals import GoalTracker, Pose
from bicycle_controller.control.guide import Guide, PathEnd, PlannedTurns
from bicycle_controller.control.keep_clear import Mover
from bicycle_controller.control.riding import Riding
from bicycle_controller.control.safety import Reason, Safety, stopping_pedal
from bicycle_controller.control.standby import Standby
from bicycle_controller.control.swerve import Swerve, pedal_at_most
from bicycle_sim.plants.base import Plant

TIMES_KEPT = 2000
"""Number of answers whose computing times are kept: 50 s at 40 Hz."""
SPEED_IS_WELL = (Reason.EXTRAPOLATED_LEAN, Reason.LEAN, Reason.LEAN_RATE, Reason.STALE)
"""Reasons for which the fallback steers while a guide may still choose the speed."""
QUICK = 0.0005
"""Largest duration of a policy that is warmed up (s); a slower one would delay the next state."""


class ControlLoop:
    """Answers states in the order of arrival; the same state again gets the same command.

    Attributes:
        policy: active policy; may be replaced between two answers.
        fallback: controls when the policy may not; may be replaced too.
        safety: judges every state; may be replaced too.
        plant: the ridden bicycle, for a policy with its parameters as inputs; may be replaced too.
        limits: (3,) largest |T| (N m), |d| (m), |F| (N) to send; infinite if unknown.
        answered: number of answered states.
        missed: number of steps that were never seen.
        handed_over: number of answers that the fallback gave.
        failing: True if the policy failed at the last answer.
        standby: detects that another controller drives.
        guide: steers in place of the policy, along a path or by cmd_vel; None for goals.
        swerve: how it passes other bicycles on the way to goals.
        slowest: lowest speed to give way with, m/s.
        times: computing times of the latest answers, s.
        policy_times: the policy's own part of them, s, if it was asked.
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
        safety: Safety | None = None,
        plant: Plant[Any] | None = None,
    ) -> None:
        """Create the loop before the first state.

        Args:
            name: unique name in every command.
            policy: active policy.
            tracker: tracks the goals.
            limits: (3,) N m, m, N.
            noise: exploration in normalised actions of one bicycle; none by default.
            fallback: answers if the policy fails; without one, zero input.
            take_over: True to continue a ride that is found in progress, to its goal.
            safety: layer for one bicycle that switches to the fallback in time; without one, the
                fallback answers only if the policy fails.
            plant: the ridden bicycle, if it is known.
        """
        self.name = name
        self.policy = policy
        self.tracker = tracker
        self.limits = limits
        self.answered = self.missed = self.handed_over = 0
        self.times: deque[float] = deque(maxlen=TIMES_KEPT)
        self.policy_times: deque[float] = deque(maxlen=TIMES_KEPT)
        self._noise = noise
        self.fallback = fallback
        self.safety = safety
        self.plant = plant
        self._riding: Riding | None = None
        self._fallback_riding: Riding | None = None
        self._ridden: Plant[Any] | None = None
        self._judged = policy
        self._asked: tuple[np.ndarray, np.ndarray] | None = None
        self._stopped_for: int | None = None
        self._take_over = take_over
        self._last: tuple[int, int] | None = None
        self._command: Command | None = None
        self.failing = False
        self.standby = Standby(name)
        self.guide: Guide | None = None
        self.swerve, self.slowest = Swerve(), 2.0
        self._time = 0.0

    def answer(
        self, snapshot: BicycleState, simulated_time: float, applied: AppliedCommand | None = None
    ) -> ControlOutput:
        """Answer one state.

        Args:
            snapshot: the state.
            simulated_time: its time, s.
            applied: the command that led to it; None if that is not known, as on a bicycle whose
                driver does not tell.

        No command answers a state older than one already answered, a state after a fall, or a
        state that another controller drives to.
        """
        started = time.perf_counter()
        found_riding = self._last is None and snapshot.step > 0
        steps = self._count(snapshot)
        again = self._last == (snapshot.episode, snapshot.step)
        self._time = simulated_time
        self._keep_guide(snapshot)
        pose = _pose(snapshot, simulated_time)
        if found_riding and self._take_over and not snapshot.fallen:
            self._ride_on(snapshot, applied)
        regained = self.standby.look(applied)
        resumed = self.tracker.resumed() if regained else []
        events = resumed + self.standby.of_own(self.tracker.update(pose))
        if again and self._command is not None:
            return ControlOutput(self._command, events)
        self._last = (snapshot.episode, snapshot.step)
        self._command, warning, hand_over = None, self.standby.warning(), None
        if self.standby.keeps_out(applied, again):
            return ControlOutput(None, events, warning)
        if (self.tracker.steers or self.guide is not None) and not snapshot.fallen:
            self._command, warning, hand_over = self._decide(snapshot, pose, steps, applied)
            self.answered += 1
            self.times.append(time.perf_counter() - started)
        return ControlOutput(self._command, events, warning, hand_over)

    def steer_by(self, guide: Guide | None) -> None:
        """Let a guide steer from the next state on, or the policy again."""
        if self.guide is not None and guide is not self.guide:
            self.guide.end(PathEnd.REPLACED, "a newer order came")
        self.guide = guide
        if guide is not None:
            self._stopped_for = None

    def _keep_guide(self, snapshot: BicycleState) -> None:
        """End the guide with a fall, or with a new episode."""
        if self.guide is None or self._last is None:
            return
        if snapshot.episode != self._last[0]:
            self.guide.end(PathEnd.CANCELLED, "the simulator was reset")
        elif snapshot.fallen:
            self.guide.end(PathEnd.FALLEN, "the bicycle fell")

    def _count(self, snapshot: BicycleState) -> int:
        """Count skipped steps, and restart the count with a new episode.

        Returns:
            The number of steps since the last state, at least 1.
        """
        if self._last is None:
            return 1
        episode, step = self._last
        if snapshot.episode == episode:
            skipped = snapshot.step - step - 1
            if skipped > 0:
                self.missed += skipped
                for riding in self._ridings():
                    riding.missed(skipped)
            return max(1, skipped + 1)
        self._stopped_for = None
        for riding in self._ridings():
            riding.reset()
        if self._noise is not None:
            self._noise.reset(np.array([True]))
        if self.safety is not None:
            self.safety.reset()
        return 1

    def _ride_on(self, snapshot: BicycleState, applied: AppliedCommand | None) -> None:
        """Take over a riding bicycle from a controller that has gone."""
        self.tracker.hold(snapshot.heading)
        goal = applied.goal if applied is not None else None
        if goal is not None and self.tracker.waiting == 0:
            self.tracker.replace([goal])

    def _decide(
        self, snapshot: BicycleState, pose: Pose, steps: int, applied: AppliedCommand | None
    ) -> tuple[Command, str, ControllerSwitch | None]:
        """Return the command for a state, a line if the policy begins to fail, and any switch."""
        guide = self.guide
        if guide is not None and guide.over:
            guide = None
            if not self.tracker.has_goal:
                self.tracker.hold(snapshot.heading)
        error = (
            self.tracker.heading_error(pose) if guide is None else guide.heading_error(snapshot)
        )
        most = None
        if guide is None and self.swerve.others:
            error, most = self._beside_others(snapshot, error)
        seen, speed = observation(snapshot, error)[None], np.array([snapshot.speed])
        lateness = 0.0 if applied is None else applied.lateness(snapshot.step)
        action, in_charge, warning, hand_over = self._choose(
            snapshot, seen, speed, lateness, guide
        )
        if most is not None:
            action[2] = pedal_at_most(action[2:], speed, most)[0]
        if self._noise is not None:
            known = np.where(np.isfinite(self.limits), self.limits, 0.0)
            action = action + self._noise.sample()[0] * known
        action = action.clip(-self.limits, self.limits)
        if self.safety is not None:
            action = self.safety.limit(action[None], steps)[0]
        self._follow_fallback()
        for riding in self._ridings():
            riding.acted(seen, speed, action[None])
        torque, displacement, pedal = action.tolist()
        goal = self.tracker.active
        command = Command(
            episode=snapshot.episode,
            step=snapshot.step,
            torque=torque,
            displacement=displacement,
            pedal_force=pedal,
            goal=goal.point if goal else None,
            goal_id=goal.goal_id if goal else 0,
            controller=self.name,
            policy=in_charge,
            heading_error=float(seen[0, -1]),
            goal_distance=self.tracker.distance,
        )
        return command, warning, hand_over

    def _beside_others(self, snapshot: BicycleState, error: float) -> tuple[float, np.ndarray]:
        """Return psi_g by which it keeps clear of others, rad, and the highest speed, (1,) m/s."""
        way = snapshot.heading - error
        numbers = snapshot.rear_x, snapshot.rear_y, way, snapshot.speed
        self.swerve.pedals = bool(self.limits[2] > 0.0)
        most, aside = self.swerve.look(
            Mover(*(np.array([value]) for value in numbers)), self.slowest
        )
        return float(wrap_angle(error - aside[0])), most

    def _choose(
        self,
        snapshot: BicycleState,
        seen: np.ndarray,
        speed: np.ndarray,
        lateness: float,
        guide: Guide | None,
    ) -> tuple[np.ndarray, str, str, ControllerSwitch | None]:
        """Return the action (3,), the id of its controller, and the text to report."""
        before = self._driven_by_fallback
        trouble, guided, turns = "", None, None
        if guide is not None:  # it is asked even while the fallback drives: it counts the way
            guided = guide.act(snapshot, self._time)
            turns = guide.turns(snapshot.speed)
            if not np.isfinite(guided).all():
                guided, trouble = None, "gave no finite command on the path"
        may = self.safety is None or self._judge(self.safety, seen, speed, lateness, turns)
        action: np.ndarray | None = None
        if may and guided is not None:
            action = guided
        elif may and not trouble:
            action, trouble = self._ask(seen, speed)
        if trouble and self.safety is not None:
            self.safety.fail(np.array([True]))
        warning = ""
        if trouble and not self.failing:
            warning = f"policy {self.policy.policy_id} {trouble}: {self._fallback_id} takes over"
        self.failing = bool(trouble)
        if action is None:
            self.handed_over += 1
            self._follow_fallback()
            riding = self._fallback_riding
            given = _answer(riding, seen, speed)[0] if riding else None
            action = np.zeros(3) if given is None else given
            if guided is not None and self.safety and self.safety.reason[0] in SPEED_IS_WELL:
                action[2] = guided[2]  # the path's speed; the fallback has one of its own
            if self._stopped_for is not None:
                action[2] = stopping_pedal(snapshot.speed)
            in_charge = self._fallback_id
        else:
            in_charge = self.policy.policy_id if guide is None else guide.policy_id
        switch = self._tell(snapshot, trouble) if before != self._driven_by_fallback else None
        return action, in_charge, "" if switch else warning, switch

    def _ask(self, seen: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray | None, str]:
        """Return the policy's answer, see `_answer`, and record its computing time."""
        self._asked = seen, speed
        started = time.perf_counter()
        found = self._act(seen, speed)
        self.policy_times.append(time.perf_counter() - started)
        return found

    def warm_up(self) -> None:
        """Repeat the policy's last computation and discard the result.

        After 25 ms the policy has left the processor's cache; run just before the next state
        arrives, this makes that answer faster.
        """
        if self._asked is not None and self.policy_times[-1] < QUICK:
            self._act(*self._asked)

    def _act(self, seen: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray | None, str]:
        """Return the policy's action with its memory of the ride, see `_answer`."""
        riding = self._riding
        if (
            riding is None
            or riding.controller is not self.policy
            or self._ridden is not self.plant
        ):
            try:
                riding = Riding(self.policy, 1, self.plant)
            except ValueError as error:
                return None, f"cannot ride: {error}"
            self._riding, self._ridden = riding, self.plant
        return _answer(riding, seen, speed)

    def _follow_fallback(self) -> None:
        """Remember the ride for the current fallback too, with the commands under way."""
        riding = self._fallback_riding
        if self.fallback is None:
            self._fallback_riding = None
        elif riding is None or riding.controller is not self.fallback:
            self._fallback_riding = Riding(self.fallback, 1, self.plant)

    def _ridings(self) -> list[Riding]:
        """Return the rides that are remembered, of the policy and of the fallback."""
        return [one for one in (self._riding, self._fallback_riding) if one is not None]

    @property
    def driving(self) -> str:
        """Id of the controller that drives instead of the policy; empty if the policy drives."""
        return self._fallback_id if self._driven_by_fallback else ""

    def safety_facts(self) -> dict[str, int]:
        """Return the safety layer's counters, by name."""
        if self.safety is None:
            return {}
        return {
            "hand-overs": int(self.safety.hand_overs[0]),
            "commands cut in their change": int(self.safety.limited[0]),
        }

    @property
    def _fallback_id(self) -> str:
        return self.fallback.policy_id if self.fallback else "none"

    @property
    def _driven_by_fallback(self) -> bool:
        """True if the safety layer has switched to the fallback."""
        return self.safety is not None and (
            bool(self.safety.reason[0]) or self._stopped_for is not None
        )

    def _judge(
        self,
        safety: Safety,
        seen: np.ndarray,
        speed: np.ndarray,
        lateness: float,
        turns: PlannedTurns | None,
    ) -> bool:
        """Return True if the policy may answer a state, whose command was late by some steps."""
        if self.policy is not self._judged:
            self._judged = self.policy
            safety.reset()
        goal = self.tracker.active
        if self._stopped_for is not None and goal and goal.goal_id != self._stopped_for:
            self._stopped_for = None
        reason = safety.judge(seen, speed, np.array([lateness]), turns)[0]
        return not reason and self._stopped_for is None

    def _tell(self, snapshot: BicycleState, trouble: str) -> ControllerSwitch:
        """Return the latest switch, and end the pursuit of the goal if a stop is requested."""
        assert self.safety is not None
        reason = Reason(int(self.safety.reason[0]))
        policy, fallback = self.policy.policy_id, self._fallback_id
        text = f"calm again: policy {policy} drives"
        if reason:
            what = f"policy {policy} {trouble}" if trouble else self.safety.explain()
            text = f"{what}: {fallback} takes over from policy {policy}"
            if trouble:
                text = f"{what}: {fallback} takes over"
        if reason and self.safety.config.stop:
            goal = self.tracker.active
            self._stopped_for = goal.goal_id if goal else 0
            self.tracker.cancel("the safety layer stops the bicycle")
            if self.guide is not None:
                self.guide.end(PathEnd.CANCELLED, "the safety layer stops the bicycle")
            text += ", rides straight on and slows down: send a new goal to go on"
        return ControllerSwitch(
            episode=snapshot.episode,
            step=snapshot.step,
            reason=reason,
            stop=self._stopped_for is not None,
            policy=fallback if reason else policy,
            count=int(self.safety.hand_overs[0]),
            message=text,
        )


def _answer(
    policy: Controller | Riding, seen: np.ndarray, speed: np.ndarray
) -> tuple[np.ndarray | None, str]:
    """Return a policy's action, shape (3,), or None and its error."""
    try:
        action = np.asarray(policy.act(seen, speed), dtype=np.float64)
    except Exception as error:
        return None, f"fails with {type(error).__name__}"
    if action.shape != (1, 3):
        return None, f"gives an action of shape {action.shape}"
    if not all(map(math.isfinite, action[0].tolist())):
        return None, "gives an action that is not finite"
    return action[0], ""


def _pose(snapshot: BicycleState, simulated_time: float) -> Pose:
    """Return the pose that the goal tracker needs."""
    return Pose(
        episode=snapshot.episode,
        time=simulated_time,
        x=snapshot.rear_x,
        y=snapshot.rear_y,
        heading=snapshot.heading,
        fallen=snapshot.fallen,
    )
