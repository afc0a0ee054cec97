"""Reasons why the fallback rides, or no longer does, without ids of policies."""

from __future__ import annotations

from collections.abc import Mapping

from bicycle_cockpit.riders import rider
from bicycle_common.angles import in_degrees
from bicycle_controller.control.safety import HandOverReason

REASONS = {
    HandOverReason.EXTRAPOLATED_LEAN: "it was about to fall",
    HandOverReason.LEAN: "it leaned too far",
    HandOverReason.LEAN_RATE: "it leaned too fast",
    HandOverReason.TOO_SLOW: "it was too slow",
    HandOverReason.TOO_FAST: "it was too fast",
    HandOverReason.STALE: "its command was too old",
}
"""Meaning of the measured limits."""


def explained(reason: int, message: str, policy: str, names: Mapping[str, str]) -> str:
    """Explain a switch, such as "it leaned too fast (lean rate 34.4°/s is beyond ...)".

    Args:
        reason: of the switch, see `HandOverReason`; an unknown one is described by the
            message alone.
        message: the controller's line, such as "lean rate 0.6 rad/s is beyond 0.5 rad/s: lqr-1234
            takes over from policy naf@5678" or "calm again: policy naf@5678 drives".
        policy: id of the policy that rides from here on.
        names: of policies, by their ids.
    """
    for end in (f": {policy} takes over", f": policy {policy} drives"):
        message = message.partition(end)[0]
    words = []
    for word in message.split():
        bare = word.rstrip(":,.;")
        is_policy = bare in names or "@" in bare or bare.startswith("lqr-")
        words.append(rider(bare, names).label + word[len(bare) :] if is_policy else word)
    detail = in_degrees(" ".join(words).removeprefix("policy "))
    meaning = REASONS.get(HandOverReason(reason)) if reason in set(HandOverReason) else None
    return f"{meaning} ({detail})" if meaning else detail
