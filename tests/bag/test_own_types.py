"""A bag with another definition of this project's own type is refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bicycle_msgs.msg import BicycleState
from mcap.writer import Writer
from rclpy.serialization import serialize_message

from bicycle_bag.errors import BagError
from bicycle_bag.own_types import ADDED, check_definition
from bicycle_bag.schemas import SEPARATOR, Schemas, fields
from bicycle_bag.versions import TodaysReader
from bicycle_tools.ride_log import STATE, read_ride

KIND = "bicycle_msgs/msg/BicycleState"


@pytest.fixture
def renamed(tmp_path: Path) -> Path:
    """A bag of one state whose definition calls a field by another name."""
    path = tmp_path / "renamed.mcap"
    definition = Schemas().definition(KIND)
    changed = definition.replace("float64 lean_angle ", "float64 roll_angle ")
    assert changed != definition
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(KIND, "ros2msg", changed.encode())
        channel = writer.register_channel(STATE, "cdr", schema)
        writer.add_message(channel, 1, serialize_message(BicycleState()), 1)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize("read", [read_ride, lambda path: list(TodaysReader(path).messages())])
def test_a_renamed_field_is_told(read: Callable[[Path], Any], renamed: Path) -> None:
    with pytest.raises(BagError, match=f"{STATE}: .*{KIND} lacks lean_angle, which every release"):
        read(renamed)


def test_what_later_releases_added_may_be_missing() -> None:
    for kind, added in ADDED.items():
        definition = Schemas().definition(kind)
        body = definition.split(SEPARATOR, 1)[0]
        assert added <= {field.name for field in fields(body)}
        kept = [line for line in body.splitlines() if not set(line.split()) & added]
        check_definition("/topic", kind, "\n".join(kept))


def test_types_of_others_are_not_checked() -> None:
    check_definition("/imu", "sensor_msgs/msg/Imu", "float64 x\n")
    check_definition(STATE, KIND, "")
