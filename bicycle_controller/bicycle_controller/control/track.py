"""A speed that poses bear out: what a bicycle tells of it, or what its last places show."""

from __future__ import annotations

import math
from collections import deque

from bicycle_common.types import Point2D

LEAST, MOST = 0.4, 0.8
"""s between the places that a speed is measured from."""
DOUBT = 1.0
"""m/s by which a told speed may differ from the measured one; half of it, if that is more."""
JUMP = 20.0
"""m/s, above which a place was set anew and not ridden to."""


class Track:
    """Places of one bicycle during the last moments."""

    def __init__(self) -> None:
        self._places: deque[tuple[float, float, Point2D]] = deque()

    def speed(
        self, now: float, stamp: float, place: Point2D, heading: float, told: float
    ) -> float:
        """Return the speed to believe, m/s, positive forwards.

        Args:
            now: s by the clock, when the place was heard.
            stamp: s by the bicycle's own clock; it may stand still, or be none.
            place: m.
            heading: rad, psi.
            told: m/s, the bicycle's own word.
        """
        places = self._places
        places.append((now, stamp, place))
        while now - places[0][0] > MOST:
            places.popleft()
        heard, stamped, first = places[0]
        if now - heard < LEAST:
            return told
        # Simulated time may run slower or faster than the clock, or stand as the bicycle does.
        seconds = stamp - stamped if stamp > stamped else now - heard
        dx, dy = place[0] - first[0], place[1] - first[1]
        measured = (dy * math.cos(heading) - dx * math.sin(heading)) / seconds
        if math.hypot(dx, dy) > JUMP * seconds or stamp < stamped:
            places.clear()
            return told
        doubtful = abs(measured - told) > max(DOUBT, 0.5 * max(abs(told), abs(measured)))
        return measured if doubtful else told
