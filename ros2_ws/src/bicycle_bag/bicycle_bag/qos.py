"""Quality-of-service profiles as rosbag2 stores them, without ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from bicycle_common import yaml_text

INFINITE_NS = 2**63 - 1
"""Infinite duration of rmw: the largest int64 count of nanoseconds."""
MOST_DEPTH = 2**31 - 1
"""Messages; DDS counts them in 32 bits."""
_SECOND_NS = 1_000_000_000

# Names in the order of rmw's enumerations, which metadata before version 9 stores as numbers.
HISTORY = ("system_default", "keep_last", "keep_all", "unknown")
RELIABILITY = ("system_default", "reliable", "best_effort", "unknown", "best_available")
DURABILITY = ("system_default", "transient_local", "volatile", "unknown", "best_available")
LIVELINESS = (
    "system_default",
    "automatic",
    "manual_by_node",
    "manual_by_topic",
    "unknown",
    "best_available",
)
_NAMES = {
    "history": HISTORY,
    "reliability": RELIABILITY,
    "durability": DURABILITY,
    "liveliness": LIVELINESS,
}
_DURATIONS = ("deadline", "lifespan", "liveliness_lease_duration")


@dataclass(frozen=True)
class QosProfile:
    """One publisher's offer, with rosbag2's names; durations in nanoseconds.

    Raises:
        ValueError: A policy has no such value, or a number is out of range.
    """

    history: str = "unknown"
    depth: int = 0
    reliability: str = "reliable"
    durability: str = "volatile"
    deadline: int = INFINITE_NS
    lifespan: int = INFINITE_NS
    liveliness: str = "automatic"
    liveliness_lease_duration: int = INFINITE_NS
    avoid_ros_namespace_conventions: bool = False

    def __post_init__(self) -> None:
        for policy, names in _NAMES.items():
            value = getattr(self, policy)
            if value not in names:
                raise ValueError(f"{policy} is {value!r}, not one of {', '.join(names)}")
        for name in _DURATIONS:
            if not 0 <= getattr(self, name) <= INFINITE_NS:
                raise ValueError(f"{name} is {getattr(self, name)} ns: give 0 to {INFINITE_NS}")
        depth, plain = self.depth, self.avoid_ros_namespace_conventions
        if type(depth) is not int or not 0 <= depth <= MOST_DEPTH:
            raise ValueError(f"depth is {depth!r}: give a whole number, 0 to {MOST_DEPTH}")
        if not isinstance(plain, bool):
            raise ValueError(f"avoid_ros_namespace_conventions is {plain!r}: give true or false")

    def to_yaml_map(self) -> dict[str, Any]:
        """Return the profile as metadata version 9 nests it."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name in _DURATIONS:
            seconds, rest = divmod(values[name], _SECOND_NS)
            values[name] = {"sec": seconds, "nsec": rest}
        return values


def from_yaml_map(values: Mapping[str, Any]) -> QosProfile:
    """Return a profile from its YAML map, with names (version 9) or rmw's numbers (before).

    Raises:
        ValueError: A value is of another kind or out of range.
    """
    known: dict[str, Any] = {}
    for field in fields(QosProfile):
        if field.name not in values:
            continue
        value = values[field.name]
        if field.name in _DURATIONS:
            value = _nanoseconds(field.name, value)
        elif field.name in _NAMES and isinstance(value, int):
            names = _NAMES[field.name]
            value = names[value] if 0 <= value < len(names) else "unknown"
        known[field.name] = value
    return QosProfile(**known)


def _nanoseconds(name: str, value: Any) -> int:
    """Return a duration of rmw; one beyond the infinite one is that.

    Raises:
        ValueError: It is none.
    """
    parts: list[Any] = []
    if isinstance(value, Mapping):
        parts = [value.get(part) for part in ("sec", "nsec")]
    if not parts or any(type(part) is not int for part in parts):
        raise ValueError(f"{name} is {str(value)[:40]!r}: write {{sec: 1, nsec: 0}}")
    whole: int = parts[0] * _SECOND_NS + parts[1]
    return min(whole, INFINITE_NS)


def dump_profiles(profiles: Sequence[QosProfile]) -> str:
    """YAML text of profiles, for the `offered_qos_profiles` of an MCAP channel."""
    return yaml_text.dump([profile.to_yaml_map() for profile in profiles])


def parse_profiles(offered: object) -> tuple[QosProfile, ...]:
    """Return profiles from YAML text or from the list that metadata version 9 nests.

    A profile that cannot be understood is left out: the messages matter more than the offer.
    """
    try:
        entries = yaml_text.load(offered) if isinstance(offered, str) else offered
    except yaml_text.YAMLError:
        return ()
    profiles = []
    for entry in entries if isinstance(entries, list) else []:
        try:
            profiles.append(from_yaml_map(entry))
        except (ValueError, TypeError, KeyError, OverflowError, AttributeError):
            continue
    return tuple(profiles)


def adapt(offers: Sequence[QosProfile]) -> tuple[bool, bool]:
    """Return the profile of a subscription that hears every publisher, as rosbag2's recorder.

    Returns:
        `(reliable, transient_local)`: each only if every publisher offers it.
    """
    if not offers:
        return False, False
    return (
        all(offer.reliability == "reliable" for offer in offers),
        all(offer.durability == "transient_local" for offer in offers),
    )
