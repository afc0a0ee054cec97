"""The ros2_control plugin's serial line, compiled without ROS, against the simulated board."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from board_rig import Rig

from bicycle_hardware.frames import Mode, RefusalReason
from bicycle_hardware.simulated_board import build

WORKSPACE = Path(__file__).parents[2] / "ros2_ws"
PACKAGE = WORKSPACE / "native" / "bicycle_ros2_control"
FIRMWARE = WORKSPACE / "src" / "bicycle_hardware" / "bicycle_hardware" / "firmware"


@pytest.fixture(scope="module")
def shell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program that drives a link by lines of text."""
    folder = tmp_path_factory.mktemp("link")
    strict = ["-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    core = folder / "core.o"
    for words in (
        ["cc", "-std=c99", *strict, "-c", str(FIRMWARE / "bicycle_core.c"), "-o", str(core)],
        [
            "c++",
            "-std=c++17",
            *strict,
            f"-I{PACKAGE / 'include'}",
            f"-I{FIRMWARE}",
            str(PACKAGE / "src" / "board_link.cpp"),
            str(PACKAGE / "test" / "board_link_shell.cpp"),
            str(core),
            "-lm",
            "-o",
            str(folder / "shell"),
        ],
    ):
        assert shutil.which(words[0]), f"{words[0]} is needed"
        subprocess.run(words, check=True)
    return folder / "shell"


class Link:
    """A BoardLink in a process of its own, as the plugin is."""

    def __init__(self, shell: Path, line: str) -> None:
        self.process = subprocess.Popen(
            [str(shell), line], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __call__(self, words: str) -> dict[str, Any]:
        """Do it, and return all that the link knows."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(words + "\n")
        self.process.stdin.flush()
        found: dict[str, Any] = json.loads(self.process.stdout.readline())
        return found

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(10.0)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(build())
    yield made
    made.close()


@pytest.fixture
def link(shell: Path, rig: Rig) -> Iterator[Link]:
    rig.hear = lambda: None  # type: ignore[method-assign] # the plugin reads the line now
    made = Link(shell, rig.board.path)
    yield made
    made.close()


def rested(link: Link, rig: Rig) -> dict[str, Any]:
    """Let the board calibrate while commands come."""
    found: dict[str, Any] = {}
    for _ in range(150):
        link("command 0 0")
        rig.tick()
        found = link("receive")
    return found


def test_readings_arrive_as_the_board_has_them(link: Link, rig: Rig) -> None:
    found = rested(link, rig)
    i = rig.inputs
    assert found["gyro"] == pytest.approx(i.gyro, rel=1e-6)
    assert found["force"] == pytest.approx(i.force, rel=1e-6)
    assert found["steer"] == pytest.approx(i.steer, abs=1e-7)
    assert found["wheel"] == pytest.approx(i.wheel, abs=1e-7)
    assert found["battery"] == pytest.approx(i.battery)
    assert found["periods"] in (59, 60)  # 25 ms each, of ticks of 10
    assert found["bad_frames"] == found["damaged"] == 0


def test_it_arms_commands_and_stops_the_board(link: Link, rig: Rig) -> None:
    rig.tick(50)
    link("arm 1")
    rig.tick(10)
    found = link("receive")
    assert found["mode"] == Mode.DISARMED
    assert RefusalReason(found["reasons"]) & RefusalReason.NO_COMMANDS
    rested(link, rig)
    link("arm 1")
    link("command 1.5 40")
    out = rig.tick()
    assert (out.torque, out.drive, out.mode) == (1.5, 40.0, Mode.RIDING)
    rig.tick(2)
    found = link("receive")
    assert (found["mode"], found["torque"], found["drive"]) == (Mode.RIDING, 1.5, 40.0)
    link("stop")
    out = rig.tick()
    assert (out.drive, out.mode) == (0.0, Mode.ESTOP)


def test_silence_is_noticed_by_the_board(link: Link, rig: Rig) -> None:
    rested(link, rig)
    link("arm 1")
    link("command 0.5 40")
    assert rig.tick().mode is Mode.RIDING
    assert rig.tick(21).mode is Mode.FALLBACK
    assert rig.outputs.drive == 0.0


def test_steer_rate_follows_the_encoder(link: Link, rig: Rig) -> None:
    rig.frozen = ("steer",)
    found: dict[str, Any] = {}
    for step in range(40):
        rig.inputs.steer, rig.inputs.steer_us = 0.005 * step, rig.now_us
        rig.tick()
        found = link("receive")
    assert found["steer_rate"] == pytest.approx(0.5, rel=0.01)


def test_what_is_no_serial_line_is_told_in_one_line(shell: Path, tmp_path: Path) -> None:
    for words, told in (
        ([str(tmp_path / "none")], "cannot open"),
        ([str(tmp_path)], "cannot open"),
        (["/dev/null"], "is no serial line"),
        (["/dev/null", "9600"], "has no 9600 bits/s"),
    ):
        done = subprocess.run([str(shell), *words], capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert told in done.stderr
        assert done.stderr.count("\n") == 1
