"""Style of docstrings: imperative for functions, noun phrases for attributes, no riddles."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PLACES = ("bicycle_*/**/*.py", "ros2_ws/src/**/*.py", "tests/**/*.py", "docker/**/*.py")
SOURCES = sorted(
    path for place in PLACES for path in ROOT.glob(place) if "build" not in path.parts
)

RIDDLE = re.compile(
    r"\W*(What|Whether|That|Where|Who|Whose|Whom|Which|How|Of|Its|Those|From|By|Until)\b"
)
"""Beginnings that leave the subject to the reader: "Whether it runs" for "True if it runs"."""


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and text of each docstring, also of those below attributes."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else ():
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                text = statement.value.value
                if isinstance(text, str):
                    yield statement.lineno, text


def riddles(source: str) -> list[str]:
    """Return the first lines of docstrings without a subject of their own, with their lines."""
    return [
        f"line {line}: {text.strip().splitlines()[0]}"
        for line, text in docstrings(ast.parse(source))
        if RIDDLE.match(text)
    ]


def test_every_docstring_begins_with_its_subject() -> None:
    assert len(SOURCES) > 500
    found = {path: riddles(path.read_text()) for path in SOURCES}
    wrong = [f"{path.relative_to(ROOT)}, {one}" for path, all_ in found.items() for one in all_]
    assert wrong == [], "say it as in CONTRIBUTING.md: 'Return the …', 'True if …'"


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ('"""What it holds."""', 1),
        ('def one() -> bool:\n    """Whether it runs."""', 1),
        ('class One:\n    two = 2\n    """How many."""', 1),
        ('COST = 1\n"""Of a squared rad."""', 1),
        ('def one() -> str:\n    """From logs to a bicycle."""', 1),
        ('ONE = 1\n"""Number of wheels that turn."""', 0),
        ('def one() -> str:\n    """Return what it holds."""\n    return "What"', 0),
    ],
)
def test_it_finds_them(source: str, count: int) -> None:
    assert len(riddles(source)) == count
