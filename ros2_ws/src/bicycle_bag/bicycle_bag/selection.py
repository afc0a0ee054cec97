"""Selection of the topics to record or to play."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field

from bicycle_bag.errors import OptionError
from bicycle_common import topic_names

STATE, ECHO = topic_names.in_bag(topic_names.STATE), topic_names.in_bag(topic_names.COMMAND_ECHO)


def absolute(name: str) -> str:
    """Return a topic's full name; `bicycle/state` means `/bicycle/state`."""
    return name if name.startswith("/") else f"/{name}"


def echo_of(name: str) -> str:
    """Return the topic of the command echoes that belong to a topic of states; "" for others."""
    if not name.endswith(STATE):
        return ""
    return name.removesuffix(STATE) + ECHO


def with_echoes(names: Collection[str], there: Collection[str]) -> list[str]:
    """Return the names with the echoes of their states, which say who drove, where there are any.

    Args:
        names: of chosen topics.
        there: all topics.
    """
    echoes = [echo_of(name) for name in names]
    return list(dict.fromkeys([*names, *(echo for echo in echoes if echo in there)]))


def is_hidden(name: str) -> bool:
    """Return True if ROS tools hide the topic: a part of its name begins with an underscore."""
    return any(part.startswith("_") for part in name.split("/"))


@dataclass(frozen=True)
class TopicFilter:
    """The choice of `ros2 bag record`: listed names or those that match, less the excluded.

    Without names and without a pattern all topics are chosen, but for hidden ones. A listed name
    is chosen even if hidden or excluded by the pattern.

    Args:
        topics: Names to choose.
        regex: Choose names in which this is found.
        exclude_regex: Leave out names in which this is found.
        exclude_topics: Names to leave out.
        hidden: Choose hidden topics like others.
        types: Choose topics of these types.
        exclude_types: Leave out topics of these types.

    Raises:
        OptionError: A pattern is not a regular expression.
    """

    topics: Collection[str] = ()
    regex: str = ""
    exclude_regex: str = ""
    exclude_topics: Collection[str] = ()
    hidden: bool = False
    types: Collection[str] = ()
    exclude_types: Collection[str] = ()
    _listed: frozenset[str] = field(init=False, repr=False)
    _excluded: frozenset[str] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for pattern in (self.regex, self.exclude_regex):
            try:
                re.compile(pattern)
            except re.error as error:
                raise OptionError(f"{pattern!r} is not a regular expression: {error}") from None
        object.__setattr__(self, "_listed", frozenset(map(absolute, self.topics)))
        object.__setattr__(self, "_excluded", frozenset(map(absolute, self.exclude_topics)))

    def accepts(self, name: str, type_name: str = "") -> bool:
        """Return True if a topic of this full name and type is chosen."""
        if name in self._excluded or type_name in self.exclude_types:
            return False
        if name in self._listed:
            return True
        if self.exclude_regex and re.search(self.exclude_regex, name):
            return False
        if is_hidden(name) and not self.hidden:
            return False
        if type_name in self.types:
            return True
        if self.regex:
            return re.search(self.regex, name) is not None
        return not (self._listed or self.types)
