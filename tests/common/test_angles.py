"""Angles for people."""

from __future__ import annotations

from bicycle_common.angles import in_degrees


def test_angles_and_rates_are_told_in_degrees_and_nothing_else_changes() -> None:
    text = "lean rate 0.6 rad/s is beyond 0.5 rad/s: lean -0.1 rad at 5 m/s, 1e-05 rad"
    assert in_degrees(text) == (
        "lean rate 34.4°/s is beyond 28.6°/s: lean -5.73° at 5 m/s, 0.000573°"
    )
    assert in_degrees("3 radios, 2 m") == "3 radios, 2 m"
