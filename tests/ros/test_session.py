"""README's commands as a person mixes them, a minute of it; for an hour: session.py."""

from __future__ import annotations

import pytest
from session import give_commands

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.mark.parametrize(
    ("seed", "commands"),
    [
        (3, {"sim", "controller", "cockpit", "trainer", "record", "push", "goal", "reset"}),
        (2, {"ride", "push", "report"}),
    ],
)
def test_nothing_hangs_and_nothing_is_told_that_is_not_so(seed: int, commands: set[str]) -> None:
    done = give_commands(10 if seed == 3 else 14, seed)
    assert commands <= done.keys()
    assert done["stop"] >= 1
