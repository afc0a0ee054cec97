"""Launch files: what they start exists, and what they set are parameters.

The launch library is not on PyPI, so they are read, not run.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "ros2_ws/src/bicycle_bringup/launch").glob("*.launch.py"))


def calls(tree: ast.AST, name: str) -> list[dict[str, ast.expr]]:
    """Keyword arguments of every call of `name`."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name:
            found.append({word.arg: word.value for word in node.keywords if word.arg})
    return found


def arguments_of(tree: ast.Module) -> set[str]:
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "ARGUMENTS":
            return set(ast.literal_eval(node.value))
    raise AssertionError("no ARGUMENTS")


def test_there_is_one_for_each_way_to_ride() -> None:
    names = {file.name.partition(".")[0] for file in FILES}
    assert names >= {"ride", "cockpit", "trainer", "fleet", "hardware"}


@pytest.mark.parametrize("file", FILES, ids=[file.name for file in FILES])
def test_what_it_starts_exists(file: Path) -> None:
    tree = ast.parse(file.read_text())
    nodes = calls(tree, "Node")
    assert nodes
    for node in nodes:
        package, program = (ast.literal_eval(node[word]) for word in ("package", "executable"))
        setup = (ROOT / "ros2_ws/src" / package / "setup.py").read_text()
        assert f'"{program} = ' in setup, f"{package} has no program {program}"


@pytest.mark.parametrize("file", FILES, ids=[file.name for file in FILES])
def test_it_uses_the_arguments_that_it_declares(file: Path) -> None:
    text = file.read_text()
    declared = arguments_of(ast.parse(text))
    body = text.partition('"""Default and meaning of each argument."""')[2]
    unused = {name for name in declared if f'"{name}"' not in body}
    assert unused == set()
