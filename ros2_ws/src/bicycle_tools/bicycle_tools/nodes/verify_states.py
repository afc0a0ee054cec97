"""States of a bag, computed again from its commands and compared bit for bit.

Each state is computed from the one before and the command that the bag says was applied, converted
to a message, and compared with the recorded one field by field, floats by their bits; the raw
messages differ in the undefined padding between fields. On another kind of processor numpy's
functions differ in their last bits; such states are counted separately, and the next one is
computed from the recorded state again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from itertools import product
from typing import Any

from bicycle_msgs.msg import BicycleState, CommandEcho

from bicycle_bag.errors import BagError
from bicycle_common.nodes import convert
from bicycle_common.types import Command, CommandSource
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.runtime.simulator import Simulator
from bicycle_tools.nodes.flatten import exact, flatten
from bicycle_tools.nodes.ride_recording import Recording, decoded
from bicycle_tools.ride_log import EPISODE

ROUNDING = 1e-9
"""Largest effect of rounding on one step, in any field's unit; errors are larger."""


@dataclass
class StateVerdict:
    """Result of a verification so far."""

    checked: int = 0
    """Number of recomputed states that are equal, except for rounding."""
    rounded: int = 0
    """Number of checked states that differ by rounding."""
    largest: float = 0.0
    """Largest difference in a field of a rounded state, in the field's unit."""
    begun: int = 0
    """Number of states without a predecessor: the starts of episodes and of the recording."""
    head: int = 0
    """Number of states before the first recorded command, if the recorder joined late."""
    begins: str = ""
    """First verified state, if that is not the start of an episode."""
    led: bool = False
    """True if a state was computed under a recorded command."""
    unknown: int = 0
    """Number of states that cannot be computed, because a state or command is missing."""
    first_unknown: str = ""
    """First unknown state."""
    difference: str = ""
    """First state that differs; empty if none does."""

    @property
    def same(self) -> bool:
        """True if every state with a predecessor was reproduced, except for rounding."""
        return not self.difference and not self.unknown and self.checked > 0

    @property
    def proved(self) -> bool:
        """True if they were reproduced to the bit."""
        return self.same and not self.rounded

    def __str__(self) -> str:
        """Return the verdict as one line."""
        if self.difference:
            return f"not the same after {self.checked} equal states: {self.difference}"
        text = f"{self.checked} states came out again, bit for bit"
        if self.rounded:
            text += (
                f" but for {self.rounded} that differ by {self.largest:.2g} at most, as another "
                "kind of processor rounds"
            )
        if self.begins:
            text += f", from where the recording begins: {self.begins}"
        if self.head:
            text += f" ({self.head} states up to it came under commands that the bag lacks)"
        if self.unknown:
            return (
                f"not proved: {text}, but {self.unknown} could not be computed for lack of the "
                f"state or command before, first {self.first_unknown}"
            )
        if self.checked:
            return text
        why = "none of the commands that led to its states" if self.head else "no ride"
        return f"not proved: the bag holds {why} to compute again"


def verify(recording: Recording) -> Iterator[StateVerdict]:
    """Compute one state after another.

    Args:
        recording: of one bicycle.

    Yields:
        The verdict so far, after each recorded state; the last one is final.

    Raises:
        BagError: if an episode's settings are not in the bag or not of this simulator.
    """
    verdict = StateVerdict()
    before: BicycleState | None = None
    simulator: Simulator | None = None
    for place, data in recording.states:
        state = decoded(data, BicycleState)
        if before is not None and _is_repeated(state, before):
            yield verdict  # a held bicycle's state, published again
            continue
        follows = before is not None and state.episode == before.episode
        if before is None or simulator is None or not follows or state.step <= before.step:
            verdict.begun += 1
            if before is None and state.step > 0:
                verdict.begins = _place(state)
            simulator = _restored(recording, state, place)
        elif state.step != before.step + 1:
            _skip(verdict, state)
            simulator = _restored(recording, state, place)
        else:
            simulator = _compute(recording, verdict, simulator, state, place)
        before = state
        yield verdict
        if verdict.difference:
            return


