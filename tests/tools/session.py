"""README's commands in any order, as a person gives them: a state machine over real scripts.

Each rule runs a script of the workspace as a process and compares what it says and how it ends
with what is so: what runs, whether the bicycle lies, where it was when a goal was reached, what a
bag holds. A wait that does not end is a failure too.

    python tests/tools/session.py [--minutes 60] [--seed 1] [--log FILE]

The log has one line of JSON for each command: its words, status, seconds and last line.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import re
import signal
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO, TypeVar

from bicycle_msgs.msg import GoalStatus
from domains import claimed_domain
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)
from node_process import NodeProcess
from probe import Probe

from bicycle_bag.reader import BagReader
from bicycle_common.nodes.topics import GOAL_STATUS, STATE
from bicycle_tools.ride_log import RIDDEN

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
READY = {
    "simulator": "waits for its first command",
    "controller": "waits for a goal",
    "recorder": "recording into",
    "trainer": "learns live in",
    "cockpit": r"cockpit: (http://\S+)",
}
SCRIPTS = {"simulator": "sim", "controller": "controller", "recorder": "record"}
SCRIPTS |= {"trainer": "trainer", "cockpit": "cockpit"}
NEAR = 2.0
"""m between a bicycle and a goal that it is told to have reached: it rides on for some steps."""
SMALL = "ddpg.actor_hidden=[16,16] ddpg.critic_hidden=[16,16] ddpg.batch=32 evaluation.episodes=4"
SIGNALS = st.sampled_from([signal.SIGINT, signal.SIGTERM])
CHOICE = st.integers(0, 10**6)
POINTS = st.tuples(st.integers(-30, 30), st.integers(-30, 30))


class Session:
    """A person's terminals on one ROS domain, and what is so.

    Attributes:
        running: processes by name.
        bags: folders of finished bags.
        done: how often each command was given.
    """

    def __init__(self, log: TextIO | None = None) -> None:
        self._stack = contextlib.ExitStack()
        self.domain = self._stack.enter_context(claimed_domain())
        self.folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        self.env = {"ROS_DOMAIN_ID": str(self.domain), "ROS_LOG_DIR": str(self.folder / "log")}
        self.probe = Probe(self.domain, STATE, GOAL_STATUS)
        self._stack.callback(self.probe.close)
        self.running: dict[str, NodeProcess] = {}
        self.bags: list[Path] = []
        self.done: dict[str, int] = {}
        self._recording: Path | None = None
        self._numbers = iter(range(1_000_000))
        self._log = log

    def run(self, script: str, *words: object) -> NodeProcess:
        """Run a script to its end; the topics are heard meanwhile."""
        begun = time.monotonic()
        with NodeProcess([str(WORKSPACE / f"{script}.sh"), *map(str, words)], self.env) as result:
            self.probe.spin_until(lambda: not result.running)
            result.wait()
            self._note(script, words, result, begun)
        return result

    def start(self, name: str, *words: object) -> NodeProcess:
        """Start a script that goes on until it is ended, and wait until it is ready."""
        begun = time.monotonic()
        result = NodeProcess([str(WORKSPACE / f"{SCRIPTS[name]}.sh"), *map(str, words)], self.env)
        self._stack.callback(result.kill)
        ready = re.compile(READY[name])
        self.probe.spin_until(
            lambda: not result.running or any(ready.search(line) for line in result.lines)
        )
        assert result.running, result.output
        self.running[name] = result
        self._note(SCRIPTS[name], words, result, begun)
        return result

    def end(self, name: str, number: signal.Signals = signal.SIGINT) -> NodeProcess:
        """Ctrl-C, or another signal, to what was started; it ends with status 0."""
        result = self.running.pop(name)
        result.send_signal(number)
        self.probe.spin_until(lambda: not result.running)
        assert result.wait() == 0, result.output
        self.ended(name, result)
        return result

    def stop(self, name: str = "") -> None:
        """Run stop.sh: it tells what ran, of that name or at all, and nothing else."""
        expected = {it for it in self.running if not name or it == name}
        result = self.run("stop", *([name] if name else []))
        assert result.wait() == 0, result.output
        stopped = re.findall(r"^stopped (\w+) \(process \d+", result.output, re.MULTILINE)
        assert sorted(stopped) == sorted(expected), result.output
        assert expected or "nothing of this workspace runs" in result.output
        for one in expected:
            process = self.running.pop(one)
            assert process.wait() == 0, process.output
            self.ended(one, process)

    def ended(self, name: str, result: NodeProcess) -> None:
        """Check the state after a process has ended."""
        assert "Traceback" not in result.output, result.output
        if name == "simulator":
            self.probe[STATE].clear()
        if name == "recorder":
            assert self._recording is not None
            self.is_whole(self._recording, result)

    def is_whole(self, bag: Path, recorder: NodeProcess) -> None:
        """A recorder that has ended leaves a bag with as many messages as it says."""
        (count,) = re.findall(r"recorded (\d+) messages", recorder.output)
        assert BagReader(bag).message_count == int(count)
        self.bags.append(bag)

    def new_bag(self) -> Path:
        """Return a folder for the next bag, which is not there yet."""
        self._recording = self.folder / f"bag-{next(self._numbers)}"
        return self._recording

    def lies(self) -> bool:
        """Return True if the bicycle lies, by its newest state."""
        states = self.probe[STATE]
        return bool(states) and bool(states[-1].fallen)

    def rides(self) -> bool:
        """Return True if there are a bicycle and a controller."""
        return {"simulator", "controller"} <= self.running.keys()

    def forget(self) -> None:
        """Drop what was heard long ago."""
        del self.probe[STATE][:-2000]

    def close(self) -> None:
        """End everything, the last with SIGKILL."""
        self._stack.close()

    def _note(
        self, script: str, words: tuple[object, ...], result: NodeProcess, begun: float
    ) -> None:
        self.done[script] = self.done.get(script, 0) + 1
        assert "Traceback" not in result.output, result.output
        if self._log is not None:
            entry = {
                "command": " ".join(map(str, (f"{script}.sh", *words))),
                "status": None if result.running else result.wait(),
                "seconds": round(time.monotonic() - begun, 1),
                "line": result.lines[-1] if result.lines else "",
            }
            self._log.write(json.dumps(entry) + "\n")
            self._log.flush()


Rule = Callable[..., None]
One = TypeVar("One")


def chosen(items: Sequence[One], number: int) -> One:
    """Return an item by any number, also one beyond the last item."""
    return items[number % len(items)]


@dataclass(frozen=True)
class Command:
    """Condition of a command, and its arguments."""

    needs: Callable[[Any], object]
    drawn: dict[str, st.SearchStrategy[Any]]


COMMANDS: dict[str, Command] = {}
"""Commands by the name of the method that gives them."""


def command(
    needs: Callable[[Any], object] = lambda _: True, **drawn: Any
) -> Callable[[Rule], Rule]:
    """Return a method that gives a command, for when its needs are met."""

    def decorate(function: Rule) -> Rule:
        COMMANDS[function.__name__] = Command(needs, drawn)
        return function

    return decorate


class Person(RuleBasedStateMachine):
    """Gives commands in any order and does not believe a word."""

    log: TextIO | None = None
    until = math.inf
    """Moment of `time.monotonic` after which no more commands are given."""
    done: dict[str, int]
    session: Session

    def __init__(self) -> None:
        super().__init__()
        self.there = self.failed = False

    @initialize(number=st.integers(0, 10**9))
    def come(self, number: int) -> None:
        """Nobody comes at 0, which is the example that hypothesis begins with."""
        if number:
            self.session, self.there = Session(self.log), True
            type(self).done = self.session.done

    @rule(which=CHOICE, data=st.data())
    def give(self, which: int, data: st.DataObject) -> None:
        """Give any command; rules of their own would be drawn from a few of them, for long."""
        if not self.there or time.monotonic() > self.until:
            return
        name = chosen([name for name, one in COMMANDS.items() if one.needs(self)], which)
        values = {key: data.draw(values) for key, values in COMMANDS[name].drawn.items()}
        self.failed = True
        getattr(self, name)(**values)
        self.failed = False

    def lacks(self, name: str) -> bool:
        """Return True if nothing of this name runs."""
        return name not in self.session.running

    # One terminal each.

    @command(lambda self: self.lacks("simulator"))
    def sim(self) -> None:
        self.session.start("simulator", "real_time_factor:=3.0")

    @command(lambda self: self.lacks("controller"), policy=st.sampled_from(["lqr", "fixed-speed"]))
    def controller(self, policy: str) -> None:
        self.session.start("controller", f"policy:={policy}", "exploration:=none")

    @command(lambda self: self.lacks("recorder"))
    def record(self) -> None:
        self.session.start("recorder", "--output", self.session.new_bag())

    @command(lambda self: self.lacks("trainer") and self.session.rides())
    def trainer(self) -> None:
        out = self.session.folder / f"trainer-{next(self.session._numbers)}"
        self.session.start("trainer", f"out:={out}", "warm_up:=100", f"overrides:={SMALL}")

    @command(lambda self: self.lacks("cockpit"))
    def cockpit(self) -> None:
        words = ("--no-ride", "--port", "0", "--bags", self.session.folder)
        result = self.session.start("cockpit", *words)
        address = result.wait_for_line(READY["cockpit"])[1]
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(address) as page:
            assert b"<title>" in page.read()
        with opener.open(f"{address.rstrip('/')}/bags") as answer:
            listed = {Path(bag["name"]).parts[0] for bag in json.load(answer)["bags"]}
        there = {bag.relative_to(self.session.folder).parts[0] for bag in self.session.bags}
        assert there <= listed

    @command(lambda self: self.session.running, which=CHOICE, number=SIGNALS)
    def ctrl_c(self, which: int, number: signal.Signals) -> None:
        self.session.end(chosen(sorted(self.session.running), which), number)

    # Another one.

    @command(point=POINTS)
    def goal(self, point: tuple[int, int]) -> None:
        session = self.session
        heard = len(session.probe[GOAL_STATUS])
        lay = session.lies()
        patience = 100 if session.rides() else 2
        result = session.run("goal", *point, "--wait", "--timeout", patience)
        line = result.lines[-1]
        if "simulator" not in session.running:
            assert result.wait() == 4, line
            assert "controller" in session.running or "no controller" in line
        elif lay:  # also where there is no controller
            assert result.wait() == 3, line
            assert "lies" in line
        elif "controller" not in session.running:
            # It may have fallen meanwhile, for nobody rides it.
            assert result.wait() == (3 if session.lies() else 4), line
            assert "no controller" in line or "lies" in line
        elif result.wait() == 0:
            session.probe.spin_until(lambda: self._reached(heard, point))
        else:
            # The paper's actor and the LQR ride to every goal of this size, but a controller that
            # came late may find the bicycle down.
            assert result.wait() == 3, line
            session.probe.spin_until(session.lies)
        session.forget()

    def _reached(self, heard: int, point: tuple[int, int]) -> bool:
        """Return True if the goal was reported reached, and the bicycle was there at that time."""
        for status in self.session.probe[GOAL_STATUS][heard:]:
            if status.status == GoalStatus.REACHED:
                assert (status.position.x, status.position.y) == point
                states = self.session.probe[STATE]
                return any(
                    math.dist((one.rear_contact.x, one.rear_contact.y), point) < NEAR
                    for one in states
                )
        return False

    @command(side=st.sampled_from(["left", "right"]), hard=st.booleans())
    def push(self, side: str, hard: bool) -> None:
        session = self.session
        lay = session.lies()
        result = session.run("push", side, 2.0 if hard else 0.2, "--timeout", 2)
        if "simulator" not in session.running:
            assert result.wait() == 4, result.output
        elif result.wait() == 2:  # before the first step pushes wait, and their sum is bounded
            assert "with those that wait for the same step) is beyond 2 rad/s" in result.output
        else:
            assert result.wait() == (3 if lay else 0), result.output

    @command(x=st.integers(-5, 5))
    def reset(self, x: int) -> None:
        session = self.session
        result = session.run("reset", x, 0, "--timeout", 2)
        if "simulator" not in session.running:
            assert result.wait() == 4, result.output
            return
        assert result.wait() == 0, result.output
        session.probe[STATE].clear()
        session.probe.spin_until(lambda: session.probe[STATE])
        first = session.probe[STATE][0]
        assert not first.fallen
        assert (first.rear_contact.x, first.rear_contact.y) == (x, 0) or first.step > 0

    @command()
    def topics(self) -> None:
        listed = self.session.run("topic", "list")
        assert listed.wait() == 0
        there = [line for line in listed.lines if line.startswith("/bicycle/state ")]
        assert ("simulator" in self.session.running) == any("(1 publish" in it for it in there)

    @command(name=st.sampled_from([*READY, ""]))
    def stop(self, name: str) -> None:
        self.session.stop(name)

    # Rides and bags.

    @command(number=st.integers(0, 3))
    def ride(self, number: int) -> None:
        session = self.session
        output = session.folder / f"run-{next(session._numbers)}"
        words = ("--goals", 1, "--field", 20, "--seed", number, "--output", output)
        result = session.run("ride", *words, "simulator.pace:=lockstep", "controller.policy:=lqr")
        if {"simulator", "controller"} & session.running.keys():
            assert result.wait() == 1, result.output
            assert f"ROS_DOMAIN_ID={session.domain} is taken by" in result.output
            return
        assert result.wait() == 0, result.output
        assert "1 of 1 reached" in result.output
        assert "0 steps missing" in result.output
        session.bags.append(output / "bag")

    @command(lambda self: self.session.bags, which=CHOICE)
    def replay(self, which: int) -> None:
        session = self.session
        bag = chosen(session.bags, which)
        result = session.run("replay", bag, "--rate", 50, "--delay", 0)
        counts = BagReader(bag).counts
        if not sum(counts.values()):
            assert result.wait() == 1, result.output
            assert "has no message to play" in result.output
            return
        others = {"simulator", "controller", "trainer"} & session.running.keys()
        if "simulator" in others and counts.get("/bicycle/state"):
            assert result.wait() == 1, result.output
        if result.wait() != 0:
            assert result.wait() == 1, result.output
            assert "published by" in result.output
        if "simulator" not in others:
            session.probe[STATE].clear()

    @command(lambda self: self.session.bags, which=CHOICE)
    def verify(self, which: int) -> None:
        bag = chosen(self.session.bags, which)
        result = self.session.run("replay", "--verify", bag)
        assert "not the same" not in result.output, result.output
        if bag.parent.name.startswith("run-"):
            assert result.wait() == 0, result.output

    @command(lambda self: self.session.bags, which=CHOICE)
    def report(self, which: int) -> None:
        session = self.session
        bag = chosen(session.bags, which)
        page = session.folder / f"page-{next(session._numbers)}.html"
        result = session.run("report", bag, "--output", page)
        counts = BagReader(bag).counts
        # A recorder that comes late to a short replay may have heard no state.
        if any(counts.get(topic, 0) for topic in RIDDEN):
            assert result.wait() == 0, result.output
            if bag.parent.name.startswith("run-"):
                assert "1 of 1 goals reached" in page.read_text()
        else:
            assert result.wait() != 0, "a page of a bag without a bicycle"

    @invariant()
    def what_was_started_runs(self) -> None:
        for name, process in self.session.running.items() if self.there else ():
            assert process.running, f"{name} has ended: {process.output}"

    def teardown(self) -> None:
        if self.there:
            try:
                if not self.failed:
                    self.session.stop()
            finally:
                self.session.close()


def give_commands(
    most: int, number: int, log: TextIO | None = None, until: float = math.inf
) -> dict[str, int]:
    """Give up to so many commands, drawn by a seed; how often which script was called."""
    kind: Any = seed(number)(type("Person", (Person,), {"log": log, "until": until, "done": {}}))
    once = settings(
        max_examples=2,  # the first is the one in which nobody comes
        stateful_step_count=most,
        deadline=None,
        database=None,
        phases=[Phase.generate],  # what failed is in the log, and takes minutes to do again
        suppress_health_check=list(HealthCheck),
    )
    run_state_machine_as_test(kind, settings=once)
    return dict(kind.done)


def main() -> None:
    """Give commands for a while."""
    parser = argparse.ArgumentParser(description="See the top of this file.")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=argparse.FileType("a"), default=sys.stdout)
    given = parser.parse_args()
    end = time.monotonic() + 60.0 * given.minutes
    total: dict[str, int] = {}
    number = given.seed
    while time.monotonic() < end:
        for name, times in give_commands(50, number, given.log, end).items():
            total[name] = total.get(name, 0) + times
        number += 1
    print(json.dumps({"commands": total, "minutes": given.minutes}))


if __name__ == "__main__":
    main()
