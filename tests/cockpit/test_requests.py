"""Requests that a page may make, and refusals."""

from __future__ import annotations

import json
import math

import pytest

from bicycle_cockpit.requests import (
    MOST_BYTES,
    AddWaypoints,
    ClearGoals,
    FollowCourse,
    Pause,
    Push,
    Record,
    Request,
    RequestError,
    Reset,
    SendGoal,
    SetUp,
    ShowBicycle,
    Step,
    SwitchController,
    parse,
)


@pytest.mark.parametrize(
    ("sent", "meant"),
    [
        ({"type": "goal", "id": 3, "x": 1, "y": -2.5}, SendGoal(3, (1.0, -2.5), None)),
        ({"type": "goal", "x": 0, "y": 0, "heading": 1.5}, SendGoal(-1, (0.0, 0.0), 1.5)),
        ({"type": "goal", "x": 0, "y": 0, "heading": None}, SendGoal(-1, (0.0, 0.0), None)),
        ({"type": "waypoints", "points": [[1, 2], [3, 4]]}, AddWaypoints(-1, [(1, 2), (3, 4)])),
        ({"type": "clear", "id": 9}, ClearGoals(9)),
        ({"type": "push", "lean_rate": -0.3}, Push(-1, -0.3)),
        ({"type": "pause", "paused": True}, Pause(-1, True)),
        ({"type": "step"}, Step(-1)),
        ({"type": "reset", "random": False}, Reset(-1, False)),
        ({"type": "controller", "name": "lqr"}, SwitchController(-1, "lqr")),
        ({"type": "record", "on": True}, Record(-1, True)),
        ({"type": "course", "name": "slalom"}, FollowCourse(-1, "slalom")),
        ({"type": "bicycle", "name": "/b2"}, ShowBicycle(-1, "/b2")),
        (
            {"type": "setup", "plant": "whipple", "speed": 3, "controller": "lqr"},
            SetUp(-1, {"plant": "whipple", "speed": 3.0}, "lqr"),
        ),
    ],
)
def test_requests(sent: dict[str, object], meant: Request) -> None:
    assert parse(json.dumps(sent)) == meant


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "not JSON"),
        ("{", "not JSON"),
        ("[" * 5000, "not JSON"),
        ("[1]", "not an object"),
        ('{"type":"goal","x":NaN,"y":0}', "not JSON"),
        ('{"type":"goal","x":1e999,"y":0}', "x is inf"),
        ('{"type":"goal","x":1e5,"y":0}', "not within 10000 of zero"),
        ('{"type":"goal","x":true,"y":0}', "x is True, not a number"),
        ('{"type":"goal","x":"1","y":0}', "not a number"),
        ('{"type":"goal","y":0}', "x is None"),
        ('{"type":"goal","x":0,"y":0,"heading":99}', "heading is 99"),
        ('{"type":"goal","x":0,"y":0,"z":1}', "unknown field 'z'"),
        ('{"type":"fly"}', "unknown request 'fly'"),
        ('{"x":1}', "unknown request None"),
        ('{"type":["goal"]}', "unknown request"),
        ('{"type":"step","id":"a"}', "an id that is not a whole number"),
        ('{"type":"step","id":1.5}', "an id that is not a whole number"),
        ('{"type":"waypoints","points":[]}', "1 to 200"),
        ('{"type":"waypoints","points":[[1]]}', "not [x, y]"),
        ('{"type":"waypoints","points":[[1,null]]}', "y is None"),
        ('{"type":"push","lean_rate":3}', "not within 2 of zero"),
        ('{"type":"pause","paused":1}', "not true or false"),
        ('{"type":"controller","name":""}', "not the name of a controller"),
        ('{"type":"controller","name":7}', "not the name of a controller"),
        ('{"type":"setup","bicycle":["x"]}', "not a name"),
        ('{"type":"setup","speed":"fast"}', "not a number"),
        ('{"type":"setup","policy":"x"}', "unknown field 'policy'"),
        ('{"type":"course"}', "not the name of a course"),
        (json.dumps({"type": "controller", "name": "x" * MOST_BYTES}), "longer than 16384"),
    ],
)
def test_refusals_are_one_short_line(text: str, why: str) -> None:
    with pytest.raises(RequestError) as caught:
        parse(text)
    line = str(caught.value)
    assert why in line
    assert "\n" not in line
    assert len(line) < 200


def test_a_number_too_large_for_a_double_is_refused() -> None:
    with pytest.raises(RequestError):
        parse('{"type":"goal","x":' + "9" * 400 + ',"y":0}')
    assert math.isfinite(parse('{"type":"goal","x":12,"y":0}').point[0])  # type: ignore[attr-defined]
