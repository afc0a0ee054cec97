"""The program `replay.sh --verify`: its line and its status."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from changed_ride import (
    STATES,
    changed,
    recorded,
    with_field,
)
from ride_bag_maker import Message

from bicycle_tools.nodes import verify

pytestmark = pytest.mark.ros


@pytest.mark.parametrize(("forged", "status"), [(False, 0), (True, 1)])
def test_the_program_tells_the_verdict_and_ends_so(
    ride: list[Message],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    forged: bool,
    status: int,
) -> None:
    change = with_field(STATES, 21, "speed", lambda old: old + forged)
    bag = recorded(tmp_path / "bag", changed(ride, change))
    monkeypatch.setattr(sys, "argv", ["verify", str(bag)])
    assert verify.main() == status
    said = capsys.readouterr().out
    assert said.startswith(f"{bag}: ")
    assert said.count("\n") == 1
    assert ("not the same after 20 equal states" in said) == forged


def test_the_program_names_what_is_wrong_with_a_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["verify", str(tmp_path / "none")])
    assert verify.main() == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("replay.sh --verify: ")
    assert "none" in said.err


def test_a_bag_without_states_has_no_ride(
    ride: list[Message],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = recorded(tmp_path / "bag", [item for item in ride if item[0] != STATES])
    monkeypatch.setattr(sys, "argv", ["verify", str(bag)])
    assert verify.main() == 1
    assert "not proved: the bag holds no ride to compute again" in capsys.readouterr().out
