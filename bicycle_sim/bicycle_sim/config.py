"""What every configuration shares: an unknown key is an error that names the nearest one."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import Any


def nearest(name: str, known: Iterable[str]) -> str:
    """` (did you mean 'x'?)` for the closest of `known`, or nothing."""
    found = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f" (did you mean {found[0]!r}?)" if found else ""


def empty_word(words: Sequence[str]) -> str:
    """What is wrong with a command line that has an empty word or `--option=`; empty if nothing.

    Most come of a shell's variable that is not set, and would be taken for the present folder.
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
        ValueError: naming the first unknown key and the nearest field.
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
        ValueError: when it does not.
    """
    if not condition:
        raise ValueError(message)


def as_pair(value: Any) -> tuple[float, float]:
    """Two finite numbers from any sequence, as JSON and YAML give lists for tuples.

    Raises:
        ValueError: when it is not two numbers.
    """
    try:
        first, second = value
        return float(first), float(second)
    except (TypeError, ValueError) as error:
        raise ValueError(f"expected two numbers, not {value!r}") from error
