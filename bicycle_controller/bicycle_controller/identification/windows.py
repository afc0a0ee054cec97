"""Short stretches of rides, stacked by speed: what a fit simulates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bicycle_controller.identification.logs import Array, Log, Piece
from bicycle_controller.identification.pushes import pushed

HISTORY = 0.25
"""s of torque before a window, for delay and lag."""
SLOWEST = 0.5
"""m/s below which a bicycle is being started, not ridden."""

TURNED = 0.35
"""rad of steering beyond which a bicycle is no longer linear."""


class Window(NamedTuple):
    """A stretch of a ride at one speed."""

    log: int
    time: float
    """s in its piece, of the first sample."""
    dt: float
    speed: float
    """m/s, the mean."""
    lean_rate: Array
    steer_angle: Array
    torque: Array
    """N m, preceded by HISTORY samples."""


class Stack(NamedTuple):
    """Windows of one length, sampling and speed: (k, n) each, torque (k, h + n)."""

    rows: Array
    dt: float
    speed: float
    lean_rate: Array
    steer_angle: Array
    torque: Array


def cut(logs: list[Log], seconds: float) -> list[Window]:
    """Return windows of so many seconds, one after the other, without pushes."""
    found = []
    for number, log in enumerate(logs):
        for piece in log.pieces:
            count = max(8, round(seconds / piece.dt))
            bad = pushed(piece) | (piece.speed < SLOWEST) | (np.abs(piece.steer_angle) > TURNED)
            start = round(HISTORY / piece.dt)
            while start + count <= len(bad):
                hit = np.flatnonzero(bad[start : start + count])
                if len(hit):
                    start += int(hit[-1]) + 1
                    continue
                found.append(window(number, piece, start, count))
                start += count
    return found


def window(number: int, piece: Piece, start: int, count: int) -> Window:
    """Return the window of a piece that starts at a sample; short history is filled up."""
    dt = piece.dt
    before = round(HISTORY / dt)
    torque = piece.torque
    history = torque[max(0, start - before) : start + count]
    lacking = before + count - len(history)
    rows = slice(start, start + count)
    return Window(
        number,
        start * dt,
        dt,
        float(np.mean(piece.speed[rows])),
        piece.lean_rate[rows],
        piece.steer_angle[rows],
        np.concatenate([np.full(lacking, history[0]), history]) if lacking else history,
    )


def stacks(windows: list[Window]) -> list[Stack]:
    """Return the windows grouped by sampling, length and speed."""
    speeds = np.array([one.speed for one in windows])
    width = max(0.02, float(np.ptp(speeds)) / 40.0) if len(speeds) else 1.0
    groups: dict[tuple[float, int, int], list[int]] = {}
    for row, one in enumerate(windows):
        key = (one.dt, len(one.lean_rate), round(one.speed / width))
        groups.setdefault(key, []).append(row)
    return [
        Stack(
            np.array(rows),
            dt,
            float(speeds[rows].mean()),
            *(
                np.stack([getattr(windows[row], key) for row in rows])
                for key in ("lean_rate", "steer_angle", "torque")
            ),
        )
        for (dt, _, _), rows in groups.items()
    ]
