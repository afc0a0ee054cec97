"""Courses to ride: by name from the folder `courses`, or from a YAML, CSV or GPX file.

A course file in YAML has either `points`, a list of [x, y] in metres, or `segments`, which begin
at `start: [x, y, yaw in degrees]` (0, 0, 0 without it) and are, one after another:

    - straight: 20                           m
    - arc: {radius: 10, turn: 360}           m and degrees, positive to the left
    - shift: {across: 3.5, along: 20}        m to the left, as smooth as a lane change
    - slalom: {amplitude: 1, period: 20, periods: 4}      m to either side, m, how many

`closed: true` makes a loop of it, `laps` says how often it is ridden, `speed` in m/s how fast, and
`noise` in m smooths points that were measured. A GPX file is a track, a route or waypoints; its
points are laid in metres east and north of the first.
"""

from __future__ import annotations

import csv
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from bicycle_common import yaml_text
from bicycle_common.types import Point2D
from bicycle_common.validation import nearest, one_line
from bicycle_controller.control.path import LONGEST, Path, sampled
from bicycle_controller.control.path_making import Rounding, check, path_through

FOLDER = FilePath(__file__).parent.parent / "courses"
"""Folder of the courses with a name."""
SUFFIXES = (".yaml", ".yml", ".csv", ".gpx")
STEP = 0.02
"""m between the points of a segment."""
GPX_NOISE = 1.0
"""m, standard deviation that a GPX file's points are taken to have."""
EARTH = 6_371_008.8
"""Mean radius of the Earth, m."""
FASTEST = 8.0
"""m/s, highest speed that a course or an order may ask for."""
MOST_LAPS = 10_000
"""Largest number of laps."""
KEYS = ("about", "source", "start", "segments", "points", "closed", "laps", "speed", "noise")


class CourseError(ValueError):
    """Reason why a course cannot be read or ridden; one line with the remedy."""

    def __init__(self, text: str = "") -> None:
        super().__init__(one_line(text))


@dataclass(frozen=True)
class Course:
    """A path with a name, and how it is ridden."""

    name: str
    path: Path
    speed: float
    """m/s where no turn limits it."""
    laps: int = 1
    about: str = ""


def names() -> list[str]:
    """Return the names of all courses in `courses`, sorted."""
    return sorted(file.stem for file in FOLDER.iterdir() if file.suffix in SUFFIXES)


def load(name: str, tightest: float = 0.0, rounding: Rounding | None = None) -> Course:
    """Return a course by its name or its file.

    Args:
        name: one of `names`, or a file.
        tightest: m, radius of the sharpest turn that the bicycle rides; zero does not check.
        rounding: how the corners of points become turns.

    Raises:
        CourseError: on an unknown name, an unreadable file or a path that cannot be ridden.
    """
    file = _file(name)
    rounding = rounding or Rounding()
    if tightest > 0.0:
        rounding = replace(rounding, tightest=tightest, widest=max(tightest, rounding.widest))
    try:
        course = _read(file, rounding)
        if tightest > 0.0:
            check(course.path, tightest)
    except (ValueError, OSError) as error:
        text = error.strerror if isinstance(error, OSError) else str(error)
        raise CourseError(f"course {name}: {text}") from None
    return course


def _file(name: str) -> FilePath:
    if FilePath(name).suffix in SUFFIXES:
        if not FilePath(name).is_file():
            raise CourseError(f"there is no course file {name}")
        return FilePath(name)
    for suffix in SUFFIXES:
        if name in names() and (FOLDER / f"{name}{suffix}").is_file():
            return FOLDER / f"{name}{suffix}"
    hint = nearest(name, names())
    raise CourseError(
        f"unknown course {name!r}{hint}: choose one of {', '.join(names())} or a file "
        f"({', '.join(SUFFIXES)})"
    )


def _read(file: FilePath, rounding: Rounding) -> Course:
    try:
        text = yaml_text.read_text(file)
    except UnicodeDecodeError:
        raise CourseError("it is not text") from None
    except yaml_text.YAMLError as error:
        raise CourseError(" ".join(str(error).split())) from None
    name = file.stem
    if file.suffix == ".gpx":
        points, about = _gpx(text)
        path = path_through(points, rounding=rounding, noise=GPX_NOISE)
        return Course(name, path, 3.0, about=about)
    if file.suffix == ".csv":
        return Course(name, path_through(_csv(text), rounding=rounding), 3.0)
    return _from_yaml(name, text, rounding)


