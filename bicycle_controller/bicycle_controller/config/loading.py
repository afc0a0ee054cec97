"""Read a run's configuration from YAML presets and `--set a.b=value`, and write it as YAML.

Unknown keys and values of a wrong type are errors of one line that names the field.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import sys
import types
import typing
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from bicycle_common import yaml_text
from bicycle_common.validation import nearest, reject_unknown
from bicycle_controller.config.run import RunConfig
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import SCENARIOS, Scenario, named

Tree = dict[str, Any]
"""Nested plain data, as read from YAML."""

Override: typing.TypeAlias = str | Tree
"""A change of a configuration: `ddpg.tau=0.01`, or values by field."""

RENAMED = {"taught": "guided", "taught-speed": "guided-speed"}
"""Preset names of release 0.1.0 and their current names."""

Config = typing.TypeVar("Config")


def preset_names() -> list[str]:
    """Return the names that `preset` accepts."""
    folder = resources.files("bicycle_controller") / "presets"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def preset(name: str, overrides: Iterable[Override] = ()) -> RunConfig:
    """Return the preset of that name with `overrides` such as `ddpg.tau=0.01`.

    Raises:
        ValueError: on an unknown preset, key or value; names the nearest.
    """
    return build(_preset_tree(name), overrides)


def load(path: Path, overrides: Iterable[Override] = ()) -> RunConfig:
    """Return the configuration of a YAML file, which may extend a preset.

    Raises:
        ValueError: if it cannot be read, or on an unknown key or value.
    """
    try:
        tree = yaml_text.read(path)
    except (OSError, UnicodeDecodeError, yaml_text.YAMLError) as error:
        raise ValueError(f"cannot read the configuration {path}: {_one_line(error)}") from error
    try:
        return build(_extended(tree), overrides)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def build(tree: Tree, overrides: Iterable[Override] = ()) -> RunConfig:
    """Return the configuration of nested plain data.

    Raises:
        ValueError: on an unknown key or a value of a wrong type.
    """
    for override in overrides:
        tree = _merge(tree, _override(override))
    return typing.cast(RunConfig, _make(RunConfig, tree, ""))


def changed(config: Config, overrides: Iterable[Override]) -> Config:
    """Return a configuration, scenario or physics with the values of `overrides`.

    Raises:
        ValueError: on an unknown key or a value of a wrong type.
    """
    tree = _tree(config)
    for override in overrides:
        tree = _merge(tree, _override(override))
    return typing.cast(Config, _make(type(config), tree, ""))


def dump(config: RunConfig) -> str:
    """Return YAML from which `load` reads an equal configuration."""
    return yaml.safe_dump(_plain(_tree(config)), sort_keys=False, width=99)


def _tree(config: Any) -> Tree:
    """Return the configuration as plain data."""
    tree = dataclasses.asdict(config)
    if isinstance(config, RunConfig):
        for name in ("physics", "physics_too"):
            plant = getattr(config, name)
            tree[name] = None if plant is None else json.loads(plant.to_json())
    return tree


@functools.cache
def _say_renamed(name: str) -> None:
    """Print the current name of a renamed preset, once."""
    print(f"the preset {name!r} is called {RENAMED[name]!r} now", file=sys.stderr)


def _preset_tree(name: str) -> Tree:
    if name in RENAMED:
        _say_renamed(name)
        name = RENAMED[name]
    names = preset_names()
    if name not in names:
        hint = nearest(name, names)
        raise ValueError(f"unknown preset {name!r}{hint}; known: {', '.join(names)}")
    text = (resources.files("bicycle_controller") / "presets" / f"{name}.yaml").read_text()
    return _merge(_extended(yaml_text.load(text)), {"preset": name})


def _extended(tree: Any) -> Tree:
    """Return `tree` merged over the preset that its key `extends` names."""
    if not isinstance(tree, dict):
        raise ValueError(f"a configuration must be a mapping, not {type(tree).__name__}")
    own = {key: value for key, value in tree.items() if key != "extends"}
    return _merge(_preset_tree(str(tree["extends"])), own) if "extends" in tree else own


def _override(change: Override) -> Tree:
    """Parse `ddpg.tau=0.01` to {"ddpg": {"tau": 0.01}}."""
    if not isinstance(change, str):
        return change
    key, equals, value = change.partition("=")
    if not equals or not key.strip():
        raise ValueError(f"cannot read {change!r}: write NAME=VALUE, for instance ddpg.tau=0.01")
    try:
        tree: Any = yaml_text.load(value)
    except yaml_text.YAMLError as error:
        raise ValueError(f"cannot read the value of {change!r}: {_one_line(error)}") from error
    for part in reversed(key.strip().split(".")):
        tree = {part: tree}
    return typing.cast(Tree, tree)


def _merge(base: Tree, top: Tree) -> Tree:
    """Merge `top` over `base`, mapping by mapping; a scenario's name counts as a mapping."""
    merged = dict(base)
    for key, value in top.items():
        old = merged.get(key)
        if isinstance(value, dict) and isinstance(old, str):
            old = {"name": old}
        both = isinstance(value, dict) and isinstance(old, dict)
        merged[key] = _merge(old, value) if both else value  # type: ignore[arg-type]
    return merged


