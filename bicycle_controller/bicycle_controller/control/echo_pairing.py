"""Pairs each state with the echo of the command that led to it.

Whoever applies commands publishes the echo just before the state, on another topic. A state that
overtakes its echo waits for it, as long as somebody publishes echoes that keep up: else it would
be answered without knowing whether another controller drives.
"""

from __future__ import annotations

from typing import Generic, TypeVar

Key = tuple[int, int]
"""Episode and step of a state."""

State = TypeVar("State")
Echo = TypeVar("Echo")


class EchoPairing(Generic[State, Echo]):
    """The newest echo, and a state that waits for its own; of any types."""

    def __init__(self) -> None:
        """Start before the first echo."""
        self._newest: tuple[Key, Echo] | None = None
        self._waiting: tuple[Key, State] | None = None
        self._passed_over = False

    def add(self, key: Key, echo: Echo) -> State | None:
        """Take in an echo; return the state that waited for it, if any."""
        self._newest = key, echo
        self._passed_over = False
        waiting = self._waiting
        if waiting is None or waiting[0] > key:
            return None
        self._waiting = None
        return waiting[1]

    def of(self, key: Key) -> Echo | None:
        """Return the echo of a state; None if it is not known."""
        return self._newest[1] if self._newest is not None and self._newest[0] == key else None

    def holds(self, key: Key, state: State, echoed: bool) -> bool:
        """Return True if a state waits for its echo: `add` will return it.

        Args:
            key: the state's key.
            state: the newest one; it replaces one that waits.
            echoed: True if somebody publishes echoes.
        """
        self._passed_over |= self._waiting is not None
        self._waiting = None
        behind = self._newest is None or self._newest[0] < key
        if not (echoed and behind) or self._passed_over:
            return False
        self._waiting = key, state
        return True
