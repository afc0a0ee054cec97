"""A full /dev/shm: the libraries that ROS brings would die there of a bus error."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess
from waiting import PATIENCE

pytestmark = pytest.mark.ros

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
SMALL = """
mount -t tmpfs -o size=256k small /dev/shm || exit 77
head -c 1M /dev/zero >/dev/shm/fill 2>/dev/null
"$@"
"""
"""A mount namespace of its own with a full /dev/shm, then the program."""
WORDS = {"goal": ["1", "2"], "push": ["left", "0.3"], "topic": ["list"], "service": ["list"]}
SCRIPTS = ["sim", "controller", "trainer", "record", "ride", "cockpit", *WORDS, "reset"]


def without_room(program: str, *words: str, network: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        ["unshare", "--mount", "bash", "-c", SMALL, "bash", program, *words],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        env={**os.environ, "BICYCLE_NETWORK": network},
    )
    if os.geteuid() != 0 or done.returncode == 77:
        pytest.skip("a small /dev/shm needs root and leave to mount")
    return done


@pytest.mark.parametrize("network", ["local", "lan"])
@pytest.mark.parametrize("name", SCRIPTS)
def test_it_is_said_in_one_line_with_the_remedy(ros_domain: int, name: str, network: str) -> None:
    words = WORDS.get(name, [])
    done = without_room(str(WORKSPACE / f"{name}.sh"), *words, network=network)
    assert done.returncode == 1, done
    assert "/dev/shm is full (0 KiB free)" in done.stderr
    assert "--shm-size=64m" in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr


def test_what_needs_no_ros_runs(tmp_path: Path) -> None:
    done = without_room(str(WORKSPACE / "bin" / "bicycle"), "info", network="local")
    assert done.returncode == 0, done


@pytest.mark.usefixtures("no_new_shared_memory")
@pytest.mark.parametrize("network", ["local", "lan"])
def test_a_killed_node_leaves_nothing_there(
    start_node: Callable[..., NodeProcess], network: str
) -> None:
    node = start_node(WORKSPACE / "sim.sh", [], {"BICYCLE_NETWORK": network})
    node.wait_for_line("waits for its first command")
    node.kill()
