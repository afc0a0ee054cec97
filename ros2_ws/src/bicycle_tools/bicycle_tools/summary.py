"""Numbers of a ride, from its bag alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_controller.control.goals import Status
from bicycle_controller.control.guide import PathEnd
from bicycle_tools.drawing import drawable
from bicycle_tools.outcomes import DECIDED, GoalOutcome, outcomes
from bicycle_tools.recorded_here import OPEN
from bicycle_tools.ride_log import Columns, RideLog

HELD, ZERO = 2, 3
"""SOURCE_HELD and SOURCE_ZERO of BicycleState."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Quantiles:
    """Distribution of a duration, s; NaN if nothing was measured."""

    p50: float
    p99: float
    largest: float

    @classmethod
    def of(cls, values: Floats) -> Quantiles:
        """Return the quantiles of the finite values."""
        finite = values[np.isfinite(values)]
        if not len(finite):
            return cls(np.nan, np.nan, np.nan)
        p50, p99 = np.quantile(finite, (0.5, 0.99))
        return cls(float(p50), float(p99), float(finite.max()))


@dataclass(frozen=True)
class LoopSummary:
    """Punctuality of the simulator and speed of the controller."""

    lockstep: bool
    rate: float
    """Hz, one over the mean period."""
    jitter: Quantiles
    """|period - median period|."""
    lateness: Quantiles
    """Delay after the step was due; NaN in lock-step."""
    latency: Quantiles
    """Time from publishing a state to receiving the command that answers it."""
    late_steps: int
    dropped_steps: int
    held_steps: int
    """Number of steps under an older command."""
    zero_steps: int
    """Number of steps without any command."""
    watchdog_events: int
    """Number of times that commands stopped."""
    lost_steps: int
    """Number of steps missing in the bag."""


@dataclass(frozen=True)
class FollowedPath:
    """End of one path that was followed."""

    name: str
    status: str
    """`finished`, `lost`, ..., `active` if the recording ended before, or `unknown` if it is of a
    later release."""
    length: float
    """m of all laps."""
    rms: float
    """m, root of the mean squared cross-track error."""
    largest: float
    """m."""
    elapsed: float
    """s of simulated time."""
    message: str

    @property
    def verdict(self) -> str:
        """The main numbers in a few words."""
        off = f", {self.rms:.2f} m off (RMS)" if math.isfinite(self.rms) else ""
        return f"{self.name or 'path'} {self.status}{off}"


