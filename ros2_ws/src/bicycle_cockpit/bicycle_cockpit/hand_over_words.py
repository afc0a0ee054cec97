"""Why the fallback rides, or no longer does, in words without the ids of policies."""

from __future__ import annotations

from collections.abc import Mapping

from bicycle_cockpit.riders import rider


def explained(message: str, policy: str, names: Mapping[str, str]) -> str:
    """The reason that a hand-over gives.

    Args:
        message: the controller's line, such as "lean rate 0.6 rad/s is beyond 0.5 rad/s: lqr-1234
            takes over from policy naf@5678" or "calm again: policy naf@5678 drives".
        policy: id of what rides from here on.
        names: of policies, by their ids.
    """
    for end in (f": {policy} takes over", f": policy {policy} drives"):
        message = message.partition(end)[0]
    words = []
    for word in message.split():
        bare = word.rstrip(":,.;")
        is_policy = bare in names or "@" in bare or bare.startswith("lqr-")
        words.append(rider(bare, names).name + word[len(bare) :] if is_policy else word)
    return " ".join(words).removeprefix("policy ")
