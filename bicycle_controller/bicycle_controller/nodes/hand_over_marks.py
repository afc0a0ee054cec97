"""Markers of the hand-overs for RViz and Foxglove: who drives, and where it took over."""

from __future__ import annotations

from bicycle_msgs.msg import HandOver
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from bicycle_common.angles import in_degrees
from bicycle_common.nodes import convert
from bicycle_common.nodes.topics import ODOM_FRAME
from bicycle_common.types import Point2D
from bicycle_sim.nodes.robot_model import FOOTPRINT

WHO, WHERE = "who drives", "hand-overs"
"""Namespaces of the markers."""
ABOVE = 2.9
"""Height of the words above the ground, over the simulator's own (m)."""
LETTERS = 0.25
"""Height of a capital letter (m)."""
SPOT = 0.4
"""Diameter of the ball where the fallback took over (m)."""
MOST_SPOTS = 500
ALARM = ColorRGBA(r=1.0, g=0.55, b=0.0, a=1.0)


class HandOverMarks:
    """Markers of one episode's hand-overs.

    Args:
        prefix: before the frames, see `robot_model.frames_of`.
    """

    def __init__(self, prefix: str = "") -> None:
        self._prefix = prefix
        self._spots: list[Point] = []
        self._words = ""

    def clear(self) -> MarkerArray:
        """Forget the hand-overs, for a new episode; return markers that remove the old ones."""
        self._spots, self._words = [], ""
        return self._message()

    def add(self, told: HandOver, place: Point2D) -> MarkerArray:
        """Return the markers after a hand-over.

        Args:
            told: as it is published.
            place: of the rear contact, m.
        """
        back = told.reason == HandOver.NONE and not told.stop
        if told.reason != HandOver.NONE:
            self._spots = [*self._spots, convert.to_point(place)][-MOST_SPOTS:]
        why = told.message.partition(": ")[0]
        self._words = "" if back else f"{told.policy} drives\n{in_degrees(why)}"
        return self._message()

    def _message(self) -> MarkerArray:
        """Return both markers; an empty one is removed."""
        # Stamp 0 is the newest transform: the words stay with the bicycle.
        words = Marker(header=convert.to_header(0, self._prefix + FOOTPRINT), ns=WHO)
        words.type, words.frame_locked = Marker.TEXT_VIEW_FACING, True
        words.pose.position.z = ABOVE
        words.scale.z = LETTERS
        words.text = self._words
        spots = Marker(header=convert.to_header(0, self._prefix + ODOM_FRAME), ns=WHERE)
        spots.type = Marker.SPHERE_LIST
        spots.scale = Vector3(x=SPOT, y=SPOT, z=SPOT)
        spots.points = self._spots
        for marker, shown in ((words, bool(self._words)), (spots, bool(self._spots))):
            marker.action = Marker.ADD if shown else Marker.DELETE
            marker.pose.orientation.w = 1.0
            marker.color = ALARM
        return MarkerArray(markers=[words, spots])