def _from_yaml(name: str, text: str, rounding: Rounding) -> Course:
    try:
        data = yaml_text.load(text)
    except yaml_text.YAMLError as error:
        raise CourseError(f"not YAML: {' '.join(str(error).split())}") from None
    if isinstance(data, list):
        data = {"points": data}
    if not isinstance(data, dict):
        raise CourseError("it must have the key points or segments")
    if "waypoints" in data:
        data = {"points": data.pop("waypoints"), **data}
    for key in data:
        if key not in KEYS:
            raise CourseError(f"unknown key {key!r}{nearest(str(key), KEYS)}")
    if ("points" in data) == ("segments" in data):
        raise CourseError("give either points or segments")
    closed = data.get("closed")
    if closed is not None and not isinstance(closed, bool):
        raise CourseError(f"closed is {closed!r}: write true or false")
    if "points" in data:
        points = [_pair(item) for item in _list(data["points"], "points")]
        noise = _number(data.get("noise", 0.0), "noise", 0.0, 100.0)
        path = path_through(points, closed, rounding, noise)
    else:
        path = _segments(_list(data["segments"], "segments"), data.get("start"), bool(closed))
    laps = data.get("laps", 1)
    if not isinstance(laps, int) or isinstance(laps, bool) or not 1 <= laps <= MOST_LAPS:
        raise CourseError(f"laps is {laps!r}: give a whole number from 1 to {MOST_LAPS}")
    speed = _number(data.get("speed", 3.0), "speed", 0.5, FASTEST)
    return Course(name, path, speed, laps, str(data.get("about", "")))


def _list(value: Any, name: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise CourseError(f"{name} must be a list that is not empty")
    return value


def _pair(item: Any) -> Point2D:
    pair: Any = [item.get("x"), item.get("y")] if isinstance(item, dict) else item
    try:
        x, y = (float(value) for value in pair)
    except (TypeError, ValueError):
        raise CourseError(f"{item!r} is not a point: write [x, y] in metres") from None
    return x, y


def _number(value: Any, name: str, low: float, high: float) -> float:
    good = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not (good and math.isfinite(value) and low <= value <= high):
        raise CourseError(f"{name} is {value!r}: give a number from {low:g} to {high:g}")
    return float(value)


def _csv(text: str) -> list[Point2D]:
    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].startswith("#")]
    if rows and [cell.strip().lower() for cell in rows[0][:2]] == ["x", "y"]:
        rows = rows[1:]
    return [_pair([cell.strip() for cell in row]) for row in rows]


