"""Pairs each state with the echo of the command that led to it.

The simulator or driver publishes the echo just before the state, on another topic. A state that
overtakes its echo waits for it as long as echoes keep arriving: without the echo, the controller
would not know whether another one drives. A reader may keep only the newest message of each topic,
so a later echo also ends the wait, because the state of that echo comes next.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

Key = tuple[int, int]
"""Episode and step of a state."""

MOST = 4
"""States in a row that may wait for an echo that does not come."""

KEPT = 8
"""Echoes that are kept: a state may come after the echo of the next one."""

State = TypeVar("State")
Echo = TypeVar("Echo")


class EchoPairing(Generic[State, Echo]):
    """The newest echoes, and a state that waits for its own; of any types."""

    def __init__(self) -> None:
        """Start before the first echo."""
        self._echoes: deque[tuple[Key, Echo]] = deque(maxlen=KEPT)
        self._waiting: tuple[Key, State] | None = None
        self._passed_over = 0

    def add(self, key: Key, echo: Echo) -> State | None:
        """Take in an echo; return the state that waited for it, if any."""
        self._echoes.append((key, echo))
        self._passed_over = 0
        waiting = self._waiting
        if waiting is None or waiting[0] > key:
            return None
        self._waiting = None
        return waiting[1] if waiting[0] == key else None

    def knows(self, key: Key) -> bool:
        """Return True if the echo of a state has come, readable or not."""
        return any(known == key for known, _ in self._echoes)

    def of(self, key: Key) -> Echo | None:
        """Return the echo of a state; None if it is not known."""
        return next((echo for known, echo in reversed(self._echoes) if known == key), None)

    def holds(self, key: Key, state: State, echoed: bool) -> bool:
        """Return True if a state must not be answered now: `add` will return it or a later one.

        Args:
            key: the state's key.
            state: the newest one; it replaces one that waits.
            echoed: True if somebody publishes echoes.
        """
        self._passed_over += self._waiting is not None
        self._waiting = None
        if not echoed or self.knows(key) or self._passed_over >= MOST:
            return False
        newest = self._echoes[-1][0] if self._echoes else None
        if newest is None or newest < key:
            self._waiting = key, state
            return True
        # A newer echo is here, so the state of that one comes next and this one is left out. A
        # state that is many steps older belongs to a simulator that was restarted.
        return newest[0] == key[0] and newest[1] - key[1] <= MOST
