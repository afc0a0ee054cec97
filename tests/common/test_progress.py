"""Progress without a terminal is whole lines, now and then; with one it is a bar."""

from __future__ import annotations

import io
import re
from typing import Any

import pytest

from bicycle_common import progress
from bicycle_common.progress import ProgressBar


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self) -> bool:
        return True


def work(stream: io.StringIO, **options: Any) -> str:
    with ProgressBar(total=3, desc="kicks", unit="speed", file=stream, **options) as bar:
        for _ in range(3):
            bar.update()
    return stream.getvalue()


def test_long_work_writes_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 1e-9)
    lines = work(io.StringIO()).splitlines()
    assert len(lines) == 3
    assert re.fullmatch(r"kicks: 2 of 3 speeds after 00:\d\d, 00:\d\d to go", lines[1])
    assert "\r" not in "".join(lines)


def test_short_work_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 1e9)
    assert work(io.StringIO()) == ""


def test_a_name_alone_is_no_line(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    with ProgressBar(total=2, unit="part", file=stream) as bar:
        bar.set_description("reading")
    assert stream.getvalue() == ""
    monkeypatch.setattr(progress, "EVERY", 1e-9)
    with ProgressBar(total=2, unit="part", file=stream) as bar:
        bar.set_description("reading")
        bar.update()
    assert stream.getvalue().startswith("reading: 1 of 2 parts after")


def test_a_terminal_gets_a_bar() -> None:
    shown = work(Terminal())
    assert "\r" in shown
    assert "3/3" in shown


def test_quiet_work_says_nothing_anywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 1e-9)
    assert work(io.StringIO(), shown=False) == ""
    assert work(Terminal(), shown=False) == ""


def test_it_counts_what_is_iterated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 1e-9)
    stream = io.StringIO()
    bar = ProgressBar("abc", desc="letters", unit="letter", file=stream)
    assert list(bar) == ["a", "b", "c"]
    assert stream.getvalue().splitlines()[-1].startswith("letters: 3 of 3 letters")
