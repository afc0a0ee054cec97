"""Announced episodes: which of them are learned from, whichever topic is quicker."""

from __future__ import annotations

from collections import deque

MOST = 1_000
"""Announcements that are kept for episodes of which no state has come."""


class AnnouncedEpisodes:
    """Answers for each episode whether its bicycle is the one that is learned.

    Each simulator counts its episodes from 1, so that a number returns with another bicycle. An
    announcement therefore counts for one episode alone.
    """

    def __init__(self) -> None:
        """Start before the first announcement."""
        self._announced: deque[tuple[int, bool]] = deque(maxlen=MOST)

    def announce(self, episode: int, learned: bool) -> None:
        """Take in that an episode begins, and True if its bicycle is the one that is learned."""
        self._announced.append((episode, learned))

    def begin(self, episode: int) -> bool | None:
        """Return what was announced for an episode whose first state is here; None if nothing.

        An announcement that was lost is replaced by the next one of the same simulator, which has
        a higher number.
        """
        numbers = [number for number, _ in self._announced]
        if episode in numbers:
            for _ in range(numbers.index(episode)):
                self._announced.popleft()
            return self._announced.popleft()[1]
        later = (learned for number, learned in self._announced if number > episode)
        return next(later, None)
