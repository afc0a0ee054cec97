"""Signals at any moment, from a program's first to its last: it ends, quietly and as it should."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from node_process import NodeProcess, children_of
from waiting import until

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


PROGRAMS = {
    "sim.sh": (),
    "controller.sh": (),
    "trainer.sh": (),
    "record.sh": ("--output", "{folder}/bag"),
    "record.sh --repair": (BAG,),
    "replay.sh": (BAG,),
    "replay.sh --verify": (BAG,),
    "report.sh": (BAG, "--output", "{folder}/page.html"),
    "ride.sh": ("--goals", "1", "--output", "{folder}/run"),
    "cockpit.sh": ("--port", "0", "--bags", "{folder}/bags"),
    "goal.sh": ("1", "2"),
    "push.sh": ("left", "0.3"),
    "reset.sh": (),
    "topic.sh": ("echo", "bicycle/state"),
    "service.sh": ("call", "bicycle/reset"),
    "stop.sh": (),
    "circle.sh": ("--minutes", "1", "--output", "{folder}/circle"),
    "bin/bicycle evaluate": ("lqr", "--episodes", "1000000"),
    "bin/bicycle train": ("--out", "{folder}/trained", "--quiet"),
    "bin/bicycle info": (),
    "bin/bicycle": ("--help",),
}
MOMENTS = int(os.environ.get("BICYCLE_MOMENTS", "2"))
"""Number of moments at which each program is asked to end."""
TRACED = {
    "SHELLOPTS": "xtrace",
    "PYTHONPROFILEIMPORTTIME": "1",
    "BICYCLE_KEEP": "PYTHONPROFILEIMPORTTIME",
}
"""Has bash tell each command and Python each import: moments by what happens, not by the clock."""
FIRST_LINES = 20
"""Lines of a script before the one where it takes signals."""
SEVERAL_PROGRAMS = 3000
"""Steps of a script that runs several programs, within which it is asked to end."""
QUIET = 5.0
"""s without a word: it is up, or waits for somebody."""


class TracedProgram:
    """A program that tells each step that it takes."""

    def __init__(self, script: str, folder: Path) -> None:
        name, *verb = script.split()
        words = [*verb, *(str(word).format(folder=folder) for word in PROGRAMS[script])]
        self.process = NodeProcess([str(WORKSPACE / name), *words], TRACED)

    def follow(self, count: float) -> int:
        """Wait for so many lines, its end or its silence; how many it told."""
        heard = time.monotonic()
        count_of_steps = len(self.process.lines)
        while count_of_steps < count and self.process.running and time.monotonic() - heard < QUIET:
            time.sleep(0.0005)
            if len(self.process.lines) > count_of_steps:
                count_of_steps, heard = len(self.process.lines), time.monotonic()
        return count_of_steps

    def ask(self, signal_: signal.Signals, times: int) -> None:
        """Ask it to end, impatiently."""
        for _ in range(times):
            with contextlib.suppress(ProcessLookupError):
                self.process.send_signal(signal_)

    @property
    def words(self) -> str:
        """Lines of the output that are meant for people."""
        lines = self.process.lines
        return "\n".join(line for line in lines if not line.startswith(("+", "import time:")))


@pytest.mark.slow
@pytest.mark.parametrize("script", PROGRAMS)
def test_one_that_is_asked_to_end_while_it_starts_does_so_without_a_word(
    ros_domain: int, tmp_path: Path, script: str
) -> None:
    whole = TracedProgram(script, tmp_path / "0")
    # circle.sh runs programs that are here themselves, one after another for half a minute.
    long = script == "circle.sh"
    with whole.process:
        count = whole.follow(SEVERAL_PROGRAMS if long else math.inf)
        own = whole.process.stop() if whole.process.running else whole.process.wait()
    assert "Traceback" not in whole.words
    forgotten = 0
    moments = 1 if long else MOMENTS
    for number in range(moments):
        moment = FIRST_LINES + (count - FIRST_LINES) * (number + 0.5) / moments
        program = TracedProgram(script, tmp_path / str(number + 1))
        with program.process:
            asked = (signal.SIGINT, signal.SIGTERM)[number % 4 == 1]
            program.follow(moment)
            program.ask(asked, 1 + number % 2)
            if program.follow(math.inf) and program.process.running:
                # In the 0.1 ms in which it becomes Python bash forgets one.
                forgotten += 1
                program.ask(asked, 1)
            status = program.process.wait()
        good = (own, 0, 128 + asked, -asked)  # a shell shows the last two alike
        assert status in good, (moment, count, program.process.output[-3000:])
        assert "Traceback" not in program.words, (moment, count)
        assert "Exception ignored" not in program.words, (moment, count)
        assert "rror" not in program.words, (moment, count, program.words)
    # A script of many commands forgets it more often where the machine has much else to do.
    assert forgotten <= (2 if long else 1)


@pytest.mark.usefixtures("ros_domain")
def test_ctrl_c_while_the_learning_process_starts_is_for_the_node(tmp_path: Path) -> None:
    """A terminal sends it to both."""
    words = [WORKSPACE / "trainer.sh", "mode:=bags", f"bags:={BAG}"]
    for late in (0.0, 0.02, 0.05, 0.1, 0.3):
        out = f"out:={tmp_path / str(late)}"
        with NodeProcess([str(word) for word in (*words, out)]) as trainer:
            until(partial(learners, trainer.pid))
            time.sleep(late)
            os.killpg(trainer.pid, signal.SIGINT)
            assert trainer.wait() == 0, trainer.output
        assert "Traceback" not in trainer.output


def learners(pid: int) -> list[int]:
    """Children that run what multiprocessing spawns."""
    found = []
    for child in children_of(pid):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # it may have ended
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    return found


def test_the_first_moments_of_a_script_end_it_too(tmp_path: Path, ros_domain: int) -> None:
    forgotten = 0
    for lines in range(0, FIRST_LINES, 3):
        program = TracedProgram("sim.sh", tmp_path)
        with program.process:
            program.follow(lines)
            program.ask(signal.SIGINT, 1)
            if program.follow(math.inf) and program.process.running:
                forgotten += 1  # where the lines come late, the moment may be that of the exec
                program.ask(signal.SIGINT, 1)
            status = program.process.wait()
        assert status in (0, -signal.SIGINT, 130), program.process.output
    assert forgotten <= 1
