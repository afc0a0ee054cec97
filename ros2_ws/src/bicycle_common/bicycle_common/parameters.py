"""Settings of a node as a frozen dataclass: one field per ROS parameter, described and bounded."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

Value = bool | int | float | str


@dataclass(frozen=True)
class Parameter:
    """One parameter with its description and bounds."""

    name: str
    default: Value
    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False
    """True if it may change while the node runs."""
    fixed: str = "it is read at the start: restart the node with it"
    """Reason why it may not, with the remedy."""

    def check(self, value: Value) -> None:
        """Check a value of the right type.

        Raises:
            ValueError: if it is out of range or none of the choices.
        """
        if self.choices and value not in self.choices:
            raise ValueError(
                f"parameter {self.name} is {value!r}: choose one of {', '.join(self.choices)}"
            )
        if isinstance(value, str) or self.low is None or self.high is None:
            return
        if not (math.isfinite(value) and self.low <= value <= self.high):
            raise ValueError(
                f"parameter {self.name} is {value!r}: choose {self.low:g} to {self.high:g}"
            )


def parameter(
    default: Value,
    description: str,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    live: bool = False,
    fixed: str = Parameter.fixed,
) -> Any:
    """Return a dataclass field that becomes a ROS parameter, see `Parameter`."""
    facts = {"description": description, "low": low, "high": high, "choices": choices}
    facts |= {"live": live, "fixed": fixed}
    return field(default=default, metadata=facts)


def parameters_of(settings: type) -> Iterator[Parameter]:
    """Yield the parameters of a settings class."""
    for item in fields(settings):
        yield Parameter(item.name, item.default, **item.metadata)  # type: ignore[arg-type]


def describe(settings: type) -> str:
    """Return a table of the parameters for `--help`."""
    lines = []
    for item in parameters_of(settings):
        about = item.description
        if item.choices:
            about += f" ({', '.join(item.choices)})"
        elif item.low is not None and item.high is not None:
            about += f" ({item.low:g} to {item.high:g})"
        shown = str(item.default).lower() if isinstance(item.default, bool) else item.default
        lines.append(f"  {item.name}:={shown}\n      {about}")
    return "\n".join(lines)
