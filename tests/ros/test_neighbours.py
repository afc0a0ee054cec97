"""The other bicycles' odometry: the newest is read, and what holds no pose is nobody's."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from nav_msgs.msg import Odometry
from probe import Probe

from bicycle_common.geometry import yaw_to_heading
from bicycle_common.nodes import convert, topics
from bicycle_controller.control.keep_clear import Mover
from bicycle_controller.nodes import neighbours
from bicycle_controller.nodes.neighbours import Neighbours

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    result = Probe(ros_domain, namespace="/b2")
    yield result
    result.close()


def odometry(x: float) -> Odometry:
    message = Odometry()
    message.pose.pose.position.x = x
    message.pose.pose.orientation = convert.to_quaternion(0.5)
    message.twist.twist.linear.x = 3.0
    return message


def test_the_newest_is_read_and_what_holds_no_pose_is_silence(
    probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    movers: dict[str, Mover] = {}
    watched = Neighbours(probe.node, ["b2", "b3"], movers)
    try:
        assert watched.unheard == ["b2", "b3"]
        publisher = probe.publisher(topics.ODOMETRY)
        # Nobody reads in between: the timer's turns come with the executor's.
        for x in range(1, 6):
            publisher.publish(odometry(float(x)))
        probe.spin_until(lambda: "b2" in movers and movers["b2"].x[0] == 5.0)
        assert movers["b2"].speed[0] == 3.0
        assert float(yaw_to_heading(0.5)) == pytest.approx(movers["b2"].heading[0])
        assert watched.unheard == ["b3"]

        monkeypatch.setattr(neighbours, "FORGOTTEN", 0.3)
        broken = odometry(9.0)
        broken.pose.pose.orientation.w = 7.0

        def is_silent() -> bool:
            publisher.publish(broken)
            return watched.unheard == ["b2", "b3"]

        probe.spin_until(is_silent)
        assert movers == {}
    finally:
        watched.close()


def test_a_bicycle_that_stands_is_not_taken_for_one_that_rides(probe: Probe) -> None:
    """Some publishers leave the last speed in the twist of a bicycle that lies."""
    movers: dict[str, Mover] = {}
    watched = Neighbours(probe.node, ["b2"], movers)
    try:
        publisher = probe.publisher(topics.ODOMETRY)

        def stands() -> bool:
            publisher.publish(odometry(7.0))
            return "b2" in movers and movers["b2"].speed[0] == 0.0

        probe.spin_until(stands)
        assert movers["b2"].x[0] == 7.0
    finally:
        watched.close()
