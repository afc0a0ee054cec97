"""Readings are taken, whatever the order in which the topics come."""

from __future__ import annotations

import itertools

import numpy as np

from bicycle_controller.estimation.order import SET_BACK, InOrder, Pairs
from bicycle_sim.sensors.reading import Reading

STAMPS = [(1, 0), (1, 100), (2, 0)]


def reading(sensor: str, stamp: float) -> Reading:
    return Reading(sensor, stamp, np.array([stamp]), np.zeros(1, dtype=bool), np.zeros((1, 1)))


def paired(order: list[tuple[str, tuple[int, int]]]) -> list[tuple[str, str]]:
    """Return the pairs that messages in some order make."""
    pairs: Pairs[str, str] = Pairs()
    found = []
    for topic, key in order:
        take = pairs.first if topic == "fix" else pairs.second
        found.append(take(key, f"{topic} {key}"))
    return [one for one in found if one is not None]


def test_every_order_of_two_topics_makes_the_same_pairs() -> None:
    expected = [(f"fix {key}", f"velocity {key}") for key in STAMPS]
    orders = set(itertools.permutations(["fix"] * 3 + ["velocity"] * 3))
    assert len(orders) == 20
    for topics in orders:
        left = {"fix": iter(STAMPS), "velocity": iter(STAMPS)}
        assert paired([(topic, next(left[topic])) for topic in topics]) == expected, topics


def test_a_lost_half_costs_its_own_pair_only() -> None:
    kept = [("velocity", key) for key in STAMPS if key != (1, 100)]
    for order in (
        [("fix", key) for key in STAMPS] + kept,
        kept + [("fix", key) for key in STAMPS],
    ):
        assert [first for first, _ in paired(order)] == ["fix (1, 0)", "fix (2, 0)"]


def test_an_overtaken_reading_is_not_taken_and_other_sensors_are() -> None:
    in_order = InOrder()
    stamps = [1.0, 1.2, 1.1, 1.2, 1.3]
    assert [in_order.takes(reading("imu", stamp)) for stamp in stamps] == [
        *(True, True, False, False, True)
    ]
    assert in_order.takes(reading("gnss", 0.9))


def test_a_clock_that_begins_anew_is_followed() -> None:
    in_order = InOrder()
    assert in_order.takes(reading("imu", 50.0))
    again = reading("imu", 50.0 - 2.0 * SET_BACK)
    assert in_order.begins_anew(again)
    assert in_order.takes(again)
    assert not in_order.begins_anew(reading("imu", 49.0))
