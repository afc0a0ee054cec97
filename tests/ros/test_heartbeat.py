"""The file by which a supervisor sees that a node still serves its callbacks."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess
from waiting import PATIENCE

pytestmark = pytest.mark.ros

SIM_NODE = "bicycle_sim.nodes.sim_node"
RECORDER = "bicycle_bag.nodes.recorder_node"
Start = Callable[..., NodeProcess]


def touched_after(beat: Path, moment: float, patience: float) -> bool:
    """Return True if the file is touched later than `moment`, within some seconds."""
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        if beat.exists() and beat.stat().st_mtime > moment:
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize("module", [SIM_NODE, RECORDER])
def test_it_beats_while_the_node_serves_and_stops_with_it(
    start_node: Start, tmp_path: Path, module: str
) -> None:
    beat = tmp_path / "heartbeat"
    words = ["--output", tmp_path / "bag"] if module == RECORDER else []
    node = start_node(module, words, {"BICYCLE_HEARTBEAT": str(beat)})
    node.wait_for_line("waits for its first|recording into")
    assert touched_after(beat, time.time(), PATIENCE)
    node.send_signal(signal.SIGSTOP)
    assert not touched_after(beat, time.time() + 0.2, 2.5)
    node.send_signal(signal.SIGCONT)
    assert touched_after(beat, time.time(), PATIENCE)


@pytest.mark.parametrize("module", [SIM_NODE, RECORDER])
def test_a_file_that_cannot_be_is_said(start_node: Start, tmp_path: Path, module: str) -> None:
    words = ["--output", tmp_path / "bag"] if module == RECORDER else []
    node = start_node(module, words, {"BICYCLE_HEARTBEAT": "/nowhere/heartbeat"})
    assert node.wait() == 2
    assert node.lines[-1].endswith("set BICYCLE_HEARTBEAT to a file that can be, or unset it")
    assert not (tmp_path / "bag").exists()
