"""Actions arrive late by each episode's own delay, and nothing of an old episode arrives."""

from __future__ import annotations

import numpy as np

from bicycle_controller.training.late_actions import LateActions


def test_each_action_arrives_after_its_delay() -> None:
    late = LateActions(50, 3, np.random.default_rng(1))
    assert set(late.delays) == {0, 1, 2, 3}
    for step in range(8):
        found = late.arriving(np.full((50, 3), float(step + 1)))
        expected = np.maximum(step + 1 - late.delays, 0)
        np.testing.assert_array_equal(found[:, 0], expected)


def test_a_new_episode_begins_empty() -> None:
    late = LateActions(50, 3, np.random.default_rng(2))
    for _ in range(4):
        late.arriving(np.ones((50, 3)))
    before, mask = late.delays.copy(), np.arange(50) < 25
    late.reset(mask)
    assert (late.delays[25:] == before[25:]).all()
    assert (late.delays[:25] != before[:25]).any()
    found = late.arriving(np.full((50, 3), 2.0))[:, 1]
    np.testing.assert_array_equal(found[:25], np.where(late.delays[:25] == 0, 2.0, 0.0))
    np.testing.assert_array_equal(found[25:], np.where(late.delays[25:] == 0, 2.0, 1.0))


def test_without_a_delay_nothing_is_drawn() -> None:
    rng = np.random.default_rng(3)
    before = rng.bit_generator.state
    late, action = LateActions(4, 0, rng), np.ones((4, 3))
    assert late.arriving(action) is action
    assert rng.bit_generator.state == before


def test_what_is_under_way_is_kept() -> None:
    one, other = (LateActions(9, 4, np.random.default_rng(seed)) for seed in (4, 5))
    for step in range(3):
        one.arriving(np.full((9, 3), float(step)))
    other.load_state_dict(one.state_dict())
    first, second = (late.arriving(np.zeros((9, 3))) for late in (one, other))
    np.testing.assert_array_equal(first, second)
