"""YAML of foreign origin: what it may cost is bounded, and each refusal is one line."""

from __future__ import annotations

import ast
from datetime import date
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from bicycle_common import yaml_text

ROOT = Path(__file__).parents[2]


def unfolding(levels: int, width: int, merged: bool = False) -> str:
    """Aliases of aliases: `width ** levels` values in a few hundred bytes."""
    lines = ["a0: &a0 {x: 1}"]
    for level in range(1, levels):
        inside = ", ".join([f"*a{level - 1}"] * width)
        body = f"{{<<: [{inside}]}}" if merged else f"[{inside}]"
        lines.append(f"a{level}: &a{level} {body}")
    return "\n".join(lines)


BOMBS = {
    "aliases": (unfolding(30, 9), "aliases counted in full"),
    "merged aliases": (unfolding(30, 9, merged=True), "aliases counted in full"),
    "many aliases of one list": (
        f"a: &a [{'x, ' * 1000}]\nb: [{'*a, ' * 1000}]",
        "aliases counted in full",
    ),
    "an alias within itself": ("&a [1, *a]", "lies within itself"),
    "lists in lists": ("[" * 10**6, "nested deeper"),
    "mappings in mappings": ("{a: " * 10**6, "nested deeper"),
    "dashes": ("- " * 10**6, "nested deeper"),
    "questions": ("? " * 10**6, "nested deeper"),
    "indented keys": ("\n".join(" " * depth + "a:" for depth in range(100)), "nested deeper"),
    "many values": ("- a\n" * 10**6, "more than 300000 values"),
    "many keys": ("".join(f"a{i}: 1\n" for i in range(200_000)), "more than 300000 values"),
    "a whole number of a million digits": ("a: " + "9" * 10**6, "100 characters"),
    "a number to the base of 60": ("a: " + ":".join(["1"] * 10**6), "100 characters"),
    "a fraction to the base of 60": ("a: " + ":".join(["1"] * 10**6) + ".5", "100 characters"),
    "tag directives": (
        "".join(f"%TAG !a{i}! tag:x\n" for i in range(200_000)) + "---\na",
        "%TAG directives",
    ),
    "a text of 9 MB": ("x" * 9_000_000, "longer than"),
    "python objects": ("!!python/object/apply:os.getpid []", "could not determine a constructor"),
    "an impossible date": ("2020-99-99", "not of its tag"),
    "no date": ("!!timestamp x", "not of its tag"),
    "no number": ("!!int ''", "not of its tag"),
    "no truth value": ("!!bool perhaps", "not of its tag"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_yaml_bomb_is_refused_in_one_line(name: str) -> None:
    text, said = BOMBS[name]
    with pytest.raises(yaml_text.YAMLError) as raised:
        yaml_text.load(text)
    assert said in " ".join(str(raised.value).split())


def test_what_people_write_is_read() -> None:
    text = "a: &a {x: 1, y: [1.5, -2.0e+3, 0x1f, 1:30, 2024-01-02]}\nb: {<<: *a, z: null}\nc: *a\n"
    a = {"x": 1, "y": [1.5, -2000.0, 31, 90, date(2024, 1, 2)]}
    assert yaml_text.load(text) == {"a": a, "b": {**a, "z": None}, "c": a}


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inside: st.lists(inside) | st.dictionaries(st.text(), inside),
    max_leaves=20,
)


@settings(deadline=None)
@given(PLAIN)
def test_what_is_dumped_is_loaded_again(content: object) -> None:
    assert yaml_text.load(yaml_text.dump(content)) == content


@settings(deadline=None, max_examples=300)
@given(st.text(alphabet="&*a0:-[]{}<>,!%'\"|?# \n1", max_size=60))
def test_any_text_is_data_or_one_error_and_the_same_data_as_the_plain_loader(text: str) -> None:
    try:
        found = yaml_text.load(text)
    except yaml_text.YAMLError:
        return
    plain = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    assert found == yaml.load(text, Loader=plain)


def test_a_file_is_not_read_beyond_the_bound(tmp_path: Path) -> None:
    path = tmp_path / "big.yaml"
    with path.open("wb") as file:
        file.truncate(2**40)  # a hole on the disk: to read it all would need 1 TiB of memory
    with pytest.raises(yaml_text.YAMLError, match="longer than"):
        yaml_text.read(path)


def test_nothing_else_loads_yaml() -> None:
    """Else a bomb would find another door."""
    folders = (ROOT / "bicycle_sim", ROOT / "bicycle_controller", ROOT / "ros2_ws" / "src")
    offenders = [
        f"{path.relative_to(ROOT)}: yaml.{node.attr}"
        for folder in folders
        for path in sorted(folder.rglob("*.py"))
        if path.name != "yaml_text.py" and "build" not in path.parts
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "yaml"
        and "load" in node.attr
    ]
    assert offenders == []