def _gpx(text: str) -> tuple[list[Point2D], str]:
    """Return the points of a GPX 1.0 or 1.1 file, m east and north of the first, and its name."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CourseError("a GPX file defines no entities: remove them")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise CourseError(f"not GPX: {error}") from None
    found: list[tuple[float, float]] = []
    about = ""
    for kind in ("trkpt", "rtept", "wpt"):
        if found:
            break
        for item in root.iter():
            tag = item.tag.rpartition("}")[2]
            if tag == "name" and not about:
                about = (item.text or "").strip()
            if tag == kind:
                try:
                    found.append((float(item.attrib["lat"]), float(item.attrib["lon"])))
                except (KeyError, ValueError):
                    raise CourseError(f"a {kind} has no lat and lon in degrees") from None
    if len(found) < 2:
        raise CourseError("it holds no track, route or waypoints with two points or more")
    degrees = np.array(found)
    if not (np.abs(degrees[:, 0]).max() < 89.0 and np.abs(degrees[:, 1]).max() <= 180.0):
        raise CourseError("lat must be within 89 and lon within 180 degrees")
    latitude, longitude = np.radians(degrees).T
    east = (longitude - longitude[0] + np.pi) % (2.0 * np.pi) - np.pi
    x = EARTH * np.cos(latitude[0]) * east
    y = EARTH * (latitude - latitude[0])
    return [(float(a), float(b)) for a, b in zip(x, y, strict=True)], about


class _Pen:
    """Draws segments; yaw in rad from +x, counter-clockwise."""

    def __init__(self, x: float, y: float, yaw: float) -> None:
        self.x, self.y, self.yaw = [np.array([x])], [np.array([y])], yaw
        self._length = 0.0

    def count(self, length: float, least: int) -> int:
        """Return the number of points of a piece of m, before they need memory.

        Raises:
            CourseError: all pieces together are longer than a path may be.
        """
        self._length += length
        if self._length > LONGEST:
            raise CourseError(f"its segments are longer than {LONGEST:g} m together")
        return max(least, round(length / STEP))

    def go(self, forward: np.ndarray, left: np.ndarray, turn: float = 0.0) -> None:
        """Add points, m from here and in the direction of here, and turn by rad."""
        x, y = float(self.x[-1][-1]), float(self.y[-1][-1])
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        self.x.append(x + c * forward - s * left)
        self.y.append(y + s * forward + c * left)
        self.yaw += turn


def _straight(pen: _Pen, value: Any) -> None:
    length = _number(value, "straight", 0.1, 1e5)
    forward = np.linspace(0.0, length, pen.count(length, 2))[1:]
    pen.go(forward, 0.0 * forward)


def _arc(pen: _Pen, value: Any) -> None:
    radius, degrees = _fields(value, "arc", radius=(0.1, 1e5), turn=(-36000.0, 36000.0))
    turn = math.radians(degrees)
    side = math.copysign(1.0, turn)
    angle = np.linspace(0.0, abs(turn), pen.count(abs(turn) * radius, 3))[1:]
    pen.go(radius * np.sin(angle), side * radius * (1.0 - np.cos(angle)), turn)


def _shift(pen: _Pen, value: Any) -> None:
    across, along = _fields(value, "shift", across=(-1e4, 1e4), along=(0.5, 1e5))
    share = np.linspace(0.0, 1.0, pen.count(along, 20))[1:]
    # The quintic with neither slope nor curvature at its ends.
    pen.go(along * share, across * share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


def _slalom(pen: _Pen, value: Any) -> None:
    amplitude, period, periods = _fields(
        value, "slalom", amplitude=(-1e3, 1e3), period=(1.0, 1e4), periods=(0.5, 1e4)
    )
    forward = np.linspace(0.0, period * periods, pen.count(period * periods, 20))[1:]
    # It grows and dies within half a period, so that it begins and ends straight.
    near = np.minimum(forward, period * periods - forward) / (0.5 * period)
    rise = np.clip(near, 0.0, 1.0)
    rise = rise**3 * (10.0 - 15.0 * rise + 6.0 * rise**2)
    pen.go(forward, amplitude * rise * np.sin(2.0 * np.pi * forward / period))


def _fields(value: Any, name: str, **ranges: tuple[float, float]) -> list[float]:
    if not isinstance(value, dict) or set(value) != set(ranges):
        raise CourseError(f"{name} needs {', '.join(ranges)}")
    return [_number(value[key], f"{name}: {key}", *limits) for key, limits in ranges.items()]


_SEGMENTS: dict[str, Callable[[_Pen, Any], None]] = {
    "straight": _straight,
    "arc": _arc,
    "shift": _shift,
    "slalom": _slalom,
}


def _segments(items: list[Any], start: Any, closed: bool) -> Path:
    if start is None:
        start = [0.0, 0.0, 0.0]
    if not isinstance(start, list) or len(start) != 3:
        raise CourseError("start must be [x, y, yaw in degrees]")
    x, y, degrees = (_number(value, "start", -1e6, 1e6) for value in start)
    pen = _Pen(x, y, math.radians(degrees))
    for item in items:
        if not isinstance(item, dict) or len(item) != 1 or next(iter(item)) not in _SEGMENTS:
            raise CourseError(f"{item!r} is no segment: write {', '.join(_SEGMENTS)}")
        kind, value = next(iter(item.items()))
        _SEGMENTS[kind](pen, value)
    dense = np.concatenate(pen.x), np.concatenate(pen.y)
    gap = math.hypot(dense[0][-1] - dense[0][0], dense[1][-1] - dense[1][0])
    if closed and gap > 0.5:
        raise CourseError(f"it is closed, but ends {gap:.2f} m from its start")
    if closed:
        dense[0][-1], dense[1][-1] = dense[0][0], dense[1][0]
    return sampled(dense[0], dense[1], closed)
