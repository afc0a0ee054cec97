"""The origin of a result: the command, the commit and the processor that made it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bicycle_common.origin import made_by, origin

ROOT = Path(__file__).resolve().parents[2]


def test_it_names_this_commit_and_whether_files_have_changed() -> None:
    head = subprocess.run(
        ["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=True
    )
    assert origin()["commit"].rstrip("+") == head.stdout.strip()


def test_its_command_can_be_typed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/usr/bin/bicycle", "evaluate", "my policy.safetensors"])
    assert origin()["command"] == "bicycle evaluate 'my policy.safetensors'"


def test_what_made_a_result_has_no_time_that_differs_between_two_runs() -> None:
    assert made_by() == {name: origin()[name] for name in ("command", "commit", "processor")}


def test_a_source_without_git_has_no_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert origin()["commit"] == "unknown"
