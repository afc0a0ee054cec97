"""Tests keep off the ROS domains of others, also of what a killed test has left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import domains
import pytest
from domains import claimed_domain

WAITS = "print('up', flush=True); input()"


def test_a_domain_that_somebody_lives_in_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(domains, "LOCKS", tmp_path)
    monkeypatch.setattr(domains, "DOMAINS", (201, 202))
    left = subprocess.Popen(
        [sys.executable, "-c", WAITS],
        env={"ROS_DOMAIN_ID": "201"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert left.stdout is not None
    assert left.stdout.readline() == "up\n"
    with claimed_domain() as domain:
        assert domain == 202
        with pytest.raises(RuntimeError, match="no free ROS domain"), claimed_domain():
            pass
    left.communicate("")
    with claimed_domain() as first, claimed_domain() as second:
        assert {first, second} == {201, 202}
