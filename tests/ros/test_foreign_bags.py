"""Replay and verification of bags that others wrote, or whose messages are not what they say."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from foreign_bag import SECOND, ForeignFile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from node_process import NodeProcess
from ride_bag import COMMAND, EPISODE, STATE

from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader
from bicycle_tools.nodes import ride_recording, verify_states

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

PLAYER = "bicycle_bag.nodes.player_node"
OLD = Path(__file__).parents[1] / "data" / "ride-0.1.0"
RIDE = (STATE, COMMAND, EPISODE)
STEP_AT = 28
"""Place of the step in the CDR of a state of version 1."""
Start = Callable[..., NodeProcess]
Message = tuple[str, bytes, int]


@cache
def sound() -> list[Message]:
    """Return a real ride's messages."""
    return [(m.topic, m.data, m.log_time_ns) for m in BagReader(OLD).messages(RIDE)]


def write(path: Path, messages: list[Message], extra: Callable[[ForeignFile], None]) -> Path:
    """Return a ride beside what `extra` adds; no type hashes, as converters leave them out."""
    reader = BagReader(OLD)
    with ForeignFile(path) as file:
        for topic in RIDE:
            file.channel(topic, reader.topics[topic].type, reader.definition(topic).encode())
        extra(file)
        for topic, data, now in messages:
            file.write(topic, data, now)
    return path


def foreign_channels(file: ForeignFile) -> None:
    """Topics of other encodings, of none, and with names that ROS does not take."""
    file.channel("/plot", "plot", b"{}", "jsonschema", "json")
    file.channel("/scene", "foxglove.SceneUpdate", b"\0\1\2", "protobuf", "protobuf")
    file.channel("/bare")
    file.channel("no name: 7", "std_msgs/msg/String", b"string data\n")
    file.channel("/odd", "bicycle_msgs/msg/Nothing", b"float64 x\n")
    file.channel("/strange", "../msg/String", b"string data\n")
    file.channel(
        "/z\x1b[31m\n[FATAL] [1.0] [sim]: forged", "std_msgs/msg/String", b"string data\n"
    )
    start = sound()[0][2]
    for topic in ("/plot", "/scene", "/bare", "no name: 7", "/odd", "/strange"):
        file.write(topic, b'{"a": 1}', start)


def line_of(bag: Path) -> str:
    """Return the end of a bag's verification: the verdict or one line."""
    try:
        (*_, verdict) = verify_states.verify(ride_recording.read(bag))
    except BagError as error:
        line = str(error)
    else:
        line = str(verdict)
    assert "\n" not in line
    assert len(line) < 600
    return line


def numbers_of(topic: str) -> list[int]:
    """Places of a topic's messages in the ride."""
    return [number for number, (name, _, _) in enumerate(sound()) if name == topic]


def replaced(number: int, data: bytes) -> list[Message]:
    """Return the ride with other bytes in one message."""
    messages = list(sound())
    topic, _, now = messages[number]
    messages[number] = topic, data, now
    return messages


