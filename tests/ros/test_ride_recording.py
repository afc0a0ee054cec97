"""Bags from which states can be computed again, and those that are refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from bicycle_msgs.msg import BicycleState
from changed_ride import COMMANDS, ECHOES, EPISODES, KINDS, PUSHES, STATES
from rclpy.serialization import serialize_message
from ride_bag_maker import TOPICS, Message, write_bag

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.schemas import Schemas
from bicycle_bag.writer import BagWriter
from bicycle_tools.nodes import ride_recording, verify_states

pytestmark = pytest.mark.ros


def test_a_bag_without_echoes_can_not_be_verified(ride: list[Message], tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", iter(ride), [ECHOES])
    with pytest.raises(BagError, match="does not say which command led to which state"):
        ride_recording.read(bag)
    for topic in (STATES, COMMANDS, EPISODES):
        bag = write_bag(tmp_path / topic.replace("/", "_"), iter(ride), [topic])
        with pytest.raises(BagError):
            ride_recording.read(bag)


def test_a_bag_without_pushes_is_read(ride: list[Message], tmp_path: Path) -> None:
    (*_, verdict) = verify_states.verify(
        ride_recording.read(write_bag(tmp_path / "bag", iter(ride)))
    )
    assert verdict.proved


@pytest.mark.parametrize(
    ("type_name", "encoding", "said"),
    [
        ("bicycle_msgs/msg/BicycleState", "json", "as bicycle_msgs/msg/BicycleState in json"),
        ("std_msgs/msg/String", "cdr", "as std_msgs/msg/String in cdr"),
        ("std_msgs/msg/String", "", "as std_msgs/msg/String in no encoding"),
    ],
)
@pytest.mark.parametrize("wrong", [STATES, COMMANDS, EPISODES, ECHOES, PUSHES])
def test_a_topic_of_another_kind_is_named(
    tmp_path: Path, wrong: str, type_name: str, encoding: str, said: str
) -> None:
    schemas = Schemas()
    with BagWriter(tmp_path / "bag") as writer:
        for name, kind in KINDS.items():
            full = f"bicycle_msgs/msg/{kind.__name__}"
            if name == wrong:
                writer.add_topic(Topic(name, type_name, serialization_format=encoding), "")
            else:
                writer.add_topic(Topic(name, full), schemas.definition(full))
    words = (
        f"holds {wrong} {said}, where bicycle_msgs/msg/{KINDS[wrong].__name__} in cdr is needed"
    )
    with pytest.raises(BagError, match=re.escape(words)):
        ride_recording.read(tmp_path / "bag")


def test_another_version_of_a_type_is_named(ride: list[Message], tmp_path: Path) -> None:
    schemas = Schemas()
    with BagWriter(tmp_path / "bag") as writer:
        for name, topic in TOPICS.items():
            full = f"bicycle_msgs/msg/{topic.type.__name__}"
            other = "RIHS01_" + "0" * 64 if name == COMMANDS else schemas.type_hash(full)
            writer.add_topic(Topic(name, full, type_hash=other), schemas.definition(full))
        for name, message, time in ride:
            writer.write(name, serialize_message(message), time, time)
    words = "has another version of bicycle_msgs/msg/BicycleCommand: verify it with the release"
    with pytest.raises(BagError, match=re.escape(words)):
        ride_recording.read(tmp_path / "bag")


def test_what_does_not_decode_is_one_line() -> None:
    with pytest.raises(
        BagError, match=r"a message of 3 bytes is not a BicycleState \(.{1,100}\): "
    ):
        ride_recording.decoded(b"abc", BicycleState)
