"""Every key of a run's configuration, misspelt, of the wrong kind and beyond reason: one line.

The keys come from the dataclasses, so a new field is covered when it is there.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from typing import Any

import pytest

from bicycle_common.validation import reject_unknown
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.control.safety import SafetyConfig
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.plants.choi.parameters import Constants, Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import Scenario, named

PRESETS = [loading.preset(name) for name in loading.preset_names()]


def leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every field of nested dataclasses, with its value."""
    for item in dataclasses.fields(value):
        inner = getattr(value, item.name)
        inner = inner.physics if isinstance(inner, ChoiPlant) else inner
        if dataclasses.is_dataclass(inner):
            yield from leaves(inner, (*path, item.name))
        else:
            yield (*path, item.name), inner


def found() -> dict[tuple[str, ...], Any]:
    """Every field that any preset has, with a value."""
    return {path: value for preset in PRESETS for path, value in leaves(preset)}


def nested(path: tuple[str, ...], value: Any) -> Any:
    for part in reversed(path):
        value = {part: value}
    return value


def base(path: tuple[str, ...]) -> RunConfig:
    """Return a preset that has the field, or one beside it."""
    beside = len(path) - 1
    return next(
        preset
        for preset in PRESETS
        if any(other[:beside] == path[:beside] for other, _ in leaves(preset))
    )


def refused(path: tuple[str, ...], value: Any) -> str:
    tree = loading._merge(dataclasses.asdict(base(path)), nested(path, value))
    line = ""
    try:
        loading.build(tree)
    except ValueError as error:
        line = str(error)
    assert line, f"{'.'.join(path)} = {value!r} was let in"
    assert "\n" not in line
    return line


def wrong(value: Any) -> Iterator[Any]:
    """Return the types that such a value does not fit."""
    yield {"a": 1}
    if isinstance(value, bool):
        yield from ("maybe", 3, 0.5, [True], None)
    elif isinstance(value, str):
        yield from (3, 0.5, True, ["a"], None)
    elif isinstance(value, (int, float)):
        yield from ("many", True, [1], math.nan, math.inf, -math.inf, ".nan")
    elif isinstance(value, tuple):
        count = max(len(value), 1)  # a field may be empty, so an empty list is no mistake
        yield from (3, "text", ["a", "b"], [math.nan] * count, [[1]] * count)


@pytest.mark.parametrize("path", found(), ids=".".join)
def test_no_wrong_kind_of_value_gets_in(path: tuple[str, ...]) -> None:
    for value in wrong(found()[path]):
        refused(path, value)


@pytest.mark.parametrize("path", found(), ids=".".join)
def test_a_misspelt_key_names_the_field(path: tuple[str, ...]) -> None:
    name = path[-1]
    wanted = re.escape(repr(name))
    line = refused((*path[:-1], name[:-1] + "_" + name[-1]), 1)
    assert re.search(f"did you mean {wanted}", line), line


@pytest.mark.parametrize("kind", [Scenario, Physics, Constants, Disturbance, SafetyConfig])
def test_no_number_that_is_none_gets_into_what_is_simulated(kind: type) -> None:
    sound = named("learned-speed") if kind is Scenario else kind()
    for path, value in leaves(sound):
        if len(path) > 1 or isinstance(value, (bool, str)) or value is None:
            continue
        for bad in (math.nan, math.inf, -math.inf):
            other = (bad,) * len(value) if isinstance(value, tuple) else bad
            with pytest.raises(ValueError, match=r"must|needs|lie"):
                dataclasses.replace(sound, **{path[0]: other})
    with pytest.raises(ValueError, match="did you mean"):
        reject_unknown(kind, {dataclasses.fields(kind)[0].name + "s": 1})


@pytest.mark.parametrize(
    "name", ["", " ", ".", "/", "..", "\0", "a\nb", "x" * 5000, "/dev/null", "/proc/self/mem", "~"]
)
def test_no_name_of_a_policy_is_more_than_one_line(name: str) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        load_controller(name)
    assert "\n" not in str(caught.value)
