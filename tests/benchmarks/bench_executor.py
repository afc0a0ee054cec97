"""Speed of lock-step with the executor of the loop's nodes, and with rclpy's usual one.

Simulator and controller ride to a far goal in lock-step, as fast as they answer each other, in
turns with `runner.LOOP_EXECUTOR` and with `SingleThreadedExecutor`. Told are the steps per second
and the processor time that each node takes for one, medians over the turns.

    python tests/benchmarks/bench_executor.py [--turns 3] [--seconds 10] [--out FILE]
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from bicycle_msgs.msg import BicycleState
from machine import machine
from timing_probe import TimingProbe, options, save, stop

from bicycle_common.nodes.topics import STATE
from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "executor.json"
KINDS = ("the loop's", "single-threaded")
NODES = {
    "simulator": ("bicycle_sim.nodes.sim_node", "pace:=lockstep"),
    "controller": ("bicycle_controller.nodes.controller_node", "goal_radius:=1.0"),
}
USUAL = "node.LOOP_EXECUTOR = rclpy.executors.SingleThreadedExecutor; "
LOOK = 0.2
"""s between two looks at the bicycle: to hear every state would slow it down."""
TICK = 1.0 / os.sysconf("SC_CLK_TCK")


def begin(kind: str, module: str, parameter: str) -> subprocess.Popen[bytes]:
    """Run one node on one kind of executor."""
    code = f"import rclpy, {module} as node; {USUAL if kind == KINDS[1] else ''}node.main()"
    words = [sys.executable, "-c", code, "--ros-args", "-p", parameter]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL)


def processor_time(process: subprocess.Popen[bytes]) -> float:
    """s that a process has used."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICK


def turn(kind: str, seconds: float) -> dict[str, float]:
    """Make one ride; its steps per second, and us of processor time per step of each node."""
    probe, newest = TimingProbe(), BicycleState()

    def hear(state: BicycleState) -> None:
        newest.step = state.step

    probe.node.create_subscription(STATE.type, STATE.name, hear, 1)
    nodes = {name: begin(kind, *about) for name, about in NODES.items()}
    try:
        probe.send_far_goal()
        look(probe, lambda: newest.step > 0, 30.0)
        before = {name: processor_time(node) for name, node in nodes.items()}
        step, begun = newest.step, time.monotonic()
        look(probe, lambda: False, seconds)
        steps, elapsed = newest.step - step, time.monotonic() - begun
        used = {name: processor_time(node) - before[name] for name, node in nodes.items()}
    finally:
        for node in nodes.values():
            stop(node)
        rclpy.try_shutdown()
    per_step = {f"{name}_us_per_step": 1e6 * spent / steps for name, spent in used.items()}
    return {"steps_per_s": steps / elapsed, **per_step}


def look(probe: TimingProbe, done: Callable[[], bool], longest: float) -> None:
    """Look at the bicycle now and then."""
    end = time.monotonic() + longest
    while not done() and time.monotonic() < end:
        time.sleep(LOOK)
        probe.executor.spin_once(timeout_sec=0.1)


def main() -> None:
    args = options(__doc__, RESULTS, 10.0).parse_args()
    turns: dict[str, list[dict[str, float]]] = {kind: [] for kind in KINDS}
    about: dict[str, Any] = {**origin(), **machine("ros-jazzy-rclpy")}
    for _ in range(args.turns):
        for kind in KINDS:
            turns[kind].append(turn(kind, args.seconds))
    medians = {
        kind: {
            name: round(statistics.median(found[name] for found in turns[kind]), 1)
            for name in turns[kind][0]
        }
        for kind in KINDS
    }
    ratio = medians[KINDS[0]]["steps_per_s"] / medians[KINDS[1]]["steps_per_s"]
    save(args.out, {**about, **medians, "times as fast": round(ratio, 2)})


if __name__ == "__main__":
    main()
