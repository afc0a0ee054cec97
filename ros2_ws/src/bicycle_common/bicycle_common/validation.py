"""Checks of configurations and command lines; each error is one line that names the field."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import Any


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ` (did you mean 'x'?)` for the closest of `known`, or an empty text."""
    found = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f" (did you mean {found[0]!r}?)" if found else ""


def one_line(text: str) -> str:
    """Return a text in one line: whatever would move or colour a terminal's text is spelt out.

    Names come from bags, files and messages of others, who could forge lines of a log with them.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode()
        for letter in text
    )


def empty_word(words: Sequence[str]) -> str:
    """Return the complaint about an empty word or `--option=` in a command line; empty if none.

    Most come from a shell variable that is not set, and would be taken for the current folder.
    """
    for before, word in zip(["", *words], words, strict=False):
        if word == "":
            place = f"after {before}" if before else "of the command line"
            return f"the word {place} is empty: give a value, or leave the option out"
        if re.fullmatch(r"--[\w-]+=", word):
            return f"{word} has no value: give one, or leave the option out"
    return ""


def reject_unknown(config: type, data: object) -> None:
    """Check that `data` is a mapping whose keys are all fields of the dataclass `config`.

    Raises:
        ValueError: names the first unknown key and the nearest field.
    """
    if not isinstance(data, dict):
        raise ValueError(f"{config.__name__} must be a mapping, not {type(data).__name__}")
    known = [item.name for item in fields(config)]
    for key in data:
        if key not in known:
            raise ValueError(f"{config.__name__} has no field {key!r}{nearest(str(key), known)}")


def require(condition: bool, message: str) -> None:
    """Raise ValueError with `message` unless `condition` holds.

    Raises:
        ValueError: if it does not.
    """
    if not condition:
        raise ValueError(message)


def as_pair(value: Any) -> tuple[float, float]:
    """Return two finite numbers from any sequence, as JSON and YAML give lists for tuples.

    Raises:
        ValueError: if it is not two finite numbers.
    """
    try:
        first, second = value
        return float(first), float(second)
    except (TypeError, ValueError) as error:
        raise ValueError(f"expected two numbers, not {value!r}") from error


def require_between(name: str, value: float, low: float, high: float) -> None:
    """Check that `low` <= `value` <= `high`.

    Raises:
        ValueError: if it is not.
    """
    require(low <= value <= high, f"{name} must lie within {low} and {high}, not {value!r}")


def require_positive(name: str, value: float) -> None:
    """Check that `value` is finite and above zero.

    Raises:
        ValueError: if it is not.
    """
    require(math.isfinite(value) and value > 0, f"{name} must be above zero, not {value!r}")


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Check that `value` is one of `choices`.

    Raises:
        ValueError: if it is not.
    """
    require(value in choices, f"{name} must be one of {', '.join(choices)}, not {value!r}")


def require_layers(name: str, sizes: tuple[int, ...]) -> None:
    """Check that there is a hidden layer and that each has units.

    Raises:
        ValueError: if there is none, or one has no units.
    """
    require(len(sizes) > 0 and min(sizes) > 0, f"{name} needs sizes above zero, not {sizes}")


def require_scale(name: str, scale: tuple[float, ...]) -> None:
    """Check that there is one divisor above zero per observation.

    Raises:
        ValueError: if there are not six.
    """
    require(len(scale) == 6 and min(scale) > 0, f"{name} needs six values above zero, not {scale}")
