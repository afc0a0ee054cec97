"""Conversions of messages for the page."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from bicycle_msgs.msg import BicycleCommand, BicycleState, CommandEcho, TrainerStatus
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from bicycle_cockpit.samples import ESTIMATED, REWARDED, Sample, plain, reward_columns
from bicycle_common.geometry import wrap_angle
from bicycle_common.types import Point2D
from bicycle_controller.policy.trained_for import UNLIKE
from bicycle_sim.task.reward import RewardWeights

OLDEST_ESTIMATE = 1.0
"""Age up to which an estimate is shown (s)."""


def to_sample(
    state: BicycleState,
    echo: CommandEcho | None,
    command: BicycleCommand | None,
    weights: RewardWeights,
    policy: float = math.nan,
    estimate: BicycleState | None = None,
) -> Sample:
    """Return the row of one state.

    Args:
        state: the state.
        echo: of the command that led to it; None if nobody tells.
        command: the newest one.
        weights: of the reward's terms.
        policy: number of the newest command's policy.
        estimate: the newest one; that of another episode is left out.
    """
    stamp = state.header.stamp
    error, distance = bearing(state, echo)
    rewarded = {name: getattr(state, name) for name in REWARDED if name != "heading_error"}
    rewarded["heading_error"] = error
    acts = ("torque", "displacement", "pedal_force")
    chosen = [getattr(command, name) if command else math.nan for name in acts]
    return Sample(
        stamp.sec + 1e-9 * stamp.nanosec,
        state.episode,
        state.step,
        state.rear_contact.x,
        state.rear_contact.y,
        state.heading,
        state.lean_angle,
        state.lean_rate,
        state.steer_angle,
        state.speed,
        distance,
        error,
        echo.command_source if echo is not None else math.nan,
        *[*chosen, policy],
        *reward_columns(rewarded, weights),
        *estimated_columns(estimate, state),
    )


def estimated_columns(estimate: BicycleState | None, state: BicycleState) -> list[float]:
    """Return the columns of an estimate; NaN and the state's time without a fresh one."""
    now = seconds(state)
    if estimate is None or estimate.episode != state.episode:
        return [now] + [math.nan] * (len(ESTIMATED) - 1)
    time, place = seconds(estimate), estimate.rear_contact
    if not 0.0 <= now - time <= OLDEST_ESTIMATE:  # of an earlier ride, or of a dead estimator
        return [now] + [math.nan] * (len(ESTIMATED) - 1)
    angles = (estimate.heading, estimate.lean_angle, estimate.steer_angle)
    return [time, place.x, place.y, *angles, estimate.speed]


def seconds(state: BicycleState) -> float:
    """Return a state's time, s."""
    return float(state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec)


def bearing(state: BicycleState, echo: CommandEcho | None) -> tuple[float, float]:
    """Return heading error (rad, positive to the left) and distance (m) of the pursued goal.

    Both are NaN without a goal.
    """
    if echo is None or not echo.command.has_goal:
        return math.nan, math.nan
    x, y = echo.command.goal.x - state.rear_contact.x, echo.command.goal.y - state.rear_contact.y
    return float(wrap_angle(math.atan2(y, x) - state.heading)), math.hypot(x, y)


def points_of(message: PoseStamped | Path) -> list[Point2D]:
    """Return the points of a goal or a path."""
    poses = message.poses if isinstance(message, Path) else [message]
    return [(pose.pose.position.x, pose.pose.position.y) for pose in poses]


def trainer_facts(status: TrainerStatus) -> dict[str, Any]:
    """Return the trainer's status for the page."""
    names = [name for name in status.get_fields_and_field_types() if name != "header"]
    values = {name: getattr(status, name) for name in names}
    shown = {k: plain(v) if isinstance(v, float) else v for k, v in values.items()}
    return {"type": "trainer", **shown}


class SimulatorWord(NamedTuple):
    """Simulator's diagnostics."""

    mode: str
    """riding, paused, held or fallen."""
    paused: bool
    """True if time stands still, in any mode."""
    commands: str
    """The simulator's line about commands."""


def simulator_word(entries: Iterable[DiagnosticStatus]) -> SimulatorWord | None:
    """Read the simulator's diagnostics; None for others'."""
    by_subject = _by_subject(entries)
    if "bicycle" not in by_subject or "commands" not in by_subject:
        return None
    values = {pair.key: pair.value for pair in by_subject["bicycle"].values}
    mode = values.get("mode", "riding")
    paused = values.get("paused", str(mode == "paused")) == "True"
    return SimulatorWord(mode, paused, str(by_subject["commands"].message))


class ControllerWord(NamedTuple):
    """Controller's diagnostics."""

    policy: str
    """Id of its active policy."""
    unlike: str
    """Difference of the ride from the policy's training; empty if there is none."""


def controller_word(entries: Iterable[DiagnosticStatus]) -> ControllerWord | None:
    """Read the controller's diagnostics; None for others'."""
    status = _by_subject(entries).get("policy")
    values = {pair.key: pair.value for pair in status.values} if status is not None else {}
    if not values.get("policy"):
        return None
    unlike = values.get(UNLIKE, "no")
    return ControllerWord(values["policy"], "" if unlike == "no" else unlike)


def _by_subject(entries: Iterable[DiagnosticStatus]) -> dict[str, DiagnosticStatus]:
    return {entry.name.rpartition(": ")[2]: entry for entry in entries}
