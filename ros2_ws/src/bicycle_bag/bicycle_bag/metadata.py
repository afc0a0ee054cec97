"""A bag's `metadata.yaml` in rosbag2's version 9, the one that Jazzy writes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bicycle_bag.errors import BagError
from bicycle_bag.qos import QosProfile, parse_profiles
from bicycle_bag.syncing import sync_folder
from bicycle_common import yaml_text

VERSION = 9
FILE_NAME = "metadata.yaml"
ROOT = "rosbag2_bagfile_information"
PACKED_MESSAGES = "messages are compressed one by one: record.sh --repair unpacks them"
"""Answer of a reader to such a bag."""
NO_START = 2**63 - 1
"""Start of a bag without messages in rosbag2, which has no later time."""


@dataclass(frozen=True)
class Topic:
    """A recorded topic: its type, the offers of its publishers and the type's RIHS01 hash."""

    name: str
    type: str
    qos: tuple[QosProfile, ...] = ()
    type_hash: str = ""
    serialization_format: str = "cdr"


@dataclass(frozen=True)
class FileInformation:
    """One MCAP file of a bag; times in nanoseconds of the log clock."""

    path: str
    starting_time_ns: int = NO_START
    duration_ns: int = 0
    message_count: int = 0


@dataclass(frozen=True)
class BagMetadata:
    """All that rosbag2 keeps about a bag; `counts` holds the messages of each topic."""

    topics: tuple[Topic, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    files: tuple[FileInformation, ...] = ()
    custom_data: Mapping[str, str] = field(default_factory=dict)
    ros_distro: str = "jazzy"

    @property
    def message_count(self) -> int:
        """Messages in all files."""
        return sum(file.message_count for file in self.files)

    @property
    def starting_time_ns(self) -> int:
        """Log time of the first message, or `NO_START`."""
        starts = [file.starting_time_ns for file in self.files if file.message_count]
        return min(starts, default=NO_START)

    @property
    def duration_ns(self) -> int:
        """Time from the first message to the last, ns."""
        ends = [f.starting_time_ns + f.duration_ns for f in self.files if f.message_count]
        return max(ends) - self.starting_time_ns if ends else 0

    def to_yaml_map(self) -> dict[str, Any]:
        """Return the metadata in rosbag2's keys and order, without the root key."""
        return {
            "version": VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": _signed(self.duration_ns)},
            "starting_time": {"nanoseconds_since_epoch": _signed(self.starting_time_ns)},
            "message_count": self.message_count,
            "topics_with_message_count": [
                {
                    "topic_metadata": _topic_map(topic),
                    "message_count": self.counts.get(topic.name, 0),
                }
                for topic in self.topics
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.path for file in self.files],
            "files": [_file_map(file) for file in self.files],
            "custom_data": dict(self.custom_data) or None,
            "ros_distro": self.ros_distro,
        }

    def to_record(self) -> dict[str, str]:
        """Return the contents of the MCAP metadata record named `rosbag2`."""
        return {"serialized_metadata": yaml_text.dump(self.to_yaml_map())}


def _topic_map(topic: Topic) -> dict[str, Any]:
    return {
        "name": topic.name,
        "type": topic.type,
        "serialization_format": topic.serialization_format,
        "offered_qos_profiles": [profile.to_yaml_map() for profile in topic.qos],
        "type_description_hash": topic.type_hash,
    }


def _file_map(file: FileInformation) -> dict[str, Any]:
    return {
        "path": file.path,
        "starting_time": {"nanoseconds_since_epoch": _signed(file.starting_time_ns)},
        "duration": {"nanoseconds": _signed(file.duration_ns)},
        "message_count": file.message_count,
    }


def _signed(nanoseconds: int) -> int:
    """Return a time that rosbag2 can read: at most in the year 2262."""
    return min(nanoseconds, NO_START)


def write(folder: Path, metadata: BagMetadata, sync: bool = True) -> None:
    """Write `metadata.yaml` into `folder`: whole or not at all, also on a power cut.

    Args:
        folder: The bag's.
        metadata: What it says.
        sync: Wait until the disk has the text; without it, a power cut may leave an empty file.

    Raises:
        OSError: The disk does not take it.
    """
    temporary = folder / f".{FILE_NAME}.tmp"
    with temporary.open("w", encoding="utf-8") as file:
        file.write(yaml_text.dump({ROOT: metadata.to_yaml_map()}))
        file.flush()
        if sync:
            os.fsync(file.fileno())
    temporary.replace(folder / FILE_NAME)
    if sync:
        sync_folder(folder)


def read(folder: Path, of_any_storage: bool = False) -> BagMetadata:
    """Read `metadata.yaml` of any version that rosbag2 has written.

    Args:
        folder: The bag's.
        of_any_storage: Read it also of files that are not MCAP, or compressed as a whole.

    Raises:
        BagError: The file is missing, is not YAML or is not rosbag2's.
    """
    path = folder / FILE_NAME
    try:
        content = yaml_text.read(path)
        return from_yaml_map(content[ROOT], of_any_storage)
    except (OSError, UnicodeDecodeError, yaml_text.YAMLError) as error:
        raise BagError(f"cannot read {path} ({_one_line(error)}): {_REMEDY}") from None
    except NOT_METADATA:
        raise BagError(f"{path} is not rosbag2 metadata: {_REMEDY}") from None


_MANY = 10**15
_SLACK_NS = 3600 * 10**9
"""Difference of two times that is no rounding."""
NOT_METADATA = KeyError, TypeError, ValueError, OverflowError, AttributeError
"""Errors of `from_yaml_map` on what is not rosbag2's."""
_REMEDY = "remove it and run record.sh --repair on the bag to write it anew"


def _require_mcap(content: Mapping[str, Any]) -> None:
    storage = content.get("storage_identifier")
    if storage not in ("mcap", "", None):
        ours = "record.sh --repair makes one of it, as " if storage == "sqlite3" else ""
        does = "does" if ours else "makes one of it"
        raise BagError(
            f"the bag is stored as {storage!s:.40}, and only mcap can be read here: {ours}"
            f"ros2 bag convert {does} on a machine that has ROS 2"
        )
    mode = str(content.get("compression_mode") or "none").lower()
    if mode == "message" and ".zstd" not in str(content.get("relative_file_paths")):
        raise BagError(f"the bag's {PACKED_MESSAGES}")
    if mode != "none":
        raise BagError(
            "the bag's files are compressed as a whole: record.sh --repair unpacks them"
        )


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def from_yaml_map(content: Mapping[str, Any], of_any_storage: bool = False) -> BagMetadata:
    """Return the metadata from rosbag2's keys; inverse of `BagMetadata.to_yaml_map`.

    Raises:
        BagError: The files are not MCAP or are compressed as a whole.
        KeyError, TypeError, ValueError, OverflowError: The map is not rosbag2's.
    """
    if not of_any_storage:
        _require_mcap(content)
    topics, counts = [], {}
    for entry in content["topics_with_message_count"] or []:
        topic = _read_topic(entry["topic_metadata"])
        topics.append(topic)
        counts[topic.name] = int(entry["message_count"])
    files = [_read_file(entry) for entry in content.get("files") or []]
    if not files:  # metadata before version 5
        files = [FileInformation(str(path)) for path in content["relative_file_paths"] or []]
    custom = content.get("custom_data") or {}
    return BagMetadata(
        topics=tuple(topics),
        counts=counts,
        files=tuple(files),
        custom_data={str(key): str(value) for key, value in custom.items()},
        ros_distro=str(content.get("ros_distro") or ""),
    )


def oddity(stored: BagMetadata, found: BagMetadata) -> str:
    """Return what a `metadata.yaml` says otherwise than the files; empty if nothing.

    Args:
        stored: What it says.
        found: What the files hold.
    """
    names = [file.path for file in stored.files]
    if not names:
        return "it names no file"
    if len(set(names)) < len(names):
        return "it names a file twice"
    said = {name: count for name, count in stored.counts.items() if count}
    if said != {name: count for name, count in found.counts.items() if count}:
        total = sum(said.values())
        if total == found.message_count:
            return "it counts the messages of its topics wrong"
        many = str(total) if abs(total) < _MANY else f"{total:.0e}"
        return f"it counts {many} messages where there are {found.message_count}"
    longer = stored.duration_ns - found.duration_ns
    shifted = abs(stored.starting_time_ns - _signed(found.starting_time_ns))
    wrong = stored.duration_ns < 0 or longer > _SLACK_NS or shifted > _SLACK_NS
    if stored.message_count and found.message_count and wrong:
        return "its times are wrong"
    return ""


def _read_topic(entry: Mapping[str, Any]) -> Topic:
    return Topic(
        name=str(entry["name"]),
        type=str(entry["type"]),
        qos=parse_profiles(entry.get("offered_qos_profiles")),
        type_hash=str(entry.get("type_description_hash") or ""),
        serialization_format=str(entry["serialization_format"]),
    )


def _read_file(entry: Mapping[str, Any]) -> FileInformation:
    return FileInformation(
        path=str(entry["path"]),
        starting_time_ns=int(entry["starting_time"]["nanoseconds_since_epoch"]),
        duration_ns=int(entry["duration"]["nanoseconds"]),
        message_count=int(entry["message_count"]),
    )
