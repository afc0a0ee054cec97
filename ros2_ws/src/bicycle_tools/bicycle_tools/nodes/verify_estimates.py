"""Estimates and commands of a bag, computed again from its sensors' readings, to the bit.

No simulator is needed, so this works on the bag of a real bicycle as well. Each estimate says
which readings it used and how many there were; from these, and the settings that the controller
left in the bag, it is made again. What the bag or the estimator lacked is told, not taken for a
difference: from there to the next rest nothing can be proved. Each command is then made again from
its estimate, by the controller's policy, fallback and safety layer. Goals are taken as recorded:
the heading error of a command is an input here.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bicycle_msgs.msg import BicycleCommand, CommandEcho, EpisodeInfo
from bicycle_msgs.msg import BicycleState as StateMessage

from bicycle_bag.errors import BagError
from bicycle_bag.versions import TodaysReader
from bicycle_common.nodes import convert
from bicycle_common.types import BicycleState, Command
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.goals import Event, Goal, GoalTracker, Pose
from bicycle_controller.control.guide import ANY_TURN, PathEnd, PlannedTurns
from bicycle_controller.estimation.order import SET_BACK
from bicycle_controller.estimation.settings import of_estimator
from bicycle_controller.estimation.steps import StepEstimator, Used
from bicycle_controller.nodes.estimator import as_state
from bicycle_controller.nodes.setup import Setup, rebuilt
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.sensors.reading import ORDER, Reading
from bicycle_tools.nodes.flatten import exact, flatten
from bicycle_tools.nodes.sensed_recording import SETUP, Sensed, read, readings_of
from bicycle_tools.ride_log import EPISODE

FIRST_ROUNDING = 1e-9
"""Largest difference, in any field's unit, for which the first estimator's rounding accounts.

It added in the order in which numpy's libraries did on its machine.
"""


@dataclass
class EstimateVerdict:
    """Result so far."""

    estimates: int = 0
    """Number of estimates that came out again, to the bit except for those that are `rounded`."""
    rounded: int = 0
    """Number of those that differ by the rounding of the first estimator, which none other may."""
    largest: float = 0.0
    """Largest difference in a field of what is rounded, in the field's unit."""
    commands: int = 0
    """Number of commands that came out again, to the bit except for `rounded_commands`."""
    rounded_commands: int = 0
    """Number of those that differ by the rounding of the first estimator's machine."""
    guided: int = 0
    """Number of those from a guide or another policy, taken as recorded apart from the limits."""
    unknown: int = 0
    """Number of commands that cannot be computed here."""
    why_unknown: str = ""
    unproved: int = 0
    """Number of estimates that cannot be made again, for readings are lacking."""
    why_unproved: str = ""
    """Words for the first that was lacking."""
    difference: str = ""
    """First that differs; empty if none does."""

    @property
    def same(self) -> bool:
        """True if every estimate and each command that can be computed came out again."""
        return not self.difference and self.estimates > 0 and not self.unproved

    def __str__(self) -> str:
        """Return the verdict as one line."""
        done = f"{self.estimates} estimates and {self.commands} commands came out again from the "
        done += "recorded sensors, bit for bit"
        if self.rounded:
            done += (
                f" but for {self.rounded} estimates and {self.rounded_commands} commands that "
                f"differ by {self.largest:.2g} at most, as the first estimator rounded"
            )
        if self.difference:
            return f"not the same after {self.estimates} equal estimates: {self.difference}"
        if self.unproved and not self.estimates:
            return f"not proved, none of {self.unproved} estimates: {self.why_unproved}"
        if self.guided:
            done += f" ({self.guided} along a path or by a policy loaded later, taken as recorded)"
        if self.unknown:
            done += f"; {self.unknown} commands cannot be computed here: {self.why_unknown}"
        if self.unproved:
            done += f"; {self.unproved} estimates are not proved: {self.why_unproved}"
        return done if self.estimates else "not proved: the bag holds no estimates"


