"""Announcements of episodes: they tell which episodes are learned from.

Announcements and states come on two topics, so either may arrive first.
"""

from __future__ import annotations

from collections import deque

MOST = 1_000
"""Announcements that are kept for episodes of which no state has come."""


class AnnouncedEpisodes:
    """Tells for each episode whether its bicycle is the one that is learned from.

    Each simulator counts its episodes from 1, so a number may come again with another bicycle. An
    announcement therefore holds for one episode only.
    """

    def __init__(self) -> None:
        """Start before the first announcement."""
        self._announced: deque[tuple[int, bool]] = deque(maxlen=MOST)

    def announce(self, episode: int, learned: bool) -> None:
        """Take in the announcement of an episode.

        Args:
            episode: its number.
            learned: True if its bicycle is the one that is learned from.
        """
        self._announced.append((episode, learned))

    def begin(self, episode: int) -> bool | None:
        """Return what was announced for an episode whose first state is here; None if nothing.

        A lost announcement is replaced by the next one, which has a higher number and is of the
        same simulator.
        """
        numbers = [number for number, _ in self._announced]
        if episode in numbers:
            for _ in range(numbers.index(episode)):
                self._announced.popleft()
            return self._announced.popleft()[1]
        later = (learned for number, learned in self._announced if number > episode)
        return next(later, None)