def _make(kind: Any, value: Any, where: str) -> Any:
    """Build the dataclass `kind` from `value`; `where` is its dotted name with a trailing dot."""
    if kind is Scenario or kind in (fields for fields, _ in registry.FIELDS.values()):
        value = _based(kind, value, where)
    reject_unknown(kind, value)
    hints = typing.get_type_hints(kind)
    values = {name: _coerce(hints[name], item, where + name) for name, item in value.items()}
    missing = [
        where + item.name
        for item in dataclasses.fields(kind)
        if item.name not in values
        and item.default is dataclasses.MISSING
        and item.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise ValueError(f"missing {', '.join(missing)}: extend a preset, or give them")
    return kind(**values)


def _based(kind: Any, value: Any, where: str) -> Any:
    """Build a scenario or a plant's fields from a name, or from changes of a named one."""
    if isinstance(value, str):
        value = {"name": value}
    if not isinstance(value, dict):
        raise ValueError(f"{where[:-1]} must be a name or a mapping, not {value!r}")
    name = str(value.get("name", ""))
    if kind is Scenario:
        own = len(value) > 1 and name not in SCENARIOS
        return value if own else _merge(dataclasses.asdict(named(name)), value)
    rest = {key: item for key, item in value.items() if key != "name"}
    return _merge(dataclasses.asdict(kind.named(name or "faithful")), rest)


def _bicycle(value: Any, where: str) -> Plant[Any]:
    """Return a plant: a mode of the paper's, its changed fields, or another with its bicycle."""
    if isinstance(value, Plant):
        return value
    data = dict(value) if isinstance(value, dict) else {"name": value}
    plant = str(data.pop("plant", registry.default().name))
    try:
        if plant in registry.FIELDS:
            fields, kind = registry.FIELDS[plant]
            built: Plant[Any] = kind(
                _make(fields, data if isinstance(value, dict) else value, where)
            )
            return built
        if set(data) <= {"bicycle"} and not isinstance(data.get("bicycle"), dict):
            return registry.named(plant, data.get("bicycle"))
        return registry.from_dict({"plant": plant, **data})
    except TypeError as error:
        raise ValueError(f"{where[:-1]} cannot be read: {_one_line(error)}") from error


def _coerce(hint: Any, value: Any, name: str) -> Any:
    """Convert `value` to the annotated type, if nothing is lost."""
    if typing.get_origin(hint) is Plant:
        return _bicycle(value, f"{name}.")
    if dataclasses.is_dataclass(hint):
        return _make(hint, value, f"{name}.")
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        kinds = [kind for kind in typing.get_args(hint) if kind is not types.NoneType]
        return None if value is None else _coerce(kinds[0], value, name)
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        if not isinstance(value, (list, tuple)):
            raise ValueError(f"{name} must be a list such as [1, 2], not {value!r}")
        if inner[-1] is not Ellipsis and len(value) != len(inner):
            raise ValueError(f"{name} must have {len(inner)} values, not {len(value)}")
        return tuple(_coerce(inner[0], item, name) for item in value)
    return _scalar(hint, value, name)


def _scalar(kind: type, value: Any, name: str) -> Any:
    if kind is float and isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, not {value!r}")
    if isinstance(value, kind) and not (isinstance(value, bool) and kind is not bool):
        return value
    if kind in (int, float) and isinstance(value, (int, float, str)) and not _is_bool(value):
        try:  # YAML reads 1e-4 as text, and users write integers as 2e5
            number = float(value)
        except ValueError:
            number = float("nan")
        if kind is float and math.isfinite(number):
            return number
        if kind is int and number.is_integer():
            return int(number)
    words = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}
    raise ValueError(f"{name} must be {words.get(kind, kind.__name__)}, not {value!r}")


def _is_bool(value: object) -> bool:
    return isinstance(value, bool)


def _plain(value: Any) -> Any:
    """Return tuples as lists, for YAML."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
