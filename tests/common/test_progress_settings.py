"""Variables that would end every program with a traceback of the progress bar."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bicycle_common.progress_settings import set_aside

WRONG = {
    "TQDM_MININTERVAL": "x",
    "TQDM_maxinterval": "nan",
    "TQDM_DELAY": "-1",
    "TQDM_INITIAL": "0.5",
    "TQDM_NCOLS": "wide",
    "TQDM_UNIT_DIVISOR": "0",
    "TQDM_BAR_FORMAT": "{nothing}",
    "TQDM_FILE": "out.txt",
    "TQDM_GUI": "1",
}
RIGHT = {
    "TQDM_MININTERVAL": "5",
    "TQDM_NCOLS": "80",
    "TQDM_BAR_FORMAT": "{l_bar}{bar}| {n:.1f}",
    "TQDM_UNIT": "x",
    "TQDM_OTHER": "x",
    "PATH": "x",
}


@pytest.mark.parametrize("name", WRONG)
def test_a_setting_that_cannot_be_used_is_set_aside_and_named(name: str) -> None:
    environment = {name: WRONG[name], "PATH": "/bin"}
    assert f"{name}={WRONG[name]!r}" in set_aside(environment)
    assert environment == {"PATH": "/bin"}


def test_one_that_can_be_used_stays() -> None:
    environment = dict(RIGHT)
    assert set_aside(environment) == ""
    assert environment == RIGHT


@pytest.mark.parametrize("name", WRONG)
def test_a_program_runs_in_spite_of_it(tmp_path: Path, name: str) -> None:
    words = [sys.executable, "-m", "bicycle_bag.repair", str(tmp_path / "nothing")]
    environment = {**os.environ, name: WRONG[name]}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    first, second = done.stderr.splitlines()
    assert first.startswith("repair: set aside")
    assert "there is no bag" in second
