"""`replay.sh --verify`: the recorded commands through the simulator again, compared bit for bit.

Each state is computed from the one before and the command that the bag says was applied, made
into a message, and compared with the recorded one field by field, floats by their bits: the raw
messages themselves differ in the padding between fields, which nobody sets. On another kind of
processor numpy's functions differ in their last bits; such states are told apart, and the next one
is computed from the recorded one again.
"""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.verify")

import math
import struct
import sys
from collections import defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from bicycle_msgs.msg import BicycleCommand, BicycleState, CommandEcho, EpisodeInfo, Push
from rclpy.serialization import deserialize_message
from tqdm import tqdm

from bicycle_bag.errors import BagError
from bicycle_bag.schemas import Schemas
from bicycle_bag.versions import TodaysReader
from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes import convert
from bicycle_common.types import Command, CommandSource
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.runtime.simulator import Simulator
from bicycle_tools.nodes.flatten import flatten
from bicycle_tools.nodes.verify_estimates import (
    ENCODERS,
    IMU,
    SETUP,
    EstimateVerdict,
    has_estimates,
    is_hardware,
)
from bicycle_tools.nodes.verify_estimates import read as read_sensed
from bicycle_tools.nodes.verify_estimates import verify as verify_estimates
from bicycle_tools.ride_log import COMMAND, ECHO, EPISODE, PUSHED, STATE, prefix_of

ROUNDING = 1e-9
"""Largest effect of rounding on one step, in any field's unit; errors are larger."""

Key = tuple[int, int, str]
"""Episode, step and controller, which identify an applied command's candidates."""


