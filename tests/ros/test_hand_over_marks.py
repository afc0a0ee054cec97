"""Markers of hand-overs, from the real messages."""

from __future__ import annotations

import pytest
from bicycle_msgs.msg import HandOver
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from bicycle_controller.nodes.hand_over_marks import MOST_SPOTS, WHERE, WHO, HandOverMarks

pytestmark = pytest.mark.ros

TAKEN = HandOver(
    reason=HandOver.LEAN_RATE,
    policy="lqr-12",
    message="lean rate 0.6 rad/s is beyond 0.5 rad/s: lqr-12 takes over from policy naf@5",
)
BACK = HandOver(reason=HandOver.NONE, policy="naf@5", message="calm again: policy naf@5 drives")


def by_namespace(array: MarkerArray) -> dict[str, Marker]:
    """Return the markers as a subscriber gets them."""
    copy = deserialize_message(serialize_message(array), MarkerArray)
    return {one.ns: one for one in copy.markers}


def test_words_follow_the_bicycle_while_the_fallback_drives_and_places_stay() -> None:
    marks = HandOverMarks("b1/")
    shown = by_namespace(marks.add(TAKEN, (3.0, -1.5)))
    assert shown[WHO].text == "lqr-12 drives\nlean rate 34.4°/s is beyond 28.6°/s"
    assert shown[WHO].action == Marker.ADD
    assert shown[WHO].frame_locked
    assert shown[WHO].header.frame_id == "b1/base_footprint"
    assert shown[WHERE].header.frame_id == "b1/odom"
    shown = by_namespace(marks.add(BACK, (9.0, 0.0)))
    assert shown[WHO].action == Marker.DELETE
    assert shown[WHERE].action == Marker.ADD
    assert [(p.x, p.y) for p in shown[WHERE].points] == [(3.0, -1.5)]


def test_a_stopped_bicycle_is_told_until_the_next_episode() -> None:
    marks = HandOverMarks()
    marks.add(TAKEN, (0.0, 0.0))
    calm = HandOver(reason=HandOver.NONE, stop=True, policy="lqr-12", message=BACK.message)
    assert by_namespace(marks.add(calm, (1.0, 0.0)))[WHO].action == Marker.ADD
    cleared = by_namespace(marks.clear())
    assert {one.action for one in cleared.values()} == {Marker.DELETE}
    assert not cleared[WHERE].points


def test_a_long_ride_keeps_the_latest_places() -> None:
    marks = HandOverMarks()
    for number in range(MOST_SPOTS + 5):
        shown = marks.add(TAKEN, (float(number), 0.0))
    points = by_namespace(shown)[WHERE].points
    assert (len(points), points[0].x) == (MOST_SPOTS, 5.0)
