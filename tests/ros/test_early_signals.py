"""Signals at any moment, from a program's first to its last: it ends, quietly and as it should."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess

from bicycle_bag.reader import BagReader

pytestmark = pytest.mark.ros

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
BAG = Path(__file__).parents[1] / "data" / "ride-0.1.0"
Start = Callable[..., NodeProcess]

NODES = {
    "sim.sh": ("waits for its first command", ()),
    "controller.sh": ("bicycle_controller", ()),
    "record.sh": ("recording into", ("--output", "{folder}/bag")),
    "replay.sh": ("playing", (BAG,)),
    "cockpit.sh": ("http://", ("--port", "0", "--bags", "{folder}/bags")),
}
"""Scripts that run until they are asked to end: a line that tells that they do, and arguments."""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("script", NODES)
def test_one_that_was_asked_to_end_keeps_its_status_whatever_comes_until_it_is_gone(
    start_node: Start, tmp_path: Path, script: str, number: signal.Signals
) -> None:
    ready, words = NODES[script]
    program = start_node(WORKSPACE / script, [str(w).format(folder=tmp_path) for w in words])
    program.wait_for_line(ready)
    while program.running:
        with contextlib.suppress(ProcessLookupError):
            program.send_signal(number)
        time.sleep(0.001)
    assert program.wait() == 0, program.output
    assert "Traceback" not in program.output
    if script == "record.sh":
        program.wait_for_line("recorded 0 messages")
        assert BagReader(tmp_path / "bag").message_count == 0
