"""Troubles that keep the bicycle from riding, in words."""

from __future__ import annotations

from bicycle_cockpit.trouble import Line, Trouble

DEATH = Line("bad", "all of it", "controller", "controller was killed by SIGKILL")
AGAIN = Line("info", "controller started again", "controller")


def test_what_died_is_told_until_it_speaks_again() -> None:
    trouble = Trouble(ours=True)
    assert trouble.now(True, 1) == ""
    trouble.told(DEATH)
    trouble.heard("controller")  # the last that it said came late
    said = "controller was killed by SIGKILL: the cockpit starts it"
    assert trouble.now(True, 1) == said, "the graph still counts it"
    trouble.told(AGAIN)
    assert trouble.now(True, 2) == said
    trouble.heard("simulator")
    assert trouble.now(True, 1) == said
    trouble.heard("controller")
    assert trouble.now(True, 1) == ""


def test_what_is_missing_is_told_with_the_remedy() -> None:
    assert Trouble(ours=False).now(False, 0) == "no simulator is heard: start ros2_ws/sim.sh"
    assert Trouble(ours=False).now(True, 0) == "no controller runs: start ros2_ws/controller.sh"
    assert Trouble(ours=True).now(False, 1) == "no simulator is heard: the cockpit starts it"
    trouble = Trouble(ours=True)
    trouble.told(Line("info", "recorded bag-1"))
    assert trouble.now(True, 1) == ""
