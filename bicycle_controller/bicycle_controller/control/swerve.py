"""Keeping clear without a path: on the way to goals, straight on, or by cmd_vel.

The rule is that of `keep_clear`. In place of a path there is a way: the straight line in a
direction, to the goal for example, from where a bicycle begins to give way. It slows down with the
pedal if it has one, and swerves by steering beside its way; without a pedal it only swerves.
Without others nothing changes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_controller.control.keep_clear import AGAINST, HEAD_ON, SHIFTS, Mover, keep_clear

SIGHT = 6.0
"""m ahead at which a swerve is beside the way by what the rule asks for."""
PEDAL_GAIN = 200.0
"""N of pedal force per m/s of speed above the highest one."""
WIDE = (*SHIFTS, -4.5, 4.5, -6.0, 6.0)
"""m to the left that a bicycle without a pedal tries."""
SIDE = 2.0
"""m of clearance that the other side must gain before such a bicycle changes sides."""
NARROW = np.radians(90.0)
"""Angle between two ways up to which a bicycle without a pedal turns away, rad."""
TURN_GAIN = 0.8
"""1/s, yaw rate per heading error of a bicycle that is steered by turns."""
TURN_LIMIT = 0.6
"""rad/s, the largest yaw rate of a swerve."""
BACK = 0.05
"""rad from its way at which a bicycle is back on it."""


class Swerve:
    """Memory of how N bicycles pass others; arrays are (N,).

    Attributes:
        others: other bicycles by name, each a Mover of N.
        name: own name among them.
        pedals: False if the speed cannot be changed.
        yielding: (N,) bool, True where it gave way at the last look.
    """

    def __init__(self, others: Mapping[str, Mover] | None = None, name: str = "") -> None:
        self.others: Mapping[str, Mover] = {} if others is None else others
        self.name, self.pedals = name, True
        self.yielding: np.ndarray = np.zeros(1, dtype=bool)
        self._shifts: dict[str, np.ndarray] = {}
        self._narrow: dict[str, np.ndarray] = {}
        self._cruise: np.ndarray | None = None
        self._way: np.ndarray | None = None
        self._from: np.ndarray | None = None

    def forget(self) -> None:
        """Forget how others were passed: a new order came."""
        self._shifts.clear()
        self._narrow.clear()
        self._cruise = self._way = self._from = None
        self.yielding = np.zeros(1, dtype=bool)

    def look(
        self, own: Mover, slowest: float, wanted: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the highest speed, m/s, and the angle to the left of the way to steer in, rad.

        Args:
            own: the bicycles; their headings are those of their ways.
            slowest: m/s to slow down to at most.
            wanted: m/s; by default the speed from before a bicycle gave way.
        """
        count = len(own.speed)
        if not self.others:
            self.forget()
            return np.full(count, np.inf), np.zeros(count)
        if wanted is None:
            held = own.speed if self._cruise is None else self._cruise
            wanted = self._cruise = np.where(self.yielding, held, own.speed)
        names, many = list(self.others), len(self.others)
        other = Mover(*map(np.array, zip(*self.others.values(), strict=True)))
        x, y, along = self._lines(own, other)
        left = (x - own.x) * np.cos(along) + (y - own.y) * np.sin(along)
        way = keep_clear(
            Mover(*(np.tile(value, many) for value in own))._replace(heading=along.ravel()),
            Mover(*(value.ravel() for value in other)),
            np.repeat([self.name > name for name in names], count),
            np.tile(wanted, many),
            np.tile(np.minimum(slowest, wanted) if self.pedals else wanted, many),
            left.ravel(),
            np.concatenate([self._shifts.get(name, np.zeros(count)) for name in names]),
            SHIFTS if self.pedals else WIDE,
            AGAINST if self.pedals else HEAD_ON,
            0.0 if self.pedals else SIDE,
        )
        speed, shift, yields = (value.reshape(many, count) for value in way)
        self._shifts = dict(zip(names, shift, strict=True))
        self.yielding = np.asarray(yields.any(axis=0))
        one = np.abs(shift).argmax(axis=0), np.arange(count)
        aside = along[one] + np.arctan2(shift[one] - left[one], SIGHT)
        # Who gives way rides no faster than before, so that the other can foresee it.
        slows = self.yielding & self.pedals
        return (
            np.where(slows, speed.min(axis=0), np.inf),
            np.where(self.yielding, wrap_angle(aside - own.heading), 0.0),
        )

    def _lines(self, own: Mover, other: Mover) -> np.ndarray:
        """Return x, y (m) and direction (rad) of the lines that are shifted, (3, M, N).

        Who cannot slow down turns away from a bicycle that rides nearly the same way, and rides
        beside it until it is past: beside its line it would meet it as soon as on the line.
        """
        here = np.array([own.x, own.y, own.heading])
        self._from = here if self._from is None else np.where(self.yielding, self._from, here)
        narrow = (np.abs(wrap_angle(other.heading - own.heading)) < NARROW) & (not self.pedals)
        # A way that changes under way must not change how the other is passed.
        before = [
            self._narrow.get(name, now) for name, now in zip(self.others, narrow, strict=True)
        ]
        narrow = np.where(self.yielding, before, narrow)
        self._narrow = dict(zip(self.others, narrow, strict=True))
        return np.where(narrow, here[:, None], self._from[:, None])

    def turn(
        self, own: Mover, turned: np.ndarray, slowest: float, wanted: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the highest speed, m/s, and the yaw rate beside the commanded one, rad/s.

        Args:
            own: the bicycles as they ride.
            turned: rad that their ways have turned by command since the last call.
            slowest: m/s to slow down to at most.
            wanted: m/s.
        """
        heading = own.heading
        if self._from is not None:
            self._from[2] += turned
        way = heading if self._way is None else np.asarray(wrap_angle(self._way + turned))
        speed, aside = self.look(own._replace(heading=way), slowest, wanted)
        off = np.asarray(wrap_angle(way + aside - heading))
        on_it = ~self.yielding & ((aside == 0.0) & (np.abs(off) < BACK))
        self._way = np.where(on_it, heading, way)
        rate = np.clip(TURN_GAIN * off, -TURN_LIMIT, TURN_LIMIT)
        return speed, np.where(on_it, 0.0, rate)


def pedal_at_most(pedal: np.ndarray, speed: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return the pedal force, N, that rides at `most` at most, m/s; arrays of (N,)."""
    slow = np.isfinite(most)
    return np.where(
        slow, np.minimum(pedal, PEDAL_GAIN * (np.where(slow, most, 0.0) - speed)), pedal
    )
