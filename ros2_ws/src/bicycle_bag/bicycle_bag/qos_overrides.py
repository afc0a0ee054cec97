"""The file of `--qos-profile-overrides-path`, as `ros2 bag record` takes it."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from bicycle_bag.errors import OptionError
from bicycle_bag.qos import QosProfile, from_yaml_map
from bicycle_bag.selection import absolute
from bicycle_common import yaml_text

DEFAULT = QosProfile(history="keep_last", depth=10)
"""Defaults of a topic's entry: ROS's default profile."""
KNOWN = tuple(field.name for field in fields(QosProfile))


def read_overrides(path: str) -> dict[str, QosProfile]:
    """Return the profiles to subscribe with, by the topics' full names; none without a path.

    Raises:
        OptionError: The file cannot be read, or an entry is not a QoS profile.
    """
    if not path:
        return {}
    try:
        entries = yaml_text.read(Path(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no text"
        raise OptionError(f"cannot read {path}: {reason}") from None
    except yaml_text.YAMLError as error:
        raise OptionError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(entries, dict):
        raise OptionError(
            f"{path} must hold topics with a QoS profile each, such as /odom: {{...}}"
        )
    return {absolute(str(topic)): _profile(path, topic, entry) for topic, entry in entries.items()}


def _profile(path: str, topic: object, entry: Any) -> QosProfile:
    """Return one topic's profile.

    Raises:
        OptionError: It is not one.
    """
    if not isinstance(entry, dict):
        raise OptionError(f"{path}: {topic} must have a QoS profile, not {entry!r}")
    for name in entry:
        if name not in KNOWN:
            raise OptionError(f"{path}: {topic} has {name!r}; a profile has {', '.join(KNOWN)}")
    try:
        given = from_yaml_map(entry)
    except ValueError as error:
        raise OptionError(f"{path}: {topic}: {error}") from None
    named = {name: getattr(given, name) for name in entry}
    profile = replace(DEFAULT, **named)
    for name in ("history", "reliability", "durability", "liveliness"):
        if getattr(profile, name) == "unknown":
            raise OptionError(
                f"{path}: {topic}: {name} is unknown: nobody can subscribe with that"
            )
    if profile.liveliness == "manual_by_node":
        raise OptionError(
            f"{path}: {topic}: ROS has no manual_by_node any more: automatic is nearest"
        )
    return profile
