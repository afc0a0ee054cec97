"""Logs from CSV files, plain or .gz: columns by their names, in any order and in common units."""

from __future__ import annotations

import csv
import gzip
import math
import re
import zlib
from pathlib import Path

import numpy as np

from bicycle_common.validation import nearest, require
from bicycle_controller.identification.logs import Array, Log, log_of

NAMES = {
    "time": ("time", "t", "timestamp", "stamp", "seconds", "time_s"),
    "speed": ("speed", "forward_speed", "velocity", "v"),
    "lean_rate": ("lean_rate", "roll_rate", "lean_angular_rate", "roll_angular_rate"),
    "steer_angle": ("fork_angle", "steer_angle", "steering_angle", "steer"),
    "torque": ("command_fork", "steer_torque", "torque", "steering_torque", "command_torque"),
}
"""Names that each column may have."""
RIDES = "log_kph"
"""Column whose values distinguish several rides in one file."""
NEEDED = ("speed", "lean_rate", "steer_angle", "torque")
UNITS = {
    "deg": math.pi / 180.0, "deg/s": math.pi / 180.0, "degrees": math.pi / 180.0,
    "km/h": 1.0 / 3.6, "kph": 1.0 / 3.6, "kmh": 1.0 / 3.6, "mph": 0.44704,
    "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "mnm": 1e-3, "mn m": 1e-3,
    "rad": 1.0, "rad/s": 1.0, "m/s": 1.0, "s": 1.0, "nm": 1.0, "n m": 1.0, "n*m": 1.0,
}  # fmt: skip
"""Factors to SI units, by the unit in brackets after a column's name."""
_HEADER = re.compile(r"^\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*$")


def read(path: Path, rate: float, steer_left: bool = False) -> list[Log]:
    """Return the log of a CSV file, or several where its column `log_kph` names rides.

    Args:
        path: the file; `.gz` is unpacked.
        rate: Hz, where the file has no column of time.
        steer_left: True if steering and torque are positive to the other side than lean.

    Raises:
        ValueError: if it is no such file; one line that names the file and the column.
    """
    header, rows = _table(path)
    places, factors = _columns(path.name, header)
    data = _numbers(path.name, rows, places)
    columns = {key: data[key] * factors[key] for key in NEEDED}
    if steer_left:
        columns["steer_angle"], columns["torque"] = -columns["steer_angle"], -columns["torque"]
    count = len(rows)
    time = data["time"] * factors["time"] if "time" in data else np.arange(count) / rate
    breaks = np.zeros(count, dtype=bool)
    lowered = [name.strip().lower() for name in header]
    if "row" in lowered and "time" not in data:
        # Cuts of a longer recording.
        number = _numbers(path.name, rows, {"row": lowered.index("row")})["row"]
        breaks[1:] |= np.diff(number) != 1.0
    if RIDES not in lowered:
        return [log_of(path.name, time, columns, breaks)]
    ride = _numbers(path.name, rows, {RIDES: lowered.index(RIDES)})[RIDES]
    breaks[1:] |= np.diff(ride) != 0.0
    found = []
    for value in dict.fromkeys(ride[np.isfinite(ride)].tolist()):
        of = ride == value
        here = {key: column[of] for key, column in columns.items()}
        found.append(log_of(f"{path.name} {value:g} km/h", time[of], here, breaks[of]))
    return found


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    try:
        raw = path.read_bytes()
        text = (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode()
    except (OSError, EOFError, UnicodeDecodeError, zlib.error) as error:
        raise ValueError(f"cannot read {path}: {error}") from error
    first = text.partition("\n")[0]
    delimiter = max(",;\t", key=first.count)
    try:
        lines = [row for row in csv.reader(text.splitlines(), delimiter=delimiter) if row]
    except csv.Error as error:
        raise ValueError(f"{path.name}: no CSV: {error}") from error
    require(len(lines) > 1, f"{path.name}: has no rows; a log is CSV with a header line")
    return lines[0], lines[1:]


def _columns(file: str, header: list[str]) -> tuple[dict[str, int], dict[str, float]]:
    """Return the place of each column, and its factor to SI units."""
    places: dict[str, int] = {}
    factors: dict[str, float] = {}
    split = []
    for name in header:
        match = _HEADER.match(name)
        assert match is not None
        split.append((match[1].strip().lower().lstrip("\ufeff").replace(" ", "_"), match[2]))
    for key, names in NAMES.items():
        here = [index for index, (name, _) in enumerate(split) if name in names]
        best = min(here, key=lambda index: names.index(split[index][0]), default=None)
        if best is None:
            continue
        same = [index for index in here if split[index][0] == split[best][0]]
        require(len(same) == 1, f"{file}: two columns are named {header[best]!r}")
        unit = (split[best][1] or "").lower()
        require(
            not unit or unit in UNITS,
            f"{file}: unknown unit {unit!r} of {header[best]!r}; known: {', '.join(UNITS)}",
        )
        places[key], factors[key] = best, UNITS.get(unit, 1.0)
    for key in NEEDED:
        if key not in places:
            near = next(
                (text for name in NAMES[key] if (text := nearest(name, [n for n, _ in split]))), ""
            )
            raise ValueError(
                f"{file} lacks the {key.replace('_', ' ')}: name a column "
                f"{' or '.join(NAMES[key][:3])}{near} (it has {', '.join(header[:12])})"
            )
    return places, factors


def _numbers(file: str, rows: list[list[str]], places: dict[str, int]) -> dict[str, Array]:
    found = {key: np.full(len(rows), np.nan) for key in places}
    for number, row in enumerate(rows):
        for key, place in places.items():
            text = row[place].strip() if place < len(row) else ""
            if not text or text.lower() in ("nan", "na", "null"):
                continue
            try:
                found[key][number] = float(text)
            except ValueError:
                raise ValueError(
                    f"{file}, line {number + 2}: {text!r} is no number ({key.replace('_', ' ')})"
                ) from None
    for key, values in found.items():
        require(bool(np.isfinite(values).any()), f"{file}: the column of {key} has no number")
    if "time" in found:
        bad = np.flatnonzero(~np.isfinite(found["time"]))
        require(not len(bad), f"{file}, line {bad[0] + 2 if len(bad) else 0}: the time is missing")
    return found
