"""The rule by which the estimator takes or drops a reading.

The rule depends only on the order of messages within each topic. A bag keeps that order, but not
the order between topics, so a replay takes the same readings as the live ride.
"""

from __future__ import annotations

from typing import Generic, TypeVar

from bicycle_sim.sensors.reading import Reading

SET_BACK = 1.0
"""s. If a stamp is older than the last one by more, the sensors' clock was restarted; if by less,
a newer reading has overtaken it."""

MOST_UNPAIRED = 4000
"""Halves of a pair that may wait for the other half: at most this many are published at once."""


class InOrder:
    """The order in which each sensor's readings come."""

    def __init__(self) -> None:
        """Begin before the first."""
        self._newest: dict[str, float] = {}

    def takes(self, reading: Reading) -> bool:
        """Return False for a reading that a newer one of its sensor has overtaken."""
        newest = self._newest.get(reading.sensor)
        if newest is not None and newest - SET_BACK < reading.stamp <= newest:
            return False
        self._newest[reading.sensor] = reading.stamp
        return True

    def begins_anew(self, reading: Reading) -> bool:
        """Return True if the sensors' clock was set back before a reading; ask before `takes`."""
        newest = self._newest.get(reading.sensor)
        return newest is not None and reading.stamp <= newest - SET_BACK


First = TypeVar("First")
Second = TypeVar("Second")
Key = tuple[int, int]
"""Time stamp, s and ns."""


class Pairs(Generic[First, Second]):
    """Pairs the messages of two topics that have the same stamp, whichever topic is ahead."""

    def __init__(self) -> None:
        """Begin before the first."""
        self._firsts: dict[Key, First] = {}
        self._seconds: dict[Key, Second] = {}

    def first(self, key: Key, message: First) -> tuple[First, Second] | None:
        """Take a message of the first topic; return its pair once both are there."""
        second = self._seconds.get(key)
        if second is None:
            _keep(self._firsts, key, message)
            return None
        self._forget(key)
        return message, second

    def second(self, key: Key, message: Second) -> tuple[First, Second] | None:
        """Take a message of the second topic; otherwise as `first`."""
        first = self._firsts.get(key)
        if first is None:
            _keep(self._seconds, key, message)
            return None
        self._forget(key)
        return first, message

    def _forget(self, key: Key) -> None:
        """Forget a pair, and halves that are older than it: `InOrder` would not take them."""
        for waiting in (self._firsts, self._seconds):
            for old in [one for one in waiting if one <= key]:
                del waiting[old]


Message = TypeVar("Message")


def _keep(waiting: dict[Key, Message], key: Key, message: Message) -> None:
    waiting[key] = message
    if len(waiting) > MOST_UNPAIRED:
        del waiting[next(iter(waiting))]
