"""The riding policy, the chosen one, and the reason if they differ."""

from __future__ import annotations

from still_clock import Clock

from bicycle_cockpit.hand_over_words import explained
from bicycle_cockpit.riders import rider
from bicycle_cockpit.who_rides import SETTLED, HandOver, WhoRides
from bicycle_controller.control.safety import HandOverReason

NAF, LQR = "naf@cee775ab58", "lqr-cfc5cd8e"
TAKEN = HandOver(LQR, "lean rate 0.6 rad/s is beyond 0.5 rad/s", 4.2, stop=False)


def test_a_hand_over_leaves_the_chosen_policy_chosen() -> None:
    clock = Clock()
    who = WhoRides(clock)
    who.commanded(NAF)
    clock.now += SETTLED
    assert who.settled() == NAF
    who.commanded(LQR)  # the command comes before the word about it
    who.handed_over(TAKEN)
    clock.now += SETTLED
    assert (who.driver, who.chosen, who.hand_over) == (LQR, NAF, TAKEN)
    assert who.settled() == "", "the hand-over has told it"
    who.commanded(NAF)
    assert who.hand_over is None, "its commands come again"
    who.handed_back(NAF)
    clock.now += SETTLED
    assert who.settled() == ""
    assert (who.driver, who.chosen) == (NAF, NAF)


def test_another_policy_that_rides_is_told_once_and_is_the_chosen_one() -> None:
    clock = Clock()
    who = WhoRides(clock)
    who.commanded(NAF)
    who.commanded(LQR)
    assert who.settled() == "", "a hand-over may still explain it"
    clock.now += SETTLED
    assert who.settled() == LQR
    assert who.settled() == ""
    assert who.chosen == LQR


def test_a_controller_that_dies_while_the_fallback_rides_leaves_no_hand_over() -> None:
    who = WhoRides(Clock())
    who.commanded(NAF)
    who.handed_over(TAKEN)
    who.commanded(LQR)
    assert who.hand_over is TAKEN
    who.commanded("ppo@1")  # of the next controller
    assert who.hand_over is None


def test_the_controller_says_which_policy_is_in_charge() -> None:
    who = WhoRides(Clock())
    who.put_in_charge(NAF)
    assert (who.driver, who.chosen) == ("", NAF)
    who.commanded(LQR)
    assert who.chosen == NAF


def test_what_follows_a_path_has_a_name() -> None:
    found = [rider(policy, {}) for policy in ("follow-18d16372", "stanley-18d16372", "follow@1a")]
    assert [one.label for one in found] == ["Path follower", "Stanley path follower", "follow"]
    assert all(one.kind for one in found)


def test_reasons_are_told_without_ids() -> None:
    names = {NAF: "naf", LQR: "lqr-displacement"}
    over = f"lean rate 0.6 rad/s is beyond 0.5 rad/s: {LQR} takes over from policy {NAF}"
    detail = "lean rate 34.4°/s is beyond 28.6°/s"
    assert (
        explained(HandOverReason.LEAN_RATE, over, LQR, names) == f"it leaned too fast ({detail})"
    )
    assert explained(99, over, LQR, names) == detail, "a reason of a later version"
    fails = f"policy {NAF} fails with ValueError: {LQR} takes over"
    assert explained(HandOverReason.POLICY, fails, LQR, names) == "NAF actor fails with ValueError"
    assert (
        explained(HandOverReason.NONE, f"calm again: policy {NAF} drives", NAF, names)
        == "calm again"
    )
    unknown = "policy mine@1234 gives an action that is not finite: lqr-00000000 takes over"
    text = explained(HandOverReason.POLICY, unknown, "lqr-00000000", {})
    assert text == "mine gives an action that is not finite"
