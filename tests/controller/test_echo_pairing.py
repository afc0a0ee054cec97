"""A state is answered once the command that led to it is known, and never waits for nothing."""

from __future__ import annotations

from bicycle_controller.control.echo_pairing import EchoPairing


def test_a_state_after_its_echo_waits_for_nothing() -> None:
    pairing: EchoPairing[str, str] = EchoPairing()
    assert pairing.add((1, 4), "echo") is None
    assert pairing.of((1, 4)) == "echo"
    assert not pairing.holds((1, 4), "state", echoed=True)


def test_a_state_that_overtakes_its_echo_waits_for_it() -> None:
    pairing: EchoPairing[str, str] = EchoPairing()
    pairing.add((1, 3), "old")
    assert pairing.holds((1, 4), "state", echoed=True)
    assert pairing.of((1, 4)) is None
    assert pairing.add((1, 4), "echo") == "state"
    assert pairing.of((1, 4)) == "echo"
    assert pairing.add((1, 5), "next") is None


def test_without_a_publisher_of_echoes_no_state_waits() -> None:
    pairing: EchoPairing[str, str] = EchoPairing()
    assert not pairing.holds((1, 4), "state", echoed=False)


def test_a_state_waits_no_longer_than_until_the_next_one() -> None:
    """Echoes that never come hold one state only, until there is one again."""
    pairing: EchoPairing[str, str] = EchoPairing()
    assert pairing.holds((1, 0), "first", echoed=True)
    assert not pairing.holds((1, 1), "second", echoed=True)
    assert not pairing.holds((1, 2), "third", echoed=True)
    assert pairing.add((1, 3), "echo") is None
    assert pairing.holds((1, 4), "fourth", echoed=True)


def test_an_echo_of_a_later_state_is_enough() -> None:
    """A restarted simulator counts anew: its states are not behind the last echo."""
    pairing: EchoPairing[str, str] = EchoPairing()
    pairing.add((5, 100), "of the former one")
    assert not pairing.holds((1, 0), "state", echoed=True)
    assert pairing.of((1, 0)) is None
