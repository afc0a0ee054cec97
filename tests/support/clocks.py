"""A bag again, recorded by clocks that nobody should trust; the order is the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bicycle_bag.reader import BagReader
from bicycle_bag.writer import BagWriter

SECOND = 1_000_000_000
HOUR = 3600 * SECOND

Clock = Callable[[float, int], int]
"""Clock that writes a bag: log time (ns) from the share of messages written and the true time."""


def _set_back(share: float, now: int) -> int:
    return now + (HOUR if share <= 0.5 else 0)


def _ahead(share: float, now: int) -> int:
    return now + (2**62 if share > 0.5 else 0)


def _beyond_2262(share: float, now: int) -> int:
    return now % SECOND + 2**63 + int(share * SECOND)


def _late_start(share: float, now: int) -> int:
    return now if share > 0.1 else 0


def _standing(share: float, now: int) -> int:
    return 5 * SECOND


def _backwards(share: float, now: int) -> int:
    return 2**60 - int(share * 1e6) * SECOND


def _nonsense(share: float, now: int) -> int:
    return hash((share, now)) % 2**64


CLOCKS: dict[str, Clock] = {
    "set back by an hour": _set_back,
    "set ahead by 146 years": _ahead,
    "beyond 2262": _beyond_2262,
    "at 0 for the first tenth": _late_start,
    "standing still": _standing,
    "running backwards": _backwards,
    "nonsense": _nonsense,
}


def with_clock(source: Path, target: Path, clock: Clock, publishers: bool = False) -> Path:
    """Write a bag's messages again with other log times, and publish times where asked for."""
    reader = BagReader(source)
    with BagWriter(target) as writer:
        for name, topic in reader.topics.items():
            writer.add_topic(topic, reader.definition(name))
        count = reader.message_count
        for number, item in enumerate(reader.messages()):
            logged = clock(number / count, item.log_time_ns)
            sent = clock(number / count, item.publish_time_ns)
            published = sent if publishers else item.publish_time_ns
            writer.write(item.topic, item.data, logged, published)
    return target
