"""The commands that the pages print, run as printed, in the order of the pages.

They run in a folder of their own, in which `ros2_ws` leads to the repository's. A command that
takes too long here, or needs what no test may touch, names the test that runs its like.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from node_process import NodeProcess
from printed import LONGEST, run_printed

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/training.md")
FOREVER = {
    "sim.sh": "waits for its first command",
    "controller.sh": "waits for a goal",
    "topic.sh echo": "^episode: ",
    "record.sh --output": "recording /bicycle/command",
}
"""Commands that run until they are ended, and a line after which the next one is typed."""
ELSEWHERE = {
    "./ros2_ws/ride.sh": "tests/ros/test_ride.py",
    "./ros2_ws/cockpit.sh": "tests/ros/test_cockpit.py",
    "./ros2_ws/setup.sh": "tests/bringup/test_shell.py",
    "./tests/run.sh": ".ci/run",
    "bicycle train": "tests/controller/test_train.py",
    "bicycle evaluate runs/any": "tests/controller/test_kicks.py",
    ". ros2_ws/env.sh": "tests/bringup/test_shell.py",
}
"""Beginnings of such commands, and the tests that run their like."""
SHORT_FILM = "--from 0 --to 1 --fps 4 --size 320x180"
"""Appended to a command that makes a film; the last of an option holds."""


def commands(page: str) -> list[str]:
    """Return the lines of a page's blocks of shell commands, without their comments."""
    text = (ROOT / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    lines = [line.partition(" #")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line]


def run_by(command: str) -> str:
    """Return the test that runs the like of a command; empty for one that is run here."""
    return next((test for start, test in ELSEWHERE.items() if command.startswith(start)), "")


@pytest.mark.parametrize("page", PAGES)
def test_every_printed_command_is_run(page: str) -> None:
    found = commands(page)
    assert found
    for command in found:
        test = run_by(command)
        assert not test or (ROOT / test).is_file(), command
        script = re.match(r"\./(ros2_ws/\w+\.sh)", command)
        assert script is None or (ROOT / script[1]).is_file(), command


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a person's folder, with a policy where the pages' training would have left one."""
    for name in ("ros2_ws", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "docs" / "images").mkdir(parents=True)
    mine = tmp_path / "runs" / "mine"
    mine.mkdir(parents=True)
    shipped = ROOT / "bicycle_controller" / "bicycle_controller" / "models"
    shutil.copy(shipped / "fixed-speed.safetensors", mine / "best.safetensors")
    return tmp_path


@pytest.fixture
def running() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def ride(folder: Path, running: ExitStack) -> None:
    """Start the ride that the page keeps running during a recording."""
    for command in ("./ros2_ws/sim.sh", "./ros2_ws/controller.sh"):
        begin(command, FOREVER[command.removeprefix("./ros2_ws/")], folder, running)
    subprocess.run(["./ros2_ws/goal.sh", "40", "15"], cwd=folder, check=True, timeout=LONGEST)


def begin(command: str, line: str, folder: Path, running: ExitStack) -> NodeProcess:
    """Start a command that runs until it is ended."""
    words = ["bash", "-c", f"exec {command}"]
    process = running.enter_context(NodeProcess(words, cwd=folder))
    process.wait_for_line(line)
    return process


@pytest.mark.timeout(3600)  # a page's rides take minutes of real time, on a busy machine many
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run_as_printed(
    page: str, folder: Path, running: ExitStack, ros_domain: int
) -> None:
    recorder: NodeProcess | None = None
    for command in commands(page):
        if run_by(command):
            continue
        if recorder is not None and "record.sh --output" not in command:
            assert recorder.stop(signal.SIGINT) == 0, recorder.output
            recorder = None
        forever = [line for start, line in FOREVER.items() if start in command]
        if forever:
            if "record.sh" in command:
                ride(folder, running)
            process = begin(command, forever[0], folder, running)
            if "record.sh" in command:
                recorder = process
                look = ["./ros2_ws/topic.sh", "rate", "/bicycle/state", "--seconds", "3"]
                subprocess.run(look, cwd=folder, check=True, timeout=LONGEST, capture_output=True)
            continue
        run_printed(command, folder, SHORT_FILM if "--video" in command else "")
