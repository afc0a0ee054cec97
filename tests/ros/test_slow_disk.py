"""A recorder that is closing on a slow disk is waited for and never killed, whoever ends it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from cockpit_page import COCKPIT, Page, address_of
from node_process import NodeProcess
from waiting import PATIENCE

from bicycle_bag import columns
from bicycle_bag.reader import BagReader

pytestmark = [pytest.mark.ros, pytest.mark.slow]

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
TALKER = Path(__file__).parents[1] / "support" / "talker.py"
RECORDER = "bicycle_bag.nodes.recorder_node"
STATE = "/bicycle/state"
RIDE = ("--goals", "1", "--field", "20", "--seed", "1", "controller.policy:=lqr")
LOCKSTEP = "simulator.pace:=lockstep"
LONG = PATIENCE
Start = Callable[..., NodeProcess]


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return `slow_disk.c`, built with the compiler that set-up needs."""
    built = tmp_path_factory.mktemp("slow") / "slow_disk.so"
    source = str(Path(__file__).parents[1] / "support" / "slow_disk.c")
    build = ["g++", "-x", "c", "-shared", "-fPIC", "-Wall", "-Werror", source, "-o", str(built)]
    subprocess.run(build, check=True)
    return built


@pytest.fixture
def slow(library: Path) -> dict[str, str]:
    """Return the environment of a process whose disk takes three seconds for each sync."""
    return {"LD_PRELOAD": str(library), "SLOW_DISK": "3"}


@pytest.fixture
def hanging(slow: dict[str, str], tmp_path: Path) -> dict[str, str]:
    """Return the same for ten minutes, once the file "hang" is there."""
    return {**slow, "SLOW_DISK": "600", "SLOW_DISK_FILE": str(tmp_path / "hang")}


def recorded(start_node: Start, bag: Path, env: dict[str, str], *words: object) -> NodeProcess:
    """Return a recorder by its script, which has heard 100 states or more."""
    recorder = start_node(WORKSPACE / "record.sh", ["--output", bag, *words], env)
    recorder.wait_for_line("recording into", LONG)
    start_node(sys.executable, [TALKER, "--count", 400]).wait_for_line("said", LONG)
    return recorder


def is_whole(bag: Path) -> bool:
    """Return True if a bag has all parts of a finished one, and every state of the talker's."""
    assert (bag / "metadata.yaml").is_file()
    reader = BagReader(bag)
    assert list(columns.load(reader, STATE)["step"]) == list(range(400))
    return all(file.read_bytes().endswith(b"\x89MCAP0\r\n") for file in reader.files)


def note_of(name: str, domain: int) -> Path:
    """Write the entry that a script leaves for stop.sh."""
    (note,) = (WORKSPACE / "runs" / "pids" / str(domain)).glob(f"{name}.*")
    return note


def ended(pid: int, patience: float = LONG) -> bool:
    """Wait until a process that is nobody's child here has ended."""
    deadline = time.monotonic() + patience
    while Path(f"/proc/{pid}").exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.parametrize("splits", [(), ("--max-bag-duration", "0.4")])
def test_it_says_that_it_waits_and_ends_with_a_whole_bag(
    start_node: Start, tmp_path: Path, slow: dict[str, str], splits: tuple[str, ...]
) -> None:
    recorder = recorded(start_node, tmp_path / "bag", slow, *splits)
    assert recorder.stop(timeout=LONG) == 0, recorder.output
    assert is_whole(tmp_path / "bag")
    assert len(BagReader(tmp_path / "bag").files) > bool(splits)
    said = recorder.wait_for_line(r"still writing .*: the disk is slow, waiting")
    assert str(tmp_path / "bag") in said.string
    took = recorder.wait_for_line(r"the disk took up to ([\d.]+) s")
    assert float(took[1]) >= 3.0


def test_a_closed_terminal_closes_the_bag(start_node: Start, tmp_path: Path) -> None:
    recorder = recorded(start_node, tmp_path / "bag", {})
    assert recorder.stop(signal.SIGHUP, timeout=LONG) == 0, recorder.output
    assert is_whole(tmp_path / "bag")


def test_stop_waits_for_it(start_node: Start, tmp_path: Path, slow: dict[str, str]) -> None:
    recorder = recorded(start_node, tmp_path / "bag", slow, "--max-bag-duration", "0.4")
    stop = start_node(WORKSPACE / "stop.sh")
    assert stop.wait(LONG) == 0, stop.output
    assert stop.lines[0].startswith(
        f"waiting for recorder (process {recorder.pid}), which is still writing {tmp_path / 'bag'}"
    )
    assert stop.lines[-1] == f"stopped recorder (process {recorder.pid}, SIGINT)"
    assert recorder.wait() == 0, recorder.output
    assert is_whole(tmp_path / "bag")


def test_a_stopped_recorder_is_woken_to_close(start_node: Start, tmp_path: Path) -> None:
    recorder = recorded(start_node, tmp_path / "bag", {})
    recorder.send_signal(signal.SIGSTOP)
    assert start_node(WORKSPACE / "stop.sh").wait(LONG) == 0
    assert recorder.wait() == 0
    assert is_whole(tmp_path / "bag")


def test_ctrl_c_on_stop_leaves_it_to_end_alone(
    start_node: Start, tmp_path: Path, slow: dict[str, str]
) -> None:
    recorder = recorded(start_node, tmp_path / "bag", slow)
    stop = start_node(WORKSPACE / "stop.sh", ["recorder"])
    stop.wait_for_line("waiting for recorder", LONG)
    assert stop.stop(timeout=LONG) == 130, stop.output
    assert stop.lines[-1].endswith("which ends alone: do not kill it.")
    assert recorder.wait(LONG) == 0, recorder.output
    assert is_whole(tmp_path / "bag")


