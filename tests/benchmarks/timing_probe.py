"""Common part of the benchmarks of the 40 Hz loop: a ride, its timing, percentiles."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from bicycle_msgs.msg import LoopTiming, TrainerStatus
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor

from bicycle_common.nodes.topics import DIAGNOSTICS, GOAL_POSE, TIMING, TRAINER

PERIOD = 0.025
"""s of a step in real time."""


class TimingProbe:
    """Hears timing, diagnostics and the trainer, and sends the bicycle on its way."""

    def __init__(self, timing: bool = True) -> None:
        """Without `timing` it wakes for diagnostics and the trainer only, once in a second."""
        rclpy.init(args=[])
        self.node = rclpy.create_node("ear")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.timing: list[LoopTiming] = []
        self.status: TrainerStatus | None = None
        self.diagnostics: dict[str, dict[str, str]] = {}
        if timing:
            self.node.create_subscription(LoopTiming, TIMING.name, self._on_timing, 1000)
        self.node.create_subscription(TrainerStatus, TRAINER.name, self._on_status, 10)
        self.node.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, 10)
        self.goals = self.node.create_publisher(PoseStamped, GOAL_POSE.name, GOAL_POSE.publish)

    def _on_timing(self, timing: LoopTiming) -> None:
        self.timing.append(timing)

    def _on_status(self, status: TrainerStatus) -> None:
        self.status = status

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for entry in array.status:
            self.diagnostics[entry.name] = {pair.key: pair.value for pair in entry.values}

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)

    def hear(self, seconds: float) -> dict[str, Any]:
        """Return the loop's timing over a while, and the load that others put on the machine."""
        self.listen(1.0)  # what waited while nobody listened
        self.timing.clear()
        self.listen(seconds)
        timing = list(self.timing)
        return {
            "lateness": [message.lateness for message in timing],
            "jitter": [abs(message.period - PERIOD) for message in timing],
            "latency": [message.latency for message in timing],
            "dropped": timing[-1].dropped_steps - timing[0].dropped_steps if timing else 0,
            "load": os.getloadavg()[0],
        }

    def send_far_goal(self) -> None:
        while self.goals.get_subscription_count() == 0:
            self.listen(0.1)
        goal = PoseStamped()
        goal.header.frame_id = "odom"
        goal.pose.position.x = 9000.0
        self.goals.publish(goal)


@contextlib.contextmanager
def ride(
    *controller: str, priority: int | None = None, timing: bool = True
) -> Iterator[TimingProbe]:
    """Simulator and controller on their way to a far goal, and an ear for them.

    Args:
        controller: its parameters, such as `policy:=lqr`.
        priority: real-time priority of both; their own default for None.
        timing: True if the ear hears each step.
    """
    shared = () if priority is None else (f"realtime_priority:={priority}",)
    probe = TimingProbe(timing)
    nodes = [
        node("bicycle_sim.nodes.sim_node", *shared),
        node("bicycle_controller.nodes.controller_node", *shared, *controller),
    ]
    try:
        probe.send_far_goal()
        probe.listen(5.0)
        yield probe
    finally:
        for process in nodes:
            stop(process)
        rclpy.try_shutdown()


def options(doc: str | None, results: Path, seconds: float) -> argparse.ArgumentParser:
    """Return the options that these benchmarks have in common."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=seconds, help="of a turn")
    parser.add_argument("--out", type=Path, default=results)
    return parser


def save(out: Path, result: dict[str, Any]) -> None:
    """Write the results, and print them."""
    out.parent.mkdir(exist_ok=True)
    out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


def start(*words: str) -> subprocess.Popen[str]:
    """Return a process of this Python, its output kept."""
    return subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True)


def node(module: str, *parameters: str) -> subprocess.Popen[bytes]:
    """Return a node with parameters such as `policy:=lqr`, its output thrown away."""
    words = [word for parameter in parameters for word in ("-p", parameter)]
    command = [sys.executable, "-m", module, "--ros-args", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def trainer(folder: Path, warm_up: int) -> subprocess.Popen[bytes]:
    """Return a trainer that learns live, as fast as it can."""
    settings = (f"out:={folder}", f"warm_up:={warm_up}", "updates_per_step:=1000.0")
    return node("bicycle_controller.nodes.trainer_node", *settings)


def stop(process: subprocess.Popen[Any]) -> Any:
    """End a process; returns what it printed, where that is kept."""
    process.send_signal(signal.SIGINT)
    return process.communicate(timeout=15.0)[0]


def percentiles(
    turns: list[dict[str, Any]], names: tuple[str, ...] = ("jitter", "lateness", "latency")
) -> dict[str, Any]:
    """Percentiles over all turns of a kind, ms."""
    result: dict[str, Any] = {"steps": sum(len(found["lateness"]) for found in turns)}
    for name in names:
        values = np.concatenate([np.array(found[name]) for found in turns]) * 1e3
        values = values[np.isfinite(values)]
        for label, share in (("p50", 0.5), ("p99", 0.99), ("p999", 0.999)):
            result[f"{name}_{label}_ms"] = round(float(np.quantile(values, share)), 3)
        per_turn = [np.nanquantile(np.array(found[name]) * 1e3, 0.99) for found in turns]
        result[f"{name}_p99_ms_of_each_turn"] = [round(float(value), 3) for value in per_turn]
    result["dropped_steps"] = int(sum(found["dropped"] for found in turns))
    result["load_of_each_turn"] = [round(found["load"], 1) for found in turns]
    return result
