"""Does learning beside the ride disturb the 40 Hz loop?

Simulator and controller run as nodes in real time and ride to far goals. In turns the trainer
node learns live from them or is not there, and each turn's LoopTiming messages are kept: how
late the steps were and how long the answer to a state took. Percentiles are over all steps of
all turns of a kind. The load that others put on the machine is told beside them.

    python tests/benchmarks/bench_trainer_loop.py [--turns 3] [--seconds 30] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from bicycle_msgs.msg import LoopTiming, TrainerStatus
from geometry_msgs.msg import PoseStamped
from machine import machine
from rclpy.executors import SingleThreadedExecutor

from bicycle_controller.run_folder import origin
from bicycle_sim.nodes.interfaces import GOAL_POSE, TIMING, TRAINER

RESULTS = Path(__file__).parent / "results" / "trainer_loop.json"
START = 15.0
"""s for a trainer to import torch and to begin its updates, before its turn counts."""
WARM_UP = 100


class Ear:
    """Hears timing and the trainer's status, and sends the bicycle on its way."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.node = rclpy.create_node("ear")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.timing: list[LoopTiming] = []
        self.status: TrainerStatus | None = None
        self.node.create_subscription(LoopTiming, TIMING.name, self.timing.append, 1000)
        self.node.create_subscription(TrainerStatus, TRAINER.name, self._on_status, 10)
        self.goals = self.node.create_publisher(PoseStamped, GOAL_POSE.name, GOAL_POSE.publish)

    def _on_status(self, status: TrainerStatus) -> None:
        self.status = status

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)

    def send_far_goal(self) -> None:
        while self.goals.get_subscription_count() == 0:
            self.listen(0.1)
        goal = PoseStamped()
        goal.header.frame_id = "odom"
        goal.pose.position.x = 9000.0
        self.goals.publish(goal)


def node(module: str, *parameters: str) -> subprocess.Popen[bytes]:
    words = [word for parameter in parameters for word in ("-p", parameter)]
    command = [sys.executable, "-m", module, "--ros-args", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def turn(ear: Ear, seconds: float, folder: Path | None) -> dict[str, Any]:
    """One turn, with the trainer where it has a folder."""
    trainer = None
    if folder is not None:
        module = "bicycle_controller.nodes.trainer_node"
        trainer = node(module, f"out:={folder}", f"warm_up:={WARM_UP}", "updates_per_step:=1000.0")
        ear.listen(START)
    ear.status = None
    ear.timing.clear()
    ear.listen(seconds)
    timing = list(ear.timing)
    if trainer is not None:
        trainer.send_signal(signal.SIGINT)
        trainer.wait(10.0)
    return {
        "lateness": [message.lateness for message in timing],
        "latency": [message.latency for message in timing],
        "dropped": timing[-1].dropped_steps - timing[0].dropped_steps if timing else 0,
        "updates_per_s": float(getattr(ear.status, "update_rate", 0.0)) if folder else 0.0,
        "load": os.getloadavg()[0],
    }


def summary(turns: list[dict[str, Any]]) -> dict[str, Any]:
    """Percentiles over all turns of a kind, ms."""
    result: dict[str, Any] = {"steps": sum(len(found["lateness"]) for found in turns)}
    for name in ("lateness", "latency"):
        values = np.concatenate([np.array(found[name]) for found in turns]) * 1e3
        values = values[np.isfinite(values)]
        for label, share in (("p50", 0.5), ("p99", 0.99), ("p999", 0.999)):
            result[f"{name}_{label}_ms"] = round(float(np.quantile(values, share)), 3)
        per_turn = [np.nanquantile(np.array(found[name]) * 1e3, 0.99) for found in turns]
        result[f"{name}_p99_ms_of_each_turn"] = [round(float(value), 3) for value in per_turn]
    result["dropped_steps"] = int(sum(found["dropped"] for found in turns))
    result["updates_per_s"] = [round(found["updates_per_s"]) for found in turns]
    result["load_of_each_turn"] = [round(found["load"], 1) for found in turns]
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    ear = Ear()
    nodes = [
        node("bicycle_sim.nodes.sim_node"),
        node("bicycle_controller.nodes.controller_node", "policy:=lqr"),
    ]
    turns: dict[str, list[dict[str, Any]]] = {"alone": [], "learning": []}
    try:
        ear.send_far_goal()
        ear.listen(5.0)
        with tempfile.TemporaryDirectory() as folder:
            for index in range(args.turns):
                turns["alone"].append(turn(ear, args.seconds, None))
                turns["learning"].append(turn(ear, args.seconds, Path(folder) / str(index)))
    finally:
        for process in nodes:
            process.send_signal(signal.SIGINT)
            process.wait(10.0)
        rclpy.try_shutdown()
    result = {**origin(), "machine": machine()}
    result |= {kind: summary(found) for kind, found in turns.items()}
    args.out.parent.mkdir(exist_ok=True)
    args.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