def test_stop_tells_of_a_bag_that_was_not_closed(
    start_node: Start, tmp_path: Path, hanging: dict[str, str]
) -> None:
    recorder = recorded(start_node, tmp_path / "bag", hanging)
    (tmp_path / "hang").touch()
    stop = start_node(WORKSPACE / "stop.sh")
    stop.wait_for_line("waiting for recorder", LONG)
    recorder.kill()
    assert stop.wait(LONG) == 1
    assert stop.lines[-1].endswith(f"recover it with record.sh --repair {tmp_path / 'bag'}")


def test_on_a_disk_that_hangs_a_second_ctrl_c_leaves_a_bag_that_lacks_nothing(
    start_node: Start, tmp_path: Path, hanging: dict[str, str]
) -> None:
    recorder = recorded(start_node, tmp_path / "bag", hanging)
    (tmp_path / "hang").touch()
    recorder.send_signal(signal.SIGINT)
    recorder.wait_for_line("the disk is slow, waiting", LONG)
    recorder.send_signal(signal.SIGTERM)  # of a ride that has left, say: no reason to hurry
    time.sleep(0.5)
    assert recorder.running
    assert recorder.stop(timeout=LONG) == 130
    assert "is whole unless the power fails" in recorder.lines[-1]
    assert is_whole(tmp_path / "bag")


def test_a_ride_waits_for_its_recorder(
    start_node: Start, tmp_path: Path, slow: dict[str, str]
) -> None:
    ride = start_node(WORKSPACE / "ride.sh", [*RIDE, LOCKSTEP, "--output", tmp_path / "run"], slow)
    assert ride.wait(LONG) == 0, ride.output
    ride.wait_for_line(f"the recorder is still writing {tmp_path / 'run' / 'bag'} .*, waiting")
    assert "0 steps missing" in ride.output
    assert (tmp_path / "run" / "bag" / "metadata.yaml").is_file()


def test_a_ride_tells_of_a_recorder_that_did_not_close(
    start_node: Start, ros_domain: int, tmp_path: Path, slow: dict[str, str]
) -> None:
    ride = start_node(WORKSPACE / "ride.sh", [*RIDE, LOCKSTEP, "--output", tmp_path / "run"], slow)
    ride.wait_for_line("the recorder is still writing", LONG)
    os.kill(int(note_of("recorder", ros_domain).suffix[1:]), signal.SIGKILL)
    assert ride.wait(LONG) == 1, ride.output
    ride.wait_for_line("ride.sh: recorder was killed by SIGKILL: ")


def test_ctrl_c_on_a_ride_leaves_its_recorder_to_end_alone(
    start_node: Start, ros_domain: int, tmp_path: Path, slow: dict[str, str]
) -> None:
    ride = start_node(WORKSPACE / "ride.sh", [*RIDE, LOCKSTEP, "--output", tmp_path / "run"], slow)
    ride.wait_for_line("the recorder is still writing", LONG)
    pid = int(note_of("recorder", ros_domain).suffix[1:])
    assert ride.stop(timeout=LONG) == 130, ride.output
    ride.wait_for_line(rf"left the recorder \(process {pid}\)")
    assert ended(pid)
    assert (tmp_path / "run" / "bag" / "metadata.yaml").is_file()
    assert BagReader(tmp_path / "run" / "bag").message_count > 0


def test_the_cockpit_waits_for_a_bag_that_a_page_ends(
    start_node: Start, ros_domain: int, tmp_path: Path, slow: dict[str, str]
) -> None:
    cockpit = start_node(COCKPIT, ["--port", "0", "--bags", tmp_path / "bags"], slow)
    page = Page(address_of(cockpit))
    assert page.ask("record", on=True)["ok"]
    log = WORKSPACE / "log" / "cockpit" / str(ros_domain) / "recorder.log"
    page.until(lambda: log.exists() and f"recording {STATE}" in log.read_text())
    assert page.ask("record", on=False)["ok"]
    assert not page.ask("record", on=True)["ok"]
    line = "the recorder is still writing"
    page.until(lambda: any(line in m.get("text", "") for m in page.heard))
    page.until(lambda: any("recorded bag-" in m.get("text", "") for m in page.heard))
    (bag,) = page.get("bags")["bags"]
    assert (tmp_path / "bags" / bag["name"] / "metadata.yaml").is_file()
    page.close()
    assert cockpit.stop(timeout=LONG) == 0, cockpit.output


def test_the_cockpit_waits_at_its_end_and_tells_of_a_recorder_that_was_killed(
    start_node: Start, ros_domain: int, tmp_path: Path, slow: dict[str, str]
) -> None:
    cockpit = start_node(COCKPIT, ["--port", "0", "--bags", tmp_path / "bags"], slow)
    page = Page(address_of(cockpit))
    log = WORKSPACE / "log" / "cockpit" / str(ros_domain) / "recorder.log"
    for kill in (True, False):
        assert page.ask("record", on=True)["ok"]
        page.until(lambda: log.exists() and f"recording {STATE}" in log.read_text())
        if kill:
            os.kill(int(note_of("recorder", ros_domain).suffix[1:]), signal.SIGKILL)
            page.until(lambda: any("killed by SIGKILL" in m.get("text", "") for m in page.heard))
            log.unlink()
            time.sleep(1.0)  # a bag is named by its second
    page.close()
    assert cockpit.stop(timeout=LONG) == 1, cockpit.output
    cockpit.wait_for_line("cockpit.sh: the recorder is still writing")
    assert "cockpit.sh: recorder was killed by SIGKILL" in cockpit.lines[-1]
    whole = [path for path in (tmp_path / "bags").iterdir() if (path / "metadata.yaml").exists()]
    assert len(whole) == 1
