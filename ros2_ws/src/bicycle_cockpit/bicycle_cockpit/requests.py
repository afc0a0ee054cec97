"""What a page may ask for: JSON text in, a checked request out.

Every request is an object with `type` and, where an answer is wanted, a whole number `id`.
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
"""Of one message."""
MOST_WAYPOINTS = 200
FARTHEST = 1e4
"""m, of a goal from the origin; the controller's own bound."""
LONGEST_NAME = 200


class RequestError(ValueError):
    """A request that is refused; the text is one line."""


@dataclass(frozen=True)
class Request:
    """What all have in common."""

    id: int
    """For the answer; -1 where none is wanted."""


@dataclass(frozen=True)
class SendGoal(Request):
    """Ride to a point instead of all goals so far."""

    point: Point2D
    """m."""
    heading: float | None
    """rad, yaw in which to arrive; None for any."""


@dataclass(frozen=True)
class AddWaypoints(Request):
    """Ride to these points after all goals so far."""

    points: list[Point2D]
    """m."""


@dataclass(frozen=True)
class ClearGoals(Request):
    """Forget all goals."""


@dataclass(frozen=True)
class Push(Request):
    """Push from the side."""

    lean_rate: float
    """rad/s, positive to the right."""


@dataclass(frozen=True)
class Pause(Request):
    """Stop time, or let it go on."""

    paused: bool


@dataclass(frozen=True)
class Step(Request):
    """One step while paused."""


@dataclass(frozen=True)
class Reset(Request):
    """Begin a new episode."""

    random: bool
    """Draw the start from the scenario instead of the origin."""


@dataclass(frozen=True)
class SwitchController(Request):
    """Have another controller ride."""

    name: str
    """One of those that the page was offered."""


@dataclass(frozen=True)
class Record(Request):
    """Begin or end recording."""

    on: bool


def parse(text: str) -> Request:
    """Return the request that a message holds.

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
    """Return foreign text in one line of bounded length."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _number(data: dict[str, Any], name: str, most: float) -> float:
    value = data.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RequestError(f"{name} is {_shown(value)}, not a number")
    if not abs(value) <= most:  # NaN is not, either
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


def _name(number: int, data: dict[str, Any]) -> Request:
    name = data.get("name")
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME:
        raise RequestError(f"name is {_shown(name)}, not the name of a controller")
    return SwitchController(number, name)


_Maker = Callable[[int, dict[str, Any]], Request]
_PARSERS: dict[str, tuple[tuple[str, ...], _Maker]] = {
    "goal": (("x", "y", "heading"), _goal),
    "waypoints": (("points",), lambda n, d: AddWaypoints(n, _points(d.get("points")))),
    "clear": ((), lambda n, d: ClearGoals(n)),
    "push": (("lean_rate",), lambda n, d: Push(n, _number(d, "lean_rate", LARGEST_PUSH))),
    "pause": (("paused",), lambda n, d: Pause(n, _flag(d, "paused"))),
    "step": ((), lambda n, d: Step(n)),
    "reset": (("random",), lambda n, d: Reset(n, _flag(d, "random"))),
    "controller": (("name",), _name),
    "record": (("on",), lambda n, d: Record(n, _flag(d, "on"))),
}
"""By their type: the fields that each may have, and what makes it."""
