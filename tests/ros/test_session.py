"""README's commands as a person mixes them, some minutes of it; for an hour: session.py."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from session import Person, give_commands

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture
def person() -> Iterator[Person]:
    """Somebody who gives the commands that a test says, and ends all of it."""
    result = Person()
    result.come(number=1)
    try:
        yield result
        result.what_was_started_runs()
    finally:
        result.teardown()


def test_a_live_session_with_everything_at_once(person: Person) -> None:
    person.stop(name="")
    person.goal(point=(20, 10))
    person.push(side="left", hard=False)
    person.reset(x=1)
    person.sim()
    person.goal(point=(20, 10))
    person.cockpit()
    person.record()
    person.controller(policy="fixed-speed")
    person.trainer()
    person.topics()
    person.what_was_started_runs()
    person.goal(point=(20, 10))
    person.push(side="right", hard=False)
    person.push(side="left", hard=True)
    person.goal(point=(0, 20))
    person.ride(number=1)
    person.reset(x=3)
    person.ctrl_c(which=sorted(person.session.running).index("recorder"), number=signal.SIGTERM)
    person.ctrl_c(which=sorted(person.session.running).index("simulator"), number=signal.SIGINT)
    person.verify(which=0)
    person.report(which=0)
    person.replay(which=0)
    person.stop(name="trainer")


def test_rides_and_their_bags(person: Person) -> None:
    person.ride(number=0)
    person.sim()
    person.ride(number=2)
    person.ctrl_c(which=0, number=signal.SIGTERM)
    person.record()
    person.replay(which=0)
    person.stop(name="recorder")
    person.verify(which=1)
    person.report(which=0)
    person.replay(which=1)
    person.cockpit()


def test_commands_in_an_order_that_is_drawn() -> None:
    done = give_commands(8, 2)
    assert done["stop"] >= 1, "which others come depends on what hypothesis draws"
