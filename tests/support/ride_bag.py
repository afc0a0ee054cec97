"""The made-up ride that the bag tests record: real bicycle messages, serialised without ROS."""

from __future__ import annotations

import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bicycle_bag.metadata import BagMetadata, Topic
from bicycle_bag.qos import QosProfile
from bicycle_bag.schemas import Schemas
from bicycle_bag.writer import BagWriter

REPOSITORY = Path(__file__).parents[2]
START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 25_000_000
STATE = "/bicycle/state"
COMMAND = "/bicycle/command"
EPISODE = "/bicycle/episode"
TYPES = {STATE: "BicycleState", COMMAND: "BicycleCommand", EPISODE: "EpisodeInfo"}
LATCHED = QosProfile(durability="transient_local")
# Kinds of fields in the type store of rosbags.
BASIC, MESSAGE = 1, 2

Message = tuple[str, bytes, int]

_overlay = tempfile.TemporaryDirectory()


@cache
def schemas() -> Schemas:
    """Definitions from this repository and from the ROS that is installed."""
    share = Path(_overlay.name) / "share"
    share.mkdir()
    (share / "bicycle_msgs").symlink_to(REPOSITORY / "bicycle_msgs")
    named = [name for name in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if name]
    return Schemas([share.parent, Path(sys.prefix), *map(Path, named)])


@cache
def store() -> Any:
    """Return the rosbags package's own idea of Jazzy's types and ours."""
    found = get_typestore(Stores.ROS2_JAZZY)
    for path in (REPOSITORY / "bicycle_msgs" / "msg").glob("*.msg"):
        found.register(get_types_from_msg(path.read_text(), f"bicycle_msgs/msg/{path.stem}"))
    return found


def serialise(name: str, values: dict[str, Any]) -> bytes:
    """CDR of a bicycle_msgs type with these nested field values; others are zero or empty."""
    type_name = f"bicycle_msgs/msg/{name}"
    return bytes(store().serialize_cdr(_build(type_name, values), type_name))


def _build(type_name: str, values: dict[str, Any]) -> Any:
    fields = {}
    for field, (kind, detail) in store().fielddefs[type_name][1]:
        value = values.get(field)
        if int(kind) == MESSAGE:
            fields[field] = _build(detail, value or {})
        elif int(kind) == BASIC:
            empty = "" if detail[0] == "string" else 0
            fields[field] = empty if value is None else value
        else:
            fields[field] = np.asarray(np.zeros(detail[1]) if value is None else value)
    return store().types[type_name](**fields)


def _header(step: int) -> dict[str, Any]:
    stamp = {"sec": step // 40, "nanosec": step % 40 * PERIOD_NS}
    return {"stamp": stamp, "frame_id": "odom"}


@cache
def ride(steps: int) -> list[Message]:
    """Return the first steps of a ride as (topic, data, log time)."""
    info = {"episode": 1, "pace": "lockstep", "physics": "{}", "version": "0.1.0"}
    messages: list[Message] = [(EPISODE, serialise("EpisodeInfo", info), START_NS - 1000)]
    for step in range(steps):
        state = {
            "header": _header(step),
            "episode": 1,
            "step": step,
            "lean_angle": 0.01 * np.sin(step),
            "yaw_rate": float("nan"),
        }
        command = {
            "header": _header(step),
            "step": step,
            "torque": 0.5 * step,
            "controller": "ddpg" if step % 3 else "lqr fallback",
            "policy": f"p{step % 7}" * (step % 4),
            "goal_id": 3,
            "goal": {"x": float(step), "y": 2.0},
            "has_goal": step % 2 == 1,
        }
        now = START_NS + step * PERIOD_NS
        messages.append((STATE, serialise("BicycleState", state), now))
        messages.append((COMMAND, serialise("BicycleCommand", command), now + 900_000))
    return messages


def make_bag(path: Path, steps: int = 100, **options: Any) -> BagMetadata:
    """Record the ride at `path`, with options of BagWriter."""
    writer = BagWriter(path, custom_data={"seed": "7"}, **options)
    for name, short in TYPES.items():
        type_name = f"bicycle_msgs/msg/{short}"
        qos = (LATCHED if name == EPISODE else QosProfile(),)
        topic = Topic(name, type_name, qos, store().hash_rihs01(type_name))
        writer.add_topic(topic, schemas().definition(type_name))
    for name, data, now in ride(steps):
        writer.write(name, data, now, now - 1000)
    return writer.close()
