"""Kill processes of a ride with SIGKILL, again and again, and see that it rides again each time.

Simulator, controller, recorder and, on request, the trainer run as nodes in real time. Each
strike kills some of them at a random moment and starts them again in random order after random
pauses. It is over when the simulator steps under fresh commands towards a goal, the recorder
records and the trainer, if it is part of it, tells its status again.

    python tests/tools/chaos.py [--minutes 20] [--seed 1] [--trainer] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from bicycle_msgs.msg import BicycleState, CommandEcho
from domains import claimed_domain
from node_process import NodeProcess, alive, children_of
from probe import Probe, goal

from bicycle_common.nodes.topics import COMMAND_ECHO, GOAL_POSE, STATE, TRAINER
from bicycle_controller.training.run_folder import origin

FRESH_STEPS = 20
"""Steps under fresh commands that count as riding again."""
LONGEST = 60.0
"""s after the last start within which it must ride again."""
ALONE = 20.0
"""s within which a learning process notices that its trainer is gone."""


class Chaos:
    """A ride that is struck."""

    def __init__(self, domain: int, folder: Path, seed: int, trainer: bool = False) -> None:
        self.chance = random.Random(seed)
        self.folder = folder
        self.env = {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder / "log")}
        self.running: dict[str, NodeProcess] = {}
        self.starts: Counter[str] = Counter()
        self.orphans: list[int] = []
        self.outlived = 0.0
        self.falls = 0
        self._asked = 0.0
        self.probe = Probe(domain, COMMAND_ECHO, TRAINER)
        self.fresh = 0
        self.has_goal = False
        self.state: BicycleState | None = None
        self.probe.node.create_subscription(STATE.type, STATE.name, self._on_state, 10)
        self.goals = self.probe.node.create_publisher(
            GOAL_POSE.type, GOAL_POSE.name, GOAL_POSE.publish
        )
        names = ["simulator", "controller", "recorder", *(["trainer"] if trainer else [])]
        self.make: dict[str, Callable[[], NodeProcess]] = {
            name: getattr(self, f"_{name}") for name in names
        }
        for name in names:
            self.start(name)
        self.ride_again()

    def _node(self, module: str, *words: str) -> NodeProcess:
        return NodeProcess([sys.executable, "-m", module, *words], self.env)

    def _simulator(self) -> NodeProcess:
        return self._node(
            "bicycle_sim.nodes.sim_node", "--ros-args", "-p", "reset_after_fall:=0.5"
        )

    def _controller(self) -> NodeProcess:
        return self._node("bicycle_controller.nodes.controller_node")

    def _recorder(self) -> NodeProcess:
        out = self.folder / f"bag-{self.starts['recorder']}"
        return self._node("bicycle_bag.nodes.recorder_node", "--output", str(out))

    def _trainer(self) -> NodeProcess:
        run = self.folder / f"run-{self.starts['trainer']}"
        words = [f"out:={run}", "warm_up:=200", "hand_over:=false"]
        return self._node(
            "bicycle_controller.nodes.trainer_node",
            "--ros-args",
            *(part for word in words for part in ("-p", word)),
        )

    def start(self, name: str) -> None:
        self.starts[name] += 1
        self.running[name] = self.make[name]()

    def _on_state(self, state: BicycleState) -> None:
        last, self.state = self.state, state
        if last is not None and state.fallen and not last.fallen:
            self.falls += 1
        moved = last is None or (state.episode, state.step) != (last.episode, last.step)
        echoes = self.probe[COMMAND_ECHO]
        echo = echoes[-1] if echoes else CommandEcho()
        self.has_goal = echo.command.has_goal
        good = echo.command_source == CommandEcho.SOURCE_FRESH and self.has_goal
        echoes.clear()
        if moved:
            self.fresh = self.fresh + 1 if good else 0

    def _ask(self) -> None:
        """Send the bicycle somewhere, once a second while it has nowhere to go."""
        state, now = self.state, time.monotonic()
        if state is None or self.has_goal or now - self._asked < 1.0:
            return
        self._asked = now
        at, (x, y) = state.rear_contact, (self.chance.uniform(-60.0, 60.0) for _ in "xy")
        self.goals.publish(goal(at.x + x, at.y + y))

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._ask()
            self.probe.executor.spin_once(timeout_sec=0.02)

    def _whole(self) -> bool:
        recorder = self.running["recorder"]
        trainer_reports = len(self.probe[TRAINER]) > 0 or "trainer" not in self.running
        return self.fresh >= FRESH_STEPS and trainer_reports and "recording" in recorder.output

    def ride_again(self) -> float:
        """s until all is well again; AssertionError with what was printed after LONGEST."""
        begun = time.monotonic()
        self.fresh = 0
        self.probe[TRAINER].clear()
        while not self._whole():
            self.listen(0.1)
            dead = [name for name, one in self.running.items() if not one.running]
            late = time.monotonic() - begun > LONGEST
            if dead or late:
                printed = "\n".join(f"-- {n}:\n{p.output}" for n, p in self.running.items())
                raise AssertionError(f"dead: {dead}, fresh steps: {self.fresh}\n{printed}")
        return time.monotonic() - begun

    def strike(self) -> dict[str, Any]:
        """Kill some, start them again, wait for the ride."""
        self.listen(self.chance.uniform(0.0, 3.0))
        victims = self.chance.sample(sorted(self.running), self.chance.randint(1, 2))
        if self.chance.random() < 0.2:
            victims = sorted(self.running)
        for name in victims:
            self._kill(name)
            self.listen(self.chance.uniform(0.0, 0.5))
        self.chance.shuffle(victims)
        for name in victims:
            self.start(name)
            self.listen(self.chance.choice((0.0, self.chance.uniform(0.0, 2.0))))
        return {"killed": victims, "rides_again_s": round(self.ride_again(), 3)}

    def _kill(self, name: str) -> None:
        """End one process alone; whoever it started must leave by itself."""
        victim = self.running.pop(name)
        children = children_of(victim.pid)
        victim.send_signal(signal.SIGKILL)
        victim._child.wait()
        begun = time.monotonic()
        while any(map(alive, children)) and time.monotonic() - begun < ALONE:
            self.listen(0.1)
        if children:
            self.outlived = max(self.outlived, time.monotonic() - begun)
        self.orphans += [pid for pid in children if alive(pid)]
        victim.kill()

    def close(self) -> None:
        for process in self.running.values():
            process.kill()
        self.probe.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--trainer", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("chaos.json"))
    args = parser.parse_args()
    about = {**origin(), "seed": args.seed, "load_at_start": os.getloadavg()[0]}
    strikes: list[dict[str, Any]] = []
    with claimed_domain() as domain, tempfile.TemporaryDirectory() as folder:
        chaos = Chaos(domain, Path(folder), args.seed, args.trainer)
        try:
            end = time.monotonic() + 60.0 * args.minutes
            while time.monotonic() < end:
                strikes.append(chaos.strike())
                print(len(strikes), strikes[-1], flush=True)
        finally:
            chaos.close()
            times = [strike["rides_again_s"] for strike in strikes] or [float("nan")]
            kills = Counter(name for strike in strikes for name in strike["killed"])
            about |= {
                "minutes": args.minutes,
                "strikes": len(strikes),
                "kills": dict(kills),
                "rides_again_s": {
                    "p50": float(np.median(times)),
                    "p99": float(np.quantile(times, 0.99)),
                    "largest": max(times),
                },
                "falls": chaos.falls,
                "orphans": len(chaos.orphans),
                "longest_that_a_child_outlived_its_parent_s": round(chaos.outlived, 1),
                "load_at_end": os.getloadavg()[0],
            }
            args.out.write_text(json.dumps(about, indent=2) + "\n")
    print(json.dumps(about, indent=2))


if __name__ == "__main__":
    main()