class _Recorded(GoalTracker):
    """Goals as a bag has them: those of the command that is computed again."""

    def __init__(self) -> None:
        super().__init__()
        self.command: Command | None = None

    @property
    def active(self) -> Goal | None:
        goal = self.command.goal if self.command is not None else None
        return None if goal is None or self.command is None else Goal(self.command.goal_id, goal)

    @property
    def distance(self) -> float:
        return self.command.goal_distance if self.command is not None else math.nan

    @property
    def has_goal(self) -> bool:
        return self.active is not None

    @property
    def steers(self) -> bool:
        return self.command is not None

    def heading_error(self, pose: Pose) -> float:
        del pose
        return self.command.heading_error if self.command is not None else 0.0

    def update(self, pose: Pose) -> list[Event]:
        del pose
        return []

    def resumed(self) -> list[Event]:
        return []


@dataclass(frozen=True)
class _Path:
    """A path's guide as a bag has it."""

    command: Command
    over: bool = False

    @property
    def policy_id(self) -> str:
        return self.command.policy

    def act(self, snapshot: BicycleState, time: float) -> np.ndarray:
        del snapshot, time
        return np.array(self.command.action)

    def turns(self, speed: float) -> PlannedTurns:
        """Return room for any turn: a bag does not tell which ones were planned."""
        return ANY_TURN

    def heading_error(self, snapshot: BicycleState) -> float:
        del snapshot
        return self.command.heading_error

    def end(self, status: PathEnd, why: str) -> None:
        """Do nothing: the bag tells when it ends."""


class _LackingError(Exception):
    """An estimate cannot be made again; its text says what is lacking."""


class _Controller:
    """A controller's estimator and control loop, as recorded.

    Attributes:
        lost: True once readings or estimates are lacking, until the next rest.
        unheard: what the estimator had not received of the bag's readings before its first
            estimate; empty if it had all.
    """

    def __init__(self, setup: Setup, info: EpisodeInfo, sensed: Sensed) -> None:
        if setup.sensors is None:
            raise BagError("the bag's controller saw the truth, and yet there are estimates")
        try:
            self.scenario, self.plant = to_setting(info)
            settings = of_estimator(setup.estimator)
        except (ValueError, TypeError) as error:
            raise BagError(f"episode {info.episode} is of another release: {error}") from None
        self.setup = setup
        self.steps = StepEstimator(self.plant, setup.sensors, settings)
        self.readings = readings_of(sensed, setup.sensors)
        self.tracker = _Recorded()
        self.why_not = ""
        self.loop: ControlLoop | None = None
        try:
            self.loop = rebuilt(setup, self.plant, self.scenario, self.tracker)
        except ValueError as error:
            self.why_not = str(error)
        self.episode = -1
        self.lost = self._on_path = False
        self.unheard = ""
        self.time = -math.inf
        self.runs = dict.fromkeys(ORDER, 0)

    def follow(self, before: _Controller) -> None:
        """Follow another in the same bag; go on where it was if it is the same process."""
        self.time, self.runs = before.time, before.runs
        if before.setup.name == self.setup.name and before.plant == self.plant:
            self.steps, self.episode = before.steps, before.episode
            self.lost, self.unheard = before.lost, before.unheard

    def estimate(self, recorded: StateMessage) -> StateMessage:
        """Return the estimate that a recorded one is.

        Raises:
            _LackingError: if it cannot be made again.
        """
        time, *numbers = recorded.plant_state
        used = Used.of(numbers)
        first = used.number == 1 if used.number else recorded.episode != self.episode
        if first or recorded.episode != self.episode:
            self.episode, self.lost, self.unheard = recorded.episode, False, ""
            begun = time - recorded.step * self.plant.time_step
            self.steps.begin(begun, *self.setup.settings.start())
            self._choose_runs(time, used)
        self.time = time
        place = f"before {_place(recorded)}"
        missing = used.number - self.steps.number - 1
        if used.number and missing:
            raise _LackingError(f"the bag lacks {max(missing, 1)} estimates {place}")
        for index, sensor in enumerate(ORDER):
            there = self.readings.between(
                sensor, self.steps.last[sensor], used.stamps[index], self.runs[sensor]
            )
            if used.counts:
                there = self._counted(there, sensor, used.counts[index], first, place)
            for reading in there:
                self.steps.add(reading)
        found = self.steps.step(time)
        state = as_state(
            self.plant, found, recorded.episode, recorded.step, [time, *_numbers(self.steps, used)]
        )
        stamp = recorded.header.stamp
        return convert.from_snapshot(state, stamp.sec * 10**9 + stamp.nanosec)

    def _choose_runs(self, time: float, used: Used) -> None:
        """Choose the runs of readings in which an episode is; s of its first estimate."""
        later = int(time < self.time - SET_BACK)
        for sensor, stamp in zip(ORDER, used.stamps, strict=True):
            self.runs[sensor] = self.readings.run_with(sensor, stamp, self.runs[sensor] + later)

    def _counted(
        self, there: Sequence[Reading], sensor: str, count: int, first: bool, place: str
    ) -> Sequence[Reading]:
        """Return the readings of a sensor that an estimate used.

        Args:
            there: of the bag.
            sensor: whose.
            count: of its readings that were used since the rest, this estimate's included.
            first: True for the first estimate after the rest: its estimator may have come too
                late for the first readings.
            place: of the estimate, for the text.

        Raises:
            _LackingError: if it is not known which they are, or the bag lacks some.
        """
        needed = count - self.steps.counts[sensor]
        if len(there) < needed:
            lacking = f"{needed - len(there)} of {needed} readings of {sensor} {place}"
            raise _LackingError(f"the bag lacks {lacking}")
        if len(there) == needed:
            return there
        spare = f"{len(there) - needed} of {len(there)} readings of {sensor} {place}"
        self.unheard = self.unheard or f"the estimator had not received {spare}"
        if not first:
            raise _LackingError(self.unheard)
        return there[len(there) - needed :]

    def command(
        self, state: StateMessage, recorded: BicycleCommand | None, echo: CommandEcho | None
    ) -> tuple[Command | None, bool]:
        """Return the command that answers an estimate, and True if a path steered."""
        assert self.loop is not None
        self.tracker.command = None if recorded is None else convert.to_command(recorded)
        fallback = self.loop.fallback.policy_id if self.loop.fallback is not None else "none"
        command = self.tracker.command
        # While a fallback helps on a path, the guide still chooses the speed.
        guided = command is not None and (
            command.policy not in (self.loop.policy.policy_id, fallback)
            or (command.policy == fallback != self.loop.policy.policy_id and self._on_path)
        )
        self._on_path = guided
        self.loop.guide = _Path(command) if guided and command is not None else None
        applied = None if echo is None else convert.to_applied(echo)
        stamp = state.header.stamp
        snapshot = convert.to_snapshot(state)
        answer = self.loop.answer(snapshot, stamp.sec + stamp.nanosec * 1e-9, applied)
        return answer.command, guided


