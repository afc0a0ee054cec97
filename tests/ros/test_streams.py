"""Output streams and locations of scripts: closed, full, left by the reader, linked, gone."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess
from waiting import PATIENCE, until

pytestmark = pytest.mark.ros

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
BAG = Path(__file__).parents[1] / "data" / "ride-0.1.0"
LISTS = f"'{WORKSPACE}/topic.sh' list"
VERIFIES = f"'{WORKSPACE}/replay.sh' --verify '{BAG}'"
EVALUATES = f"'{WORKSPACE}/bin/bicycle' evaluate lqr --episodes 2"
BUFFERED = ["env -u PYTHONUNBUFFERED", "env PYTHONUNBUFFERED=1"]
"""Ways to write: all at the end, where a flush fails, and each print at once."""
Start = Callable[..., NodeProcess]


def bash(text: str, cwd: Path = Path("/")) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", text], cwd=cwd, capture_output=True, text=True, timeout=PATIENCE
    )


@pytest.mark.parametrize("buffered", BUFFERED)
@pytest.mark.parametrize("command", [LISTS, VERIFIES, EVALUATES])
def test_a_reader_that_leaves_is_no_error(ros_domain: int, command: str, buffered: str) -> None:
    done = bash(f"set -o pipefail; {buffered} {command} | true")  # gone long before the first word
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("buffered", BUFFERED)
@pytest.mark.parametrize("command", [LISTS, VERIFIES, EVALUATES])
def test_output_that_finds_no_space_is_told_in_one_line(
    ros_domain: int, command: str, buffered: str
) -> None:
    done = bash(f"{buffered} {command} >/dev/full")
    assert done.returncode in (1, 2)
    (line,) = done.stderr.splitlines()
    assert "No space left on device" in line


@pytest.mark.parametrize("where", [">/dev/full", ">&-", "| true"])
def test_stop_ends_all_though_its_words_are_lost(start_node: Start, where: str) -> None:
    nodes = [start_node(WORKSPACE / name) for name in ("sim.sh", "controller.sh")]
    nodes[0].wait_for_line("waits for its first command")
    nodes[1].wait_for_line("waits for a goal")
    done = bash(f"set -o pipefail; '{WORKSPACE}/stop.sh' {where}")
    assert (done.returncode, done.stderr) == (0, "")
    assert [node.wait(PATIENCE) for node in nodes] == [0, 0]


def test_no_file_takes_the_number_of_a_closed_stream(ros_domain: int, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    words = f"exec '{WORKSPACE}/record.sh' --output '{bag}' <&- >&- 2>&-"
    with subprocess.Popen(["bash", "-c", words], cwd="/") as recorder:
        try:
            until(bag.is_dir, recorder)
            for number in range(3):
                assert Path(f"/proc/{recorder.pid}/fd/{number}").readlink() == Path(os.devnull)
        finally:
            recorder.send_signal(signal.SIGINT)
        assert recorder.wait(PATIENCE) == 0


def test_a_script_finds_its_workspace_through_a_link(ros_domain: int, tmp_path: Path) -> None:
    for script in (*WORKSPACE.glob("*.sh"), WORKSPACE / "bin" / "bicycle"):
        (tmp_path / script.name).symlink_to(script)
        assert 'dirname "$(readlink -f' in script.read_text(), script
    assert bash(f"'{tmp_path}/stop.sh'").stdout.startswith("nothing of this workspace runs")
    assert bash(f"'{tmp_path}/circle.sh' --help").stdout.startswith("Goes all the way round")
    assert bash(f". '{tmp_path}/env.sh' && echo $BICYCLE_WS").stdout == f"{WORKSPACE}\n"


def test_a_working_directory_that_is_gone_is_told(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    done = bash(f"rmdir ../gone; '{WORKSPACE}/stop.sh'", tmp_path / "gone")
    assert (done.returncode, done.stdout) == (1, "")
    told = done.stderr.splitlines()[-1]
    assert told == "stop.sh: the working directory is not there any more: change to another."
