"""Bicycles, not points, keep clear at crossings."""

from __future__ import annotations

import pytest

from bicycle_controller.evaluation import crossings
from bicycle_sim.plants import registry


def test_no_collision_where_blind_ones_collide() -> None:
    found = crossings.score(registry.named(plant="whipple", bicycle="browser-rider"), 60, seed=3)
    assert found["below_1_m"] == found["falls"] == 0
    assert found["below_1_m_blind"] > 10
    assert "60 crossings: nearest" in crossings.as_text(found)


def test_a_number_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="choose 1 to"):
        crossings.score(registry.default(), 0)