def verify(sensed: Sensed) -> Iterator[EstimateVerdict]:
    """Compute one estimate and its command after another.

    Yields:
        The verdict so far, after each recorded estimate; the last one is final.

    Raises:
        BagError: if the bag lacks what the estimates were made with.
    """
    verdict = EstimateVerdict()
    if not sensed.setups:
        raise BagError(f"the bag lacks {SETUP}: record it too")
    controller: _Controller | None = None
    before: tuple[int, int] | None = None
    for place, recorded in sensed.estimates:
        setup = _newest(sensed.setups, place)
        info = _info(sensed, recorded, place)
        if (
            controller is None
            or controller.setup is not setup
            or (recorded.episode != controller.episode and _is_other(controller, info))
        ):
            last, controller = controller, _Controller(setup, info, sensed)
            if last is not None:
                controller.follow(last)
        computed = _computed(controller, recorded, verdict)
        if computed is None:
            verdict.unproved += 1
            yield verdict
            continue
        verdict.difference = _difference(recorded, computed)
        if verdict.difference and setup.estimator == 1:
            _take_rounding(verdict, _gap(recorded, computed))
        if verdict.difference:
            verdict.difference = f"estimate of {_place(recorded)}: {verdict.difference}"
            yield verdict
            return
        verdict.estimates += 1
        key = recorded.episode, recorded.step
        goes_on = key == before or _check_command(sensed, verdict, controller, recorded)
        before = key
        yield verdict
        if not goes_on:
            return


def _computed(
    controller: _Controller, recorded: StateMessage, verdict: EstimateVerdict
) -> StateMessage | None:
    """Return a recorded estimate as it comes out again; None if it cannot be proved."""
    try:
        first = Used.of(recorded.plant_state[1:]).number == 1
    except ValueError as error:
        raise BagError(f"estimate of {_place(recorded)}: {error}") from None
    if controller.lost and not first and recorded.episode == controller.episode:
        return None
    try:
        computed = controller.estimate(recorded)
        if controller.unheard and _difference(recorded, computed):
            raise _LackingError(controller.unheard)
    except _LackingError as error:
        controller.lost = True
        verdict.why_unproved = verdict.why_unproved or str(error)
        return None
    return computed


