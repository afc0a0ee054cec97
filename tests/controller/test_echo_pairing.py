"""A state is answered once the command that led to it is known, and never waits for nothing."""

from __future__ import annotations

from bicycle_controller.nodes.echo_pairing import MOST, EchoPairing


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


def test_a_state_does_not_wait_for_a_better_echo_than_an_unreadable_one() -> None:
    pairing: EchoPairing[str, str | None] = EchoPairing()
    assert pairing.holds((1, 4), "state", echoed=True)
    assert pairing.add((1, 4), None) == "state"
    assert pairing.of((1, 4)) is None
    assert pairing.knows((1, 4))
    assert not pairing.holds((1, 4), "again", echoed=True)
    assert not pairing.knows((1, 5))


def test_without_a_publisher_of_echoes_no_state_waits() -> None:
    pairing: EchoPairing[str, str] = EchoPairing()
    assert not pairing.holds((1, 4), "state", echoed=False)


def test_echoes_that_never_come_hold_some_states_only() -> None:
    pairing: EchoPairing[str, str] = EchoPairing()
    for step in range(MOST):
        assert pairing.holds((1, step), "held", echoed=True)
    for step in range(MOST, 9):
        assert not pairing.holds((1, step), "answered", echoed=True)
    assert pairing.add((1, 9), "echo") is None
    assert pairing.holds((1, 10), "held again", echoed=True)


def test_a_state_whose_echo_was_passed_over_gives_way_to_the_next_one() -> None:
    """It would be answered without knowing who drives."""
    pairing: EchoPairing[str, str] = EchoPairing()
    assert pairing.holds((1, 4), "state", echoed=True)
    assert pairing.add((1, 5), "later") is None
    assert not pairing.holds((1, 5), "next", echoed=True)
    assert pairing.of((1, 5)) == "later"


def test_a_state_after_the_echo_of_the_next_one_has_its_own() -> None:
    pairing: EchoPairing[str, str] = EchoPairing()
    pairing.add((1, 4), "echo")
    pairing.add((1, 5), "next echo")
    assert not pairing.holds((1, 4), "state", echoed=True)
    assert pairing.of((1, 4)) == "echo"


def test_a_state_without_echo_just_before_one_that_has_it_is_not_answered() -> None:
    pairing: EchoPairing[str, str] = EchoPairing()
    pairing.add((1, 5), "next echo")
    assert pairing.holds((1, 4), "state", echoed=True)
    assert pairing.add((1, 6), "echo") is None, "nor later"


def test_an_echo_of_a_later_state_is_enough() -> None:
    """A restarted simulator counts anew: its states are not behind the last echo."""
    pairing: EchoPairing[str, str] = EchoPairing()
    pairing.add((5, 100), "of the former one")
    assert not pairing.holds((1, 0), "state", echoed=True)
    assert pairing.of((1, 0)) is None
