"""The ring of the last estimates."""

from __future__ import annotations

import numpy as np

from bicycle_controller.estimation.history import History

LENGTH = 5


def filled(count: int) -> History:
    """Return a history of times 1, 2, ... whose states are ten times that."""
    found = History(LENGTH, (1, 2))
    for time in range(1, count + 1):
        found.add(float(time), np.full((1, 2), 10.0 * time))
    return found


def test_it_keeps_the_last_ones_however_many_there_were() -> None:
    for count in range(1, 4 * LENGTH):
        history = filled(count)
        oldest = max(1, count - LENGTH + 1)
        assert history.at(-1e9)[0, 0] == 10.0 * oldest, count
        assert history.at(1e9)[0, 0] == 10.0 * count, count
        for time in range(oldest, count + 1):
            assert history.at(float(time))[0, 1] == 10.0 * time, (count, time)


def test_between_two_it_interpolates() -> None:
    assert filled(13).at(11.25)[0, 0] == 112.5


def test_a_correction_counts_from_its_time_on() -> None:
    for count in (3, 8, 11, 14):
        history = filled(count)
        history.correct(count - 1.0, np.array([[1.0, 2.0]]))
        assert history.at(count - 2.0)[0, 0] == 10.0 * (count - 2)
        assert history.at(count - 1.0)[0, 0] == 10.0 * (count - 1) + 1.0
        assert history.at(float(count))[0, 1] == 10.0 * count + 2.0


def test_what_was_added_is_a_copy_and_cleared_it_is_empty() -> None:
    history, state = History(LENGTH, (1, 2)), np.ones((1, 2))
    history.add(1.0, state)
    state[:] = 7.0
    assert history.at(1.0)[0, 0] == 1.0
    history.clear()
    history.add(0.5, state)
    assert history.at(1.0)[0, 0] == 7.0