def _take_rounding(verdict: EstimateVerdict, gap: float) -> None:
    """Let the first estimator's rounding account for a difference."""
    if gap <= FIRST_ROUNDING:
        verdict.difference = ""
        verdict.rounded, verdict.largest = verdict.rounded + 1, max(verdict.largest, gap)


def _newest(setups: list[tuple[int, Setup]], place: int) -> Setup:
    """Return the setup that held at a place: a latched one may be recorded late."""
    held = [setup for at, setup in setups if at <= place]
    return held[-1] if held else setups[0][1]


def _info(sensed: Sensed, state: StateMessage, place: int) -> EpisodeInfo:
    found = [(abs(at - place), n) for n, (at, _) in enumerate(sensed.episodes)]
    found = [pair for pair in found if sensed.episodes[pair[1]][1].episode == state.episode]
    if not found:
        raise BagError(f"the bag lacks the settings of episode {state.episode}: record {EPISODE}")
    return sensed.episodes[min(found)[1]][1]


def _is_other(controller: _Controller, info: EpisodeInfo) -> bool:
    """Return True if an episode is ridden on another bicycle, or under other limits."""
    scenario, plant = to_setting(info)
    return bool(plant != controller.plant) or scenario != controller.scenario


def _check_command(
    sensed: Sensed, verdict: EstimateVerdict, controller: _Controller, state: StateMessage
) -> bool:
    """Compute the command that answers an estimate; return False if it differs."""
    key = state.episode, state.step
    sent = [one for one in sensed.commands.get(key, ()) if one.controller == controller.setup.name]
    if controller.loop is None:
        verdict.unknown += len(sent) > 0
        verdict.why_unknown = controller.why_not
        return True
    computed, guided = controller.command(state, sent[0] if sent else None, sensed.echoes.get(key))
    if not sent:
        return True
    if computed is None:
        verdict.difference = f"command of {_place(state)}: none comes out"
        return False
    message = convert.from_command(computed, sent[0].header.stamp)
    found = _difference(sent[0], message)
    if found and controller.setup.estimator == 1:
        # The gains of its LQR were computed on a machine that rounded otherwise, too.
        gap = _gap(sent[0], message)
        if gap <= FIRST_ROUNDING:
            found, verdict.largest = "", max(verdict.largest, gap)
            verdict.rounded_commands += 1
    if found:
        verdict.difference = f"command of {_place(state)}: {found}"
        return False
    verdict.commands += 1
    verdict.guided += guided
    return True


def _numbers(steps: StepEstimator, used: Used) -> list[float]:
    """Return what an estimate tells of its readings; the first estimator told their stamps."""
    return steps.used.numbers if used.number else list(steps.used.stamps)


def _place(state: StateMessage) -> str:
    return f"step {state.step} of episode {state.episode}"


def _difference(recorded: Any, computed: Any) -> str:
    """Return the first field that differs, by its bits; empty if none does."""
    for (name, old), (_, new) in zip(flatten(recorded), flatten(computed), strict=False):
        if exact(old) != exact(new):
            return f"{name} was {old!r} and comes out as {new!r}"
    return ""


def _gap(recorded: Any, computed: Any) -> float:
    """Return the largest difference of two numbers; infinite if anything else differs."""
    largest = 0.0
    for (_, old), (_, new) in zip(flatten(recorded), flatten(computed), strict=True):
        if exact(old) == exact(new):
            continue
        pairs = zip(old, new, strict=True) if isinstance(old, list) else [(old, new)]
        for a, b in pairs:
            apart = abs(a - b) if isinstance(a, float) else math.inf
            largest = max(largest, apart if math.isfinite(apart) else math.inf)
    return largest


def verify_bag(path: Path) -> EstimateVerdict:
    """Verify the estimates and commands of a bag.

    Raises:
        BagError: see `read` and `verify`.
    """
    found = deque(verify(read(TodaysReader(path))), maxlen=1)
    return found.pop() if found else EstimateVerdict()