def test_foreign_channels_beside_a_ride_do_not_matter(start_node: Start, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag.mcap", sound(), foreign_channels)
    assert "states came out again" in line_of(bag)
    player = start_node(PLAYER, [bag, "--rate", "20"])
    assert player.wait() == 0, player.output
    assert "Traceback" not in player.output
    assert "\x1b" not in player.output
    assert not any(line.startswith("[FATAL]") for line in player.lines)
    assert any(r"/z\x1b[31m\n[FATAL]" in line for line in player.lines), "spelt out"
    count = len(sound()) + len(numbers_of(STATE))  # an echo comes before each state
    assert f"played {count} messages" in player.lines[-1]
    said = "6 messages were not played, of /bare, /odd, /plot, /scene, /strange, no name: 7"
    assert player.lines[-1].endswith(said)
    for topic in ("/bare", "/odd", "/plot", "/scene", "/strange", "no name: 7"):
        assert f"{topic} is not played: " in player.output


@pytest.mark.parametrize("topic", RIDE)
@pytest.mark.parametrize("data", [b"", b"\0", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 300])
def test_verify_of_a_message_that_does_not_decode_is_one_line(
    tmp_path: Path, topic: str, data: bytes
) -> None:
    number = numbers_of(topic)[-1]
    bag = write(tmp_path / "bag.mcap", replaced(number, data), lambda _: None)
    assert f"a message of {len(data)} bytes is not a " in line_of(bag)


@pytest.mark.parametrize(
    ("type_name", "schema_encoding", "encoding", "said"),
    [
        ("bicycle_msgs/msg/BicycleState", "ros2msg", "json", "in json"),
        ("plot", "jsonschema", "json", "as plot in json"),
        ("", "", "cdr", "as no type in cdr"),
        ("std_msgs/msg/String", "ros2msg", "cdr", "as std_msgs/msg/String in cdr"),
        ("bicycle_msgs/msg/BicycleState", "ros2msg", "", "in no encoding"),
    ],
)
@pytest.mark.parametrize("first", [True, False], ids=["alone", "beside ours"])
def test_verify_of_a_foreign_encoding_on_our_topics_is_one_line(
    tmp_path: Path, type_name: str, schema_encoding: str, encoding: str, said: str, first: bool
) -> None:
    reader = BagReader(OLD)
    with ForeignFile(tmp_path / "bag.mcap") as file:
        for topic in RIDE:
            if not first or topic != STATE:
                file.channel(topic, reader.topics[topic].type, reader.definition(topic).encode())
        for topic, data, now in sound():
            if not first or topic != STATE:
                file.write(topic, data, now)
        file.channel(STATE, type_name, b"{}", schema_encoding, encoding)
        file.write(STATE, b"{}", sound()[-1][2])
    line = line_of(tmp_path / "bag.mcap")
    assert said in line
    assert "bicycle_msgs/msg/BicycleState in cdr is needed" in line


@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    number=st.integers(0, 200),
    place=st.integers(4, 400),
    change=st.binary(min_size=1, max_size=12),
)
def test_verify_of_any_bytes_is_a_verdict_or_one_line(
    tmp_path: Path, number: int, place: int, change: bytes
) -> None:
    data = bytearray(sound()[number][1])
    place %= len(data)
    data[place : place + len(change)] = change
    line_of(write(tmp_path / "bag.mcap", replaced(number, bytes(data)), lambda _: None))


@pytest.mark.parametrize("step", [10**9, 2**62, 2**64 - 1])
def test_verify_of_a_huge_step_takes_no_memory(tmp_path: Path, step: int) -> None:
    number = numbers_of(STATE)[40]
    data = sound()[number][1]
    assert struct.unpack_from("<Q", data, STEP_AT) == (40,)
    data = data[:STEP_AT] + struct.pack("<Q", step) + data[STEP_AT + 8 :]
    bag = write(tmp_path / "bag.mcap", replaced(number, data), lambda _: None)
    assert f"first step {step} of episode 1" in line_of(bag)


def test_a_bag_whose_clock_was_set_back_is_played_at_once_and_proved(
    start_node: Start, tmp_path: Path
) -> None:
    """The clock goes back by an hour in the middle; the first messages have log time 0."""
    count = len(sound())
    times = [
        now - (3600 * SECOND if n > count // 2 else 0) for n, (_, _, now) in enumerate(sound())
    ]
    times[:5] = [0] * 5
    messages = [(topic, data, now) for (topic, data, _), now in zip(sound(), times, strict=True)]
    bag = write(tmp_path / "bag.mcap", messages, lambda _: None)
    assert "states came out again" in line_of(bag)
    player = start_node(PLAYER, [bag, "--rate", "20"])
    assert player.wait() == 0, player.output
    assert f"played {count + len(numbers_of(STATE))} messages" in player.lines[-1]
    assert "goes back by 3600.0 s" in player.output
    assert "the clock was set ahead after 0.0 s" in player.output
