"""Logs of rides as identification reads them: speed, lean rate, steering and steer torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bicycle_common.validation import require

Array = np.ndarray

SHORTEST = 0.5
"""s; shorter pieces between gaps are left out."""
TOO_MUCH = {"speed": 40.0, "lean_rate": 20.0, "steer_angle": 3.2, "torque": 500.0}
"""Magnitudes in SI units beyond which a column must have another unit."""


@dataclass(frozen=True)
class Piece:
    """A stretch without gaps, (n,) each; lean and steer positive to the same side."""

    dt: float
    """s between samples."""
    speed: Array
    """m/s."""
    lean_rate: Array
    """rad/s."""
    steer_angle: Array
    """rad."""
    torque: Array
    """N m on the handlebar from each sample to the next."""


@dataclass(frozen=True)
class Log:
    """Log of one ride."""

    name: str
    pieces: tuple[Piece, ...]

    @property
    def seconds(self) -> float:
        """Length of the ride, s."""
        return sum(len(piece.speed) * piece.dt for piece in self.pieces)


def log_of(name: str, time: Array, columns: dict[str, Array], breaks: Array) -> Log:
    """Return a log from columns in SI units.

    Args:
        name: for people and errors.
        time: (n,) s.
        columns: speed, lean_rate, steer_angle, torque, (n,) each.
        breaks: (n,) bool, True where a row does not follow the one before.

    Raises:
        ValueError: on times that do not rise, values beyond reason or too short a ride; one line.
    """
    step = np.diff(time)
    inside = ~breaks[1:]
    require(bool(inside.any()), f"{name}: no two rows follow each other")
    back = np.flatnonzero(inside & (step <= 0.0))
    if len(back):
        raise ValueError(
            f"{name}: the time does not rise at row {back[0] + 2} "
            f"({time[back[0]]:g} to {time[back[0] + 1]:g} s)"
        )
    dt = float(np.median(step[inside]))
    require(
        0.0005 <= dt <= 0.1,
        f"{name}: {1.0 / dt:g} Hz cannot be used; give 10 to 2000 samples a second, "
        "and the time's unit in the header, as 'time [ms]'",
    )
    known = np.isfinite(time) & np.all([np.isfinite(c) for c in columns.values()], axis=0)
    for key, most in TOO_MUCH.items():
        found = np.abs(columns[key][known])
        if len(found) and np.quantile(found, 0.99) > most:
            raise ValueError(
                f"{name}: {key} reaches {found.max():g}, which is no SI unit: name the unit in "
                f"the header, as 'lean_rate [deg/s]' or 'speed [km/h]'"
            )
    cut = breaks.copy()
    cut[1:] |= step > 1.5 * dt + 0.002
    pieces = []
    for rows in np.split(np.arange(len(time)), np.flatnonzero(cut[1:] | ~known[1:]) + 1):
        rows = rows[known[rows]]
        if len(rows) * dt < SHORTEST:
            continue
        t = time[rows]
        even = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt + 1e-6) + 1)
        pieces.append(
            Piece(dt, **{key: np.interp(even, t, c[rows]) for key, c in columns.items()})
        )
    require(bool(pieces), f"{name}: no stretch of {SHORTEST:g} s without a gap or a missing value")
    return Log(name, tuple(pieces))


def resampled(log: Log, slowest: float = 0.0099) -> Log:
    """Return the log with samples at most at about 100 Hz: means of several samples."""
    pieces = []
    for piece in log.pieces:
        each = max(1, round(slowest / piece.dt))
        if each == 1:
            pieces.append(piece)
            continue
        count = len(piece.speed) // each
        # A state at the first sample of a block belongs to the torque over the block.
        values = {
            key: getattr(piece, key)[: count * each].reshape(count, each)
            for key in ("speed", "lean_rate", "steer_angle", "torque")
        }
        shifted = {key: rows[:, 0] for key, rows in values.items()}
        shifted["torque"] = values["torque"].mean(axis=1)
        pieces.append(Piece(piece.dt * each, **shifted))
    return Log(log.name, tuple(pieces))
