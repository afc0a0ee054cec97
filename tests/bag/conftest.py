"""Bags of real bicycle messages, serialised without ROS."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ride_bag import (
    COMMAND,
    EPISODE,
    LATCHED,
    PERIOD_NS,
    START_NS,
    STATE,
    TYPES,
    MakeBag,
    Message,
    Ride,
    Serialise,
)
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bicycle_bag.metadata import BagMetadata, Topic
from bicycle_bag.qos import QosProfile
from bicycle_bag.schemas import Schemas
from bicycle_bag.writer import BagWriter

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def schemas(tmp_path_factory: pytest.TempPathFactory) -> Schemas:
    """Definitions from this repository and from the ROS that is installed."""
    overlay = tmp_path_factory.mktemp("overlay")
    (overlay / "share").mkdir()
    (overlay / "share" / "bicycle_msgs").symlink_to(REPOSITORY / "bicycle_msgs")
    named = [name for name in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if name]
    return Schemas([overlay, Path(sys.prefix), *map(Path, named)])


@pytest.fixture(scope="session")
def store(schemas: Schemas) -> Any:
    """The ``rosbags`` package's own idea of Jazzy's types and ours."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in (*TYPES.values(), "Transition", "GoalStatus", "LoopTiming"):
        text = schemas.definition(f"bicycle_msgs/msg/{name}").split("\n" + "=" * 80)[0]
        store.register(get_types_from_msg(text, f"bicycle_msgs/msg/{name}"))
    return store


@pytest.fixture(scope="session")
def serialise(store: Any) -> Serialise:
    """A function from a type name and nested field values to CDR; other fields are zero."""

    def build(type_name: str, values: dict[str, Any]) -> Any:
        fields = {}
        for field, (kind, detail) in store.fielddefs[type_name][1]:
            value = values.get(field)
            if int(kind) == 2:
                fields[field] = build(detail, value or {})
            elif int(kind) == 1:
                default: Any = "" if detail[0] == "string" else detail[0] == "bool" and False
                fields[field] = value if value is not None else default
            else:
                _, length = detail
                fields[field] = np.asarray(value if value is not None else np.zeros(length))
        return store.types[type_name](**fields)

    def serialise(type_name: str, values: dict[str, Any]) -> bytes:
        full = f"bicycle_msgs/msg/{type_name}" if "/" not in type_name else type_name
        return bytes(store.serialize_cdr(build(full, values), full))

    return serialise


def header(index: int) -> dict[str, Any]:
    stamp = {"sec": index // 40, "nanosec": index % 40 * PERIOD_NS}
    return {"stamp": stamp, "frame_id": "odom"}


@pytest.fixture(scope="session")
def ride(serialise: Serialise) -> Ride:
    """A function: the first ``n`` steps of a made-up ride as (topic, data, log time)."""

    def build(steps: int) -> list[Message]:
        info = {"episode": 1, "pace": "lockstep", "physics": "{}", "version": "0.1.0"}
        messages: list[Message] = [(EPISODE, serialise("EpisodeInfo", info), START_NS - 1000)]
        for step in range(steps):
            state = {
                "header": header(step),
                "episode": 1,
                "step": step,
                "lean_angle": 0.01 * np.sin(step),
                "goal": {"x": float(step), "y": 2.0},
                "has_goal": step % 2 == 1,
                "heading_error": float("nan"),
                "command_step": step - 1,
            }
            command = {
                "header": header(step),
                "step": step,
                "torque": 0.5 * step,
                "controller": "ddpg" if step % 3 else "lqr fallback",
                "policy": f"p{step % 7}" * (step % 4),
                "goal_id": 3,
            }
            now = START_NS + step * PERIOD_NS
            messages.append((STATE, serialise("BicycleState", state), now))
            messages.append((COMMAND, serialise("BicycleCommand", command), now + 900_000))
        return messages

    return build


@pytest.fixture
def make_bag(schemas: Schemas, store: Any, ride: Ride) -> MakeBag:
    """A function that records ``steps`` of the ride at ``path``, with options of BagWriter."""

    def make(path: Path, steps: int = 100, **options: Any) -> BagMetadata:
        writer = BagWriter(path, custom_data={"seed": "7"}, **options)
        for topic, name in TYPES.items():
            type_name = f"bicycle_msgs/msg/{name}"
            qos = (LATCHED if topic == EPISODE else QosProfile(),)
            described = Topic(topic, type_name, qos, store.hash_rihs01(type_name))
            writer.add_topic(described, schemas.definition(type_name))
        for topic, data, now in ride(steps):
            writer.write(topic, data, now, now - 1000)
        return writer.close()

    return make