@dataclass
class Recording:
    """The messages of one bicycle, in recorded order."""

    states: list[tuple[int, bytes]] = field(default_factory=list)
    """Place in the recorded order, and CDR."""
    missing: frozenset[str] = frozenset()
    """Fields of today's states that the bag's have not."""
    echoes: dict[tuple[int, int], list[tuple[int, CommandEcho]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    """Place and message by episode and step of the state that the command led to."""
    commands: dict[Key, list[Command]] = field(default_factory=lambda: defaultdict(list))
    episodes: list[tuple[int, EpisodeInfo]] = field(default_factory=list)
    """Place in the recorded order, and message."""
    pushes: dict[tuple[int, int], list[float]] = field(default_factory=lambda: defaultdict(list))
    """Pushes by episode and step of the pushed state, rad/s, in the paper's signs."""


@dataclass
class Verdict:
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


def read(path: Path) -> Recording:
    """Read the messages that a verification needs.

    Raises:
        BagError: if the bag cannot be read, is foreign, or has other message definitions.
    """
    reader = TodaysReader(path)
    prefix = prefix_of(reader)
    kinds = {prefix + STATE: BicycleState, prefix + COMMAND: BicycleCommand}
    kinds[prefix + EPISODE] = EpisodeInfo
    reader.require(list(kinds))
    _check_kinds(reader, kinds)
    kinds[prefix + ECHO] = CommandEcho
    if prefix + ECHO not in reader.topics:
        raise BagError(
            f"{path} does not say which command led to which state (no {ECHO}): only a bag of a "
            "simulator can be verified"
        )
    if prefix + PUSHED in reader.topics:  # older bags lack it
        kinds[prefix + PUSHED] = Push
    _check_kinds(reader, kinds)
    _check_versions(reader, list(kinds))
    recording = Recording(missing=frozenset(reader.missing_fields(prefix + STATE)))
    # The recorded order is reliable; the recording's clock may have been set in the meantime.
    for place, item in enumerate(reader.messages(list(kinds))):
        kind = kinds[item.topic]
        _check_kind(path, item.topic, item.type, item.encoding, kind)
        if kind is BicycleState:
            recording.states.append((place, item.data))
            continue
        message = decoded(item.data, kind)
        if kind is BicycleCommand:
            command = convert.to_command(message)
            key = command.episode, command.step, command.controller
            recording.commands[key].append(command)
        elif kind is CommandEcho:
            recording.echoes[message.episode, message.step].append((place, message))
        elif kind is Push:
            push = convert.to_push(message)
            recording.pushes[push.episode, push.step].append(push.lean_rate)
        else:
            recording.episodes.append((place, message))
    return recording


def _check_kinds(reader: TodaysReader, kinds: dict[str, type[Any]]) -> None:
    """Refuse topics of other types or encodings; see `_check_kind`."""
    for name, kind in kinds.items():
        topic = reader.topics[name]
        _check_kind(reader.path, name, topic.type, topic.serialization_format, kind)


def _check_kind(path: Path, topic: str, type_name: str, encoding: str, kind: type[Any]) -> None:
    """Refuse messages of other types or encodings.

    Raises:
        BagError: if there are any.
    """
    wanted = f"bicycle_msgs/msg/{kind.__name__}"
    if type_name != wanted or encoding != "cdr":
        raise BagError(
            f"{path} holds {topic} as {type_name or 'no type'} in {encoding or 'no encoding'}, "
            f"where {wanted} in cdr is needed: record the ride with record.sh or ros2 bag record"
        )


def _check_versions(reader: TodaysReader, topics: list[str]) -> None:
    """Refuse a bag whose messages cannot be brought up to date.

    Raises:
        BagError: if it is one.
    """
    schemas = Schemas()
    for name in topics:
        topic = reader.topics[name]
        known = reader.is_rewritten(name) or topic.type_hash == schemas.type_hash(topic.type)
        if topic.type_hash and not known:
            raise BagError(
                f"{reader.path} has another version of {topic.type}: verify it with the release "
                "that recorded it"
            )


def decoded(data: bytes, kind: type[Any]) -> Any:
    """Decode a message from its CDR.

    Args:
        data: the message as the reader gives it.
        kind: its class.

    Raises:
        BagError: if it is not of this kind.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # the middleware's errors have no common base class
        raise BagError(
            f"a message of {len(data)} bytes is not a {kind.__name__} "
            f"({' '.join(str(error).split())[:100]}): the bag's recorder was another version or "
            "the message was damaged before it was recorded"
        ) from None


def verify(recording: Recording) -> Iterator[Verdict]:
    """Compute one state after another.

    Args:
        recording: of one bicycle.

    Yields:
        The verdict so far, after each recorded state; the last one is final.

    Raises:
        BagError: if an episode's settings are not in the bag or not of this simulator.
    """
    verdict = Verdict()
    before: BicycleState | None = None
    simulator: Simulator | None = None
    for place, data in recording.states:
        state = decoded(data, BicycleState)
        if before is not None and (state.episode, state.step) == (before.episode, before.step):
            yield verdict  # a held bicycle's state, published again
            continue
        follows = before is not None and state.episode == before.episode
        if before is None or simulator is None or not follows or state.step < before.step:
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
    verdict: Verdict,
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


def _skip(verdict: Verdict, state: BicycleState) -> None:
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
    return [_exact(value) for value in numbers.values()]


def _exact(value: Any) -> Any:
    return struct.pack("<d", value) if isinstance(value, float) else value


def _gap(recorded: dict[str, Any], computed: dict[str, Any]) -> float:
    """Return the largest difference of two numbers; infinite if another field differs."""
    largest = 0.0
    for old, new in zip(recorded.values(), computed.values(), strict=True):
        if _exact(old) != _exact(new):
            apart = abs(old - new) if isinstance(old, float) else math.inf
            largest = max(largest, apart if math.isfinite(apart) else math.inf)
    return largest


def _difference(recorded: dict[str, Any], computed: dict[str, Any]) -> str:
    """Return the first field that differs, and its difference."""
    for (name, old), new in zip(recorded.items(), computed.values(), strict=True):
        if _exact(old) != _exact(new):
            by = f", {abs(old - new):.3g} apart" if isinstance(old, float) else ""
            return f"{name} was {old!r} and comes out as {new!r}{by}"
    return "nothing differs"


def verdicts_of(path: Path) -> list[Verdict | EstimateVerdict]:
    """Return the verdicts about a bag: of its states, and of its estimates where it has some.

    States that a microcontroller led to are nobody's to compute again.

    Raises:
        BagError: if the bag cannot be read or verified.
    """
    found: list[Verdict | EstimateVerdict] = []
    reader = TodaysReader(path)
    if not is_hardware(reader):
        recording, verdict = read(path), Verdict()
        steps = verify(recording)
        with tqdm(steps, total=len(recording.states), unit="state", disable=None) as bar:
            found.append(deque(bar, maxlen=1).pop() if recording.states else verdict)
    elif not has_estimates(reader):
        raise BagError(
            f"{path} holds a ride of a real bicycle without {SETUP}, {IMU}, {ENCODERS} and "
            f"{EPISODE}: record all topics to verify it"
        )
    if has_estimates(reader):
        sensed, estimated = read_sensed(reader), EstimateVerdict()
        checks = verify_estimates(sensed)
        with tqdm(checks, total=len(sensed.estimates), unit="estimate", disable=None) as line:
            found.append(deque(line, maxlen=1).pop() if sensed.estimates else estimated)
    return found


def main() -> int:
    """Verify the bag of the command line; return the exit status."""
    parser = OneLineParser(prog="replay.sh --verify", description=__doc__)
    parser.add_argument("bag", type=Path, help="bag directory or .mcap file")
    path = parser.parse_args().bag
    try:
        verdicts = verdicts_of(path)
    except BagError as error:
        print(f"replay.sh --verify: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("replay.sh --verify: interrupted", file=sys.stderr)
        return 130
    for verdict in verdicts:
        print(f"{path}: {verdict}")
    return 0 if all(verdict.same for verdict in verdicts) else 1