@dataclass(frozen=True)
class RideSummary:
    """One ride in numbers."""

    goals: int
    reached: int
    missed: int
    given_up: int
    falls: int
    episodes: int
    ridden_time: float
    """Simulated time, s."""
    path_length: float
    """Path length of the rear contact, m; NaN if no place is known."""
    path_ratio: float
    """Path over straight line, of the goals reached that were recorded from their beginning;
    NaN without one."""
    mean_speed: float
    """m/s; NaN with the path length."""
    peak_lean: float
    """rad; NaN if none is known."""
    policies: tuple[str, ...]
    """Ids of the policies that controlled the bicycle."""
    loop: LoopSummary
    messages: int
    """Number of messages in the bag."""
    decided: int = 0
    """Number of goals that were reached, missed, given up, or lost by a fall."""
    open: int = 0
    """Number of goals that were waiting or active when the recording ended."""
    begun_before: int = 0
    """Number of goals that were active when the recording began."""
    paths: tuple[FollowedPath, ...] = ()
    """Ends of the paths that were followed."""

    @property
    def perfect(self) -> bool:
        """True if every goal was reached without a fall."""
        return self.falls == 0 and self.reached == self.goals > 0

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; a value that was not measured is None."""
        plain = _without_nan(asdict(self))
        assert isinstance(plain, dict)
        return plain


def summarise(log: RideLog) -> RideSummary:
    """Sum up a ride."""
    goals = outcomes(log.statuses)
    counts = {status: sum(goal.status is status for goal in goals) for status in Status}
    states, segment = log.states, log.segment
    path = path_length(states, segment)
    ridden = _ridden_time(states, segment)
    return RideSummary(
        goals=len(goals),
        reached=counts[Status.REACHED],
        missed=counts[Status.MISSED],
        given_up=counts[Status.GIVEN_UP],
        falls=_rises(states["fallen"].astype(bool), segment),
        episodes=len(np.unique(segment)),
        ridden_time=ridden,
        path_length=path,
        path_ratio=path_ratio(goals),
        mean_speed=path / ridden if ridden > 0 else 0.0,
        peak_lean=_peak(states["lean_angle"]),
        policies=tuple(dict.fromkeys(str(name) for name in log.commands.get("policy", ()))),
        loop=summarise_loop(log),
        messages=log.message_count,
        decided=sum(counts[status] for status in DECIDED),
        open=sum(counts[status] for status in OPEN),
        begun_before=sum(goal.begun_before for goal in goals),
        paths=path_ends(log.path_statuses),
    )


def path_ends(statuses: Columns) -> tuple[FollowedPath, ...]:
    """Return the last status of every path, in order."""
    last = {int(number): row for row, number in enumerate(statuses.get("path_id", ())) if number}
    return tuple(
        FollowedPath(
            name=str(statuses["name"][row]),
            status=_path_end(int(statuses["status"][row])),
            length=float(statuses["length"][row]),
            rms=float(statuses["rms"][row]),
            largest=float(statuses["largest"][row]),
            elapsed=float(statuses["elapsed"][row]),
            message=str(statuses["message"][row]),
        )
        for row in last.values()
    )


def _path_end(number: int) -> str:
    return PathEnd(number).name.lower() if number in set(PathEnd) else "unknown"


def summarise_loop(log: RideLog) -> LoopSummary:
    """Sum up the timing of a ride."""
    timing = log.timing
    period = _floats(timing, "period")
    lateness = _floats(timing, "lateness")
    known = period[np.isfinite(period)]
    middle = _usual(timing)
    source = log.states["command_source"]
    gaps = np.diff(log.states["step"].astype(np.int64))[np.diff(log.segment) == 0] - 1
    return LoopSummary(
        lockstep=bool(len(known)) and not np.isfinite(lateness).any(),
        rate=1.0 / float(known.mean()) if len(known) and known.mean() > 0 else np.nan,
        jitter=Quantiles.of(np.abs(period - middle)),
        lateness=Quantiles.of(lateness),
        latency=Quantiles.of(_floats(timing, "latency")),
        late_steps=late_steps(timing),
        dropped_steps=dropped_steps(timing),
        held_steps=int((source == HELD).sum()),
        zero_steps=int((source == ZERO).sum()),
        watchdog_events=_rises(source == ZERO, log.segment),
        lost_steps=int(gaps.sum()) + _lost_at_starts(log),
    )


def _lost_at_starts(log: RideLog) -> int:
    """Count states that are missing at the starts of episodes whose first command is recorded.

    That command shows that the recorder listened by then. Without it the recording began later.
    """
    if not len(log.commands.get("step", ())):
        return 0
    begun = np.unique(log.commands["episode"][log.commands["step"] == 0])
    steps = log.states["step"].astype(np.int64)
    firsts = [steps[log.states["episode"] == episode] for episode in begun]
    return sum(int(first.min()) for first in firsts if len(first))


def path_length(states: Columns, segment: NDArray[np.intp]) -> float:
    """Return the path length of the rear contact, m, without the jumps of resets.

    Legs from and to places that are not known are left out; NaN if there is no other.
    """
    x, y = (np.diff(drawable(states[f"rear_contact.{axis}"])) for axis in "xy")
    legs = np.hypot(x, y)[np.diff(segment) == 0]
    known = np.isfinite(legs)
    return float(legs[known].sum()) if known.any() or not len(legs) else np.nan


def _peak(values: Floats) -> float:
    """Return the largest magnitude that is known; NaN if none is, 0 of nothing."""
    known = np.abs(values[np.isfinite(drawable(values))])
    return float(known.max(initial=0.0)) if len(known) or not len(values) else np.nan


def path_ratio(goals: Iterable[GoalOutcome]) -> float:
    """Return the path over the straight line, of the goals reached; 1 is a straight ride."""
    reached = [
        goal
        for goal in goals
        if goal.status is Status.REACHED and goal.straight > 0 and not goal.begun_before
    ]
    if not reached:
        return float("nan")
    return sum(goal.path_length for goal in reached) / sum(goal.straight for goal in reached)


def _ridden_time(states: Columns, segment: NDArray[np.intp]) -> float:
    """Return the simulated time within the segments, s, minus the time lying on the ground."""
    moving = (np.diff(segment) == 0) & ~states["fallen"][:-1].astype(bool)
    return float(np.diff(states["header.stamp"])[moving].sum())


def _rises(flag: NDArray[np.bool_], segment: NDArray[np.intp]) -> int:
    """Count how often a flag became True, including at a segment's first state."""
    if not len(flag):
        return 0
    risen = flag.copy()
    risen[1:] &= ~flag[:-1] | (np.diff(segment) != 0)
    return int(risen.sum())


def _floats(columns: Columns, name: str) -> Floats:
    return np.asarray(columns.get(name, ()), dtype=np.float64)


def late_steps(timing: Columns) -> int:
    """Return the number of recorded steps that began later than half a period."""
    return _counted(timing, "late_steps", lambda lateness, period: int(lateness > 0.5 * period))


def dropped_steps(timing: Columns) -> int:
    """Return the number of whole periods that were skipped during a recording."""
    return _counted(timing, "dropped_steps", lambda lateness, period: int(lateness // period))


def _counted(columns: Columns, name: str, own: Callable[[float, float], int]) -> int:
    """Return the increase of a counter of LoopTiming during a recording.

    The counter starts at zero with the simulator, so a recording that begins later finds it above
    zero, and it restarts at zero with a new simulator.

    Args:
        columns: of LoopTiming.
        name: the counter's name.
        own: what a step adds to the counter, from its lateness and the period, s.
    """
    values = np.asarray(columns.get(name, ()), dtype=np.int64)
    if not len(values):
        return 0
    restarts = np.flatnonzero(np.diff(values) < 0)
    lateness, period = float(columns["lateness"][0]), _usual(columns)
    known = np.isfinite(lateness) and period > 0
    first = min(int(values[0]), max(0, own(lateness, period))) if known else 0
    return int(values[-1] + values[restarts].sum() - values[0]) + first


def _usual(timing: Columns) -> float:
    """Return the median period, s; NaN if none was measured."""
    period = _floats(timing, "period")
    known = period[np.isfinite(period)]
    return float(np.median(known)) if len(known) else np.nan


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_nan(item) for name, item in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value
