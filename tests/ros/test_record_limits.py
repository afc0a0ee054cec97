"""The recorder beyond its limits: too many messages, a slow disk, a full one; and its QoS file."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from node_process import NodeProcess
from probe import Probe
from rclpy.qos import ReliabilityPolicy
from test_record_replay import written
from waiting import until

from bicycle_bag import columns, repair
from bicycle_bag.reader import BagReader

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

TALKER = Path(__file__).parents[1] / "support" / "talker.py"
RECORDER = "bicycle_bag.nodes.recorder_node"
STATE = "/bicycle/state"
EPISODE = "/bicycle/episode"
HANGING_DISK = (
    "import os, sys, time; os.fdatasync = lambda descriptor: time.sleep(3600)\n"
    f"from {RECORDER} import main; sys.exit(main(sys.argv[1:]))"
)
Start = Callable[..., NodeProcess]


def start_talker(start_node: Start, *options: object) -> NodeProcess:
    return start_node(sys.executable, [TALKER, *options])


def test_losses_are_told_and_counted_to_the_message(start_node: Start, tmp_path: Path) -> None:
    narrow = tmp_path / "qos.yaml"
    narrow.write_text(f"{STATE}: {{history: keep_last, depth: 5, reliability: reliable}}\n")
    bag = tmp_path / "bag"
    recorder = start_node(
        RECORDER,
        ["--output", bag, "--qos-profile-overrides-path", narrow, "--topics", STATE, EPISODE],
    )
    recorder.wait_for_line("recording into")
    count = 3000
    talker = start_talker(start_node, "--count", count, "--hz", 1000)
    talker.wait_for_line("step 500$")
    recorder.send_signal(signal.SIGSTOP)
    talker.wait_for_line("step 1500$")
    recorder.send_signal(signal.SIGCONT)
    talker.wait_for_line("said")
    assert recorder.stop() == 0, recorder.output
    reader = BagReader(bag)
    steps = columns.load(reader, STATE)["step"].astype(int)
    # What is lost before the first or after the last recorded message leaves no gap to be seen.
    assert count / 2 < steps[-1] - steps[0] + 1 <= count
    lost = int(steps[-1] - steps[0]) + 1 - len(steps)
    assert lost > 0
    assert f", {lost} lost on the way" in recorder.lines[-1]
    assert reader.metadata.custom_data["lost_messages"] == str(lost)
    losses = re.findall(rf"(\d+) messages of {STATE} lost: too many", recorder.output)
    assert sum(map(int, losses)) == lost


def test_it_subscribes_as_the_file_says_and_to_the_types_asked_for(
    start_node: Start, tmp_path: Path, ros_domain: int
) -> None:
    chosen = tmp_path / "qos.yaml"
    chosen.write_text("bicycle/state: {reliability: best_effort}\n")
    words = ["--output", tmp_path / "bag", "--qos-profile-overrides-path", chosen]
    words += ["--topic-types", "bicycle_msgs/msg/BicycleState", "--all"]
    recorder = start_node(RECORDER, words)
    recorder.wait_for_line("recording into")
    start_node(sys.executable, [TALKER, "--count", "100000"])
    recorder.wait_for_line(f"recording {STATE}")
    probe = Probe(ros_domain)
    found = probe.spin_until(lambda: probe.node.get_subscriptions_info_by_topic(STATE))
    assert [end.qos_profile.reliability for end in found] == [ReliabilityPolicy.BEST_EFFORT]
    probe.close()
    assert recorder.stop() == 0
    assert set(BagReader(tmp_path / "bag").topics) == {STATE}


def test_killed_while_the_disk_hangs_it_has_written_what_came(
    start_node: Start, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    recorder = start_node(sys.executable, ["-c", HANGING_DISK, "--output", bag])
    recorder.wait_for_line("recording into")
    talker = start_talker(start_node, "--count", 100_000, "--hz", 200)
    talker.wait_for_line("step 800$")
    talker.send_signal(signal.SIGSTOP)
    until(lambda: written(bag, tmp_path) >= 800)
    recorder.kill()
    repair.repair(bag)
    steps = list(columns.load(bag, STATE)["step"])
    assert steps == list(range(len(steps)))
    assert len(steps) >= 800


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Yield a file system of 256 KiB."""
    place = tmp_path / "disk"
    place.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=256k", "small", str(place)]
    if os.geteuid() != 0 or subprocess.run(words, capture_output=True).returncode:
        pytest.skip("a small disk needs root and leave to mount")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_on_a_full_disk_the_recorder_ends_with_one_line(start_node: Start, disk: Path) -> None:
    recorder = start_node(RECORDER, ["--output", disk / "bag", "--compression", "none"])
    recorder.wait_for_line("recording into")
    talker = start_talker(start_node, "--count", 100000, "--hz", 2000)
    assert recorder.wait() == 1
    assert recorder.lines[-1].endswith("then recover what was recorded with record.sh --repair")
    assert "free some space" in recorder.lines[-1]
    assert "Traceback" not in recorder.output
    talker.kill()
    elsewhere = disk.parent / "bag"
    shutil.copytree(disk / "bag", elsewhere)
    assert repair.repair(elsewhere).messages > 300


@pytest.mark.parametrize("how", ["deleted", "deleted and made anew", "moved"])
def test_a_bag_that_is_taken_away_ends_the_recorder_with_one_line(
    start_node: Start, tmp_path: Path, how: str
) -> None:
    bag, other = tmp_path / "bag", tmp_path / "other"
    recorder = start_node(RECORDER, ["--output", bag])
    recorder.wait_for_line("recording into")
    talker = start_talker(start_node, "--count", 10**9)
    talker.wait_for_line("step 100$")
    if how == "moved":
        bag.rename(other)
    else:
        shutil.rmtree(bag)
    if how == "deleted and made anew":
        bag.mkdir()
        (bag / "bag_0.mcap").touch()
    assert recorder.wait() == 1
    line = recorder.lines[-1]
    if how == "moved":
        assert line.endswith(f"--repair {other}")
        repair.repair(other)
        assert BagReader(other).message_count > 50
    else:
        assert line.endswith("and what it held is lost: record again")
    assert "Traceback" not in recorder.output
