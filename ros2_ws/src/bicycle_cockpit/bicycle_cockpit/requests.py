"""Requests of a page: JSON text in, a checked request out.

Every request is an object with `type` and, if an answer is wanted, an integer `id`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bicycle_common.types import Point2D
from bicycle_sim.runtime.push import LARGEST_PUSH

MOST_BYTES = 16 * 1024
"""Largest size of one message."""
MOST_WAYPOINTS = 200
FARTHEST = 1e4
"""Largest distance of a goal from the origin (m); the controller's bound."""
LONGEST_NAME = 200
SETUP_WORDS = ("scenario", "plant", "bicycle", "sensors")
SETUP_NUMBERS = ("speed", "noise", "rate")
"""Fields of `RideSetup` by their kind."""


class RequestError(ValueError):
    """A refused request; the text is one line."""


@dataclass(frozen=True)
class Request:
    """Common part of all requests."""

    id: int
    """Id for the answer; -1 if none is wanted."""


@dataclass(frozen=True)
class SendGoal(Request):
    """Ride to a point instead of all previous goals."""

    point: Point2D
    """m."""
    heading: float | None
    """Yaw on arrival, rad; None for any."""


@dataclass(frozen=True)
class AddWaypoints(Request):
    """Ride to these points after all previous goals."""

    points: list[Point2D]
    """m."""


@dataclass(frozen=True)
class ClearGoals(Request):
    """Remove all goals."""


@dataclass(frozen=True)
class Push(Request):
    """Push from the side."""

    lean_rate: float
    """rad/s, positive to the right."""


@dataclass(frozen=True)
class Pause(Request):
    """Pause or resume the simulation."""

    paused: bool


@dataclass(frozen=True)
class Step(Request):
    """Make one step while paused."""


@dataclass(frozen=True)
class Reset(Request):
    """Begin a new episode."""

    random: bool
    """Draw the start from the scenario instead of the origin."""


@dataclass(frozen=True)
class SwitchController(Request):
    """Switch to another controller."""

    name: str
    """Policy's name, one of those offered to the page."""


@dataclass(frozen=True)
class Record(Request):
    """Start or stop a recording."""

    on: bool


@dataclass(frozen=True)
class SetUp(Request):
    """Begin the ride anew under other conditions."""

    values: dict[str, str | float]
    """Fields of `RideSetup`."""
    controller: str
    """Policy's name, one of those offered to the page; empty for the one in charge."""


@dataclass(frozen=True)
class FollowCourse(Request):
    """Ride along a course."""

    name: str
    """Name of a choice that was offered to the page."""


@dataclass(frozen=True)
class ShowBicycle(Request):
    """Show and steer another bicycle of the domain."""

    name: str
    """Namespace of one that was told to the page."""


def parse(text: str) -> Request:
    """Parse a message into a request.

    Raises:
        RequestError: on anything but a request with fields of the right type and range.
    """
    if len(text) > MOST_BYTES:
        raise RequestError(f"a message of {len(text)} bytes is longer than {MOST_BYTES}")
    try:
        data = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError):
        raise RequestError("a message that is not JSON") from None
    if not isinstance(data, dict):
        raise RequestError("a message that is not an object")
    kind = data.pop("type", None)
    number = data.pop("id", -1)
    if not isinstance(number, int) or isinstance(number, bool) or abs(number) > 2**53:
        raise RequestError("an id that is not a whole number")
    if not isinstance(kind, str) or kind not in _PARSERS:
        raise RequestError(f"an unknown request {_shown(kind)}")
    allowed, make = _PARSERS[kind]
    unknown = sorted(set(data) - set(allowed))
    if unknown:
        raise RequestError(f"{kind} with an unknown field {_shown(unknown[0])}")
    return make(number, data)


def _no_constant(name: str) -> float:
    raise ValueError(name)


def _shown(value: object) -> str:
    """Return untrusted text in one line of bounded length."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _number(data: dict[str, Any], name: str, most: float) -> float:
    value = data.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RequestError(f"{name} is {_shown(value)}, not a number")
    if not abs(value) <= most:  # also False for NaN
        raise RequestError(f"{name} is {_shown(value)}, not within {most:g} of zero")
    return float(value)


def _flag(data: dict[str, Any], name: str) -> bool:
    value = data.get(name)
    if not isinstance(value, bool):
        raise RequestError(f"{name} is {_shown(value)}, not true or false")
    return value


def _points(value: object) -> list[Point2D]:
    if not isinstance(value, list) or not 0 < len(value) <= MOST_WAYPOINTS:
        raise RequestError(f"points must be a list of 1 to {MOST_WAYPOINTS}")
    found = []
    for pair in value:
        if not isinstance(pair, list) or len(pair) != 2:
            raise RequestError(f"a point is {_shown(pair)}, not [x, y]")
        both = dict(zip("xy", pair, strict=True))
        found.append((_number(both, "x", FARTHEST), _number(both, "y", FARTHEST)))
    return found


def _goal(number: int, data: dict[str, Any]) -> Request:
    point = _number(data, "x", FARTHEST), _number(data, "y", FARTHEST)
    heading = None
    if data.get("heading") is not None:
        heading = _number(data, "heading", 2.0 * math.pi)
    return SendGoal(number, point, heading)


def _word(data: dict[str, Any], name: str, what: str, least: int = 1) -> str:
    value = data.get(name, "" if least == 0 else None)
    if not isinstance(value, str) or not least <= len(value) <= LONGEST_NAME:
        raise RequestError(f"{name} is {_shown(value)}, not {what}")
    return value


def _set_up(number: int, data: dict[str, Any]) -> Request:
    values: dict[str, str | float] = {
        name: _word(data, name, "a name", 0) for name in SETUP_WORDS if name in data
    }
    values.update((n, _number(data, n, FARTHEST)) for n in SETUP_NUMBERS if n in data)
    return SetUp(number, values, _word(data, "controller", "the name of a controller", 0))


_Maker = Callable[[int, dict[str, Any]], Request]
_PARSERS: dict[str, tuple[tuple[str, ...], _Maker]] = {
    "goal": (("x", "y", "heading"), _goal),
    "waypoints": (("points",), lambda n, d: AddWaypoints(n, _points(d.get("points")))),
    "clear": ((), lambda n, d: ClearGoals(n)),
    "push": (("lean_rate",), lambda n, d: Push(n, _number(d, "lean_rate", LARGEST_PUSH))),
    "pause": (("paused",), lambda n, d: Pause(n, _flag(d, "paused"))),
    "step": ((), lambda n, d: Step(n)),
    "reset": (("random",), lambda n, d: Reset(n, _flag(d, "random"))),
    "controller": (
        ("name",),
        lambda n, d: SwitchController(n, _word(d, "name", "the name of a controller")),
    ),
    "setup": ((*SETUP_WORDS, *SETUP_NUMBERS, "controller"), _set_up),
    "course": (("name",), lambda n, d: FollowCourse(n, _word(d, "name", "the name of a course"))),
    "bicycle": (("name",), lambda n, d: ShowBicycle(n, _word(d, "name", "a bicycle's name"))),
    "record": (("on",), lambda n, d: Record(n, _flag(d, "on"))),
}
"""Parsers by request type: the allowed fields, and the function."""
