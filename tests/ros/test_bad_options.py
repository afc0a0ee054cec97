"""Every option of every command line at wrong values: one line, status 1 or 2, no traceback.

The cases come from the programs' own parsers, so that a new option is covered when it is there.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from programs import PROGRAMS, Accepted, Program, stop_before_work

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("signals_as_they_were")]

MAY_BE_NEGATIVE = {"x", "y", "yaw", "--yaw"}
HUGE = ("1" + 30 * "0", "1e300")
ODD = ("/dev/null/none", "/proc/none", "x" * 5000, "\udcff")
Refused = Callable[[list[str]], str]


@pytest.fixture(params=PROGRAMS, ids=lambda program: " ".join([program.name, *program.verb]))
def program(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Program:
    monkeypatch.chdir(tmp_path)
    stop_before_work(request.param, monkeypatch)
    found: Program = request.param
    return found


@pytest.fixture
def said(program: Program, capfd: pytest.CaptureFixture[str]) -> Callable[[list[str]], str | None]:
    """Return the one line with which the program refuses words; None when it takes them."""

    def call(words: list[str]) -> str | None:
        capfd.readouterr()
        try:
            status = program.call(words)
        except Accepted:
            return None
        except SystemExit as leaving:
            status = leaving.code
        except BaseException as error:
            raise AssertionError(f"{shown(words)}: {error!r}") from error
        printed = capfd.readouterr()
        if status == 0:
            return None
        lines = printed.err.splitlines()
        assert status in (1, 2), f"{shown(words)}: status {status}"
        assert printed.out == "", f"{shown(words)}: {printed.out}"
        assert len(lines) == 1, f"{shown(words)}: {printed.err}"
        assert lines[0].startswith(program.name.split()[0]), f"{shown(words)}: {lines[0]}"
        return lines[0]

    return call


def shown(words: list[str]) -> str:
    return " ".join(word if len(word) < 100 else f"{word[:20]}..." for word in words)


def name_of(action: argparse.Action) -> str:
    return max(action.option_strings, key=len) if action.option_strings else action.dest


def is_number(action: argparse.Action) -> bool:
    return action.type in (int, float) or action.metavar == "N"


def wrong(action: argparse.Action) -> Iterator[str]:
    """Yield values that an argument never can have."""
    if action.nargs == 0:
        yield "1"
        return
    yield ""
    if action.choices is not None:
        yield from ("nonsense", "3")
    if is_number(action):
        yield from ("many", "nan", "inf", "1,5", "9" * 5000)
    if is_number(action) and name_of(action) not in MAY_BE_NEGATIVE:
        yield "-1"
    if action.type is int or action.metavar == "N":
        yield "1.5"


def odd(action: argparse.Action) -> Iterator[str]:
    """Yield values that it may have, but that nobody thinks of."""
    if action.choices is None and action.nargs != 0:
        yield from HUGE if is_number(action) else ODD


def options(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Return a parser's options, except those that only print help."""
    ends = argparse._HelpAction | argparse._VersionAction
    return [item for item in parser._actions if not isinstance(item, ends)]


def with_value(program: Program, folder: Path, action: argparse.Action, value: str) -> list[str]:
    """Return the right command line, but for this value."""
    if not action.option_strings:
        _, *others = program.positionals(folder) or [value]
        return [*program.verb, *program.options(folder), "--", value, *others]
    return [*program.words(folder), f"{name_of(action)}={value}"]


def test_the_line_that_the_cases_change_is_right(
    program: Program, said: Refused, tmp_path: Path
) -> None:
    assert said(program.words(tmp_path)) is None


def test_no_wrong_value_gets_in(
    program: Program, said: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problems = []
    for action in options(program.parser(monkeypatch)):
        cases = [(value, True) for value in wrong(action)]
        cases += [(value, False) for value in odd(action)]
        for value, is_wrong in cases:
            words = with_value(program, tmp_path, action, value)
            try:
                if said(words) is None and is_wrong:
                    problems.append(f"taken: {shown(words)}")
            except AssertionError as problem:
                problems.append(str(problem).splitlines()[0])
    assert problems == []


def test_misspelt_and_unfinished_options_are_told(
    program: Program, said: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for action in options(program.parser(monkeypatch)):
        if not action.option_strings:
            continue
        right = program.words(tmp_path)
        line = said([*right, f"{name_of(action)}x=1"])
        assert line is not None
        assert f"{name_of(action)}x" in line
        if action.nargs not in (0, "?", "*"):
            line = said([*right, name_of(action)])
            assert line is not None
            assert name_of(action) in line
