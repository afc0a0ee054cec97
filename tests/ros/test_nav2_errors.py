"""Numbers of Nav2's errors, against the definitions of two of its branches."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from bicycle_controller.nodes import nav2_errors
from bicycle_controller.nodes.nav2_errors import INVALID_PATH, LATE, LOST, OTHER

STAND_IN = Path(__file__).parents[1] / "support" / "nav2_stand_in" / "action"


def constants(action: str) -> SimpleNamespace:
    """Return the constants of a stand-in's result."""
    text = (STAND_IN / f"{action}.action").read_text().split("---")[1]
    found = re.findall(r"^uint16 ([A-Z_]+)=(\d+)$", text, re.MULTILINE)
    return SimpleNamespace(**{name: int(value) for name, value in found})


# navigation2, branch jazzy, commit f4108e5.
FOLLOW_PATH = constants("FollowPath")
JAZZY = {
    "NONE": 0,
    "UNKNOWN": 100,
    "INVALID_CONTROLLER": 101,
    "TF_ERROR": 102,
    "INVALID_PATH": 103,
    "PATIENCE_EXCEEDED": 104,
    "FAILED_TO_MAKE_PROGRESS": 105,
    "NO_VALID_CONTROL": 106,
    "CONTROLLER_TIMED_OUT": 107,
}
# navigation2, branch main, commit a3a9704.
MAIN_TO_POSE = SimpleNamespace(NONE=0, UNKNOWN=9000, TF_ERROR=9002, TIMEOUT=9003)
MAIN_THROUGH = SimpleNamespace(NONE=0, UNKNOWN=9100, TF_ERROR=9102, TIMEOUT=9103)


def test_the_stand_in_has_the_numbers_of_jazzy() -> None:
    assert vars(FOLLOW_PATH) == JAZZY
    for action in ("NavigateToPose", "NavigateThroughPoses"):
        assert vars(constants(action)) == {"NONE": 0}


@pytest.mark.parametrize(
    ("result", "numbers"),
    [
        (FOLLOW_PATH, {INVALID_PATH: 103, LOST: 105, OTHER: 100}),
        (constants("NavigateToPose"), {LATE: 105, OTHER: 100}),
        (constants("NavigateThroughPoses"), {LATE: 105, OTHER: 100}),
        (MAIN_TO_POSE, {LATE: 9003, OTHER: 9000}),
        (MAIN_THROUGH, {LATE: 9103, OTHER: 9100}),
    ],
)
def test_each_end_has_its_number(
    result: SimpleNamespace, numbers: dict[tuple[str, ...], int]
) -> None:
    found = {why: nav2_errors.number(why, result, FOLLOW_PATH) for why in numbers}
    assert found == numbers


def test_no_number_is_made_up() -> None:
    with pytest.raises(LookupError, match="nav2_msgs has no constant UNKNOWN"):
        nav2_errors.number(OTHER, SimpleNamespace(NONE=0))