def _compute(
    recording: Recording,
    verdict: StateVerdict,
    simulator: Simulator,
    state: BicycleState,
    place: int,
) -> Simulator:
    """Compute one state; return the simulator to continue with."""
    stamp = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec
    here, echo = simulator.snapshot, _echo(recording, state, place)
    known = echo if echo is not None and math.isfinite(echo.command.torque) else None
    recorded = _numbers(state, known, recording.missing)
    computed: dict[str, Any] | None = None
    pushes = recording.pushes.get((here.episode, here.step), [0.0])
    for command, push in product(_candidates(recording, echo), pushes):
        trial = Simulator.restore(here, simulator.scenario, simulator.plant, simulator.seed)
        after = trial.step(command, push)
        echo = convert.from_applied(trial.applied, after.episode, after.step, stamp)
        message = convert.from_snapshot(after, stamp)
        computed = _numbers(message, echo if known is not None else None, recording.missing)
        same = _bits(computed) == _bits(recorded)
        gap = 0.0 if same else _gap(recorded, computed)
        if gap <= ROUNDING:
            verdict.checked, verdict.rounded = verdict.checked + 1, verdict.rounded + (not same)
            verdict.largest = max(verdict.largest, gap)
            verdict.led |= command is not None
            return trial if same else _restored(recording, state, place)
    if computed is None and not verdict.led:
        # A recorder that joins a ride receives states before it receives commands.
        verdict.head, verdict.begins = verdict.head + 1, _place(state)
    elif computed is None:
        _skip(verdict, state)
    else:
        verdict.difference = f"{_place(state)}: {_difference(recorded, computed)}"
    return _restored(recording, state, place)


def _echo(recording: Recording, state: BicycleState, place: int) -> CommandEcho | None:
    """Return the echo of the command that led to a state; None if it was not recorded."""
    echoes = recording.echoes.get((state.episode, state.step), [])
    return min(echoes, key=lambda pair: abs(pair[0] - place))[1] if echoes else None


def _candidates(recording: Recording, echo: CommandEcho | None) -> list[Command | None]:
    """Return the sent commands that an echo may mean; a state may be answered twice."""
    if echo is None:
        return []
    if echo.command_source == CommandSource.ZERO:
        return [None]
    sent = echo.command
    return list(recording.commands.get((sent.episode, sent.step, sent.controller), []))


def _restored(recording: Recording, state: BicycleState, place: int) -> Simulator:
    """Create a simulator in this recorded state.

    Raises:
        BagError: see `verify`.
    """
    infos = [(abs(at - place), info) for at, info in recording.episodes]
    infos = [(distance, info) for distance, info in infos if info.episode == state.episode]
    if not infos:
        raise BagError(
            f"the bag lacks the settings of episode {state.episode}: record {EPISODE} too"
        )
    info = min(infos, key=lambda pair: pair[0])[1]
    try:
        scenario, plant = to_setting(info)
        snapshot = convert.to_snapshot(state)
        return Simulator.restore(snapshot, scenario, plant, int(info.seed))
    except (ValueError, TypeError, ArithmeticError, RecursionError) as error:
        raise BagError(
            f"episode {state.episode} is not one of this simulator's ({error}): verify it with "
            f"version {info.version}"
        ) from None


def _is_repeated(state: BicycleState, before: BicycleState) -> bool:
    """Return True if a state is the one before, published again.

    Another one of the same step is another simulator's, which replaced one that only stood.
    """
    if (state.episode, state.step) != (before.episode, before.step):
        return False
    again = copy(state)
    again.header = before.header
    return bool(again == before)


def _skip(verdict: StateVerdict, state: BicycleState) -> None:
    """Count a state without a predecessor."""
    verdict.unknown += 1
    verdict.first_unknown = verdict.first_unknown or _place(state)


def _place(state: BicycleState) -> str:
    return f"step {state.step} of episode {state.episode}"


def _numbers(
    state: BicycleState, echo: CommandEcho | None, missing: frozenset[str]
) -> dict[str, Any]:
    """Return the fields that the bag has of a state and its echo, by their dotted names."""
    found = {name: value for name, value in flatten(state) if name not in missing}
    if echo is not None:
        found |= {f"echo.{name}": value for name, value in flatten(echo)}
    return found


def _bits(numbers: dict[str, Any]) -> list[Any]:
    """Return the values, floats as their eight bytes."""
    return [exact(value) for value in numbers.values()]


def _gap(recorded: dict[str, Any], computed: dict[str, Any]) -> float:
    """Return the largest difference of two numbers; infinite if another field differs."""
    largest = 0.0
    for old, new in zip(recorded.values(), computed.values(), strict=True):
        if exact(old) != exact(new):
            apart = abs(old - new) if isinstance(old, float) else math.inf
            largest = max(largest, apart if math.isfinite(apart) else math.inf)
    return largest


def _difference(recorded: dict[str, Any], computed: dict[str, Any]) -> str:
    """Return the first field that differs, and its difference."""
    for (name, old), new in zip(recorded.items(), computed.values(), strict=True):
        if exact(old) != exact(new):
            by = f", {abs(old - new):.3g} apart" if isinstance(old, float) else ""
            return f"{name} was {old!r} and comes out as {new!r}{by}"
    return "nothing differs"
