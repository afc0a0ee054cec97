"""Time from one observation to one action: our policy, torch and ONNX Runtime.

The actor is the paper's, 6-400-300-2, and beside it the shipped one that rides by default; every
contestant takes a float64 observation in SI units and gives float64 physical actions. They take
turns in one process with one thread; p50 and p99 are over all calls of all turns, in wall time and
in processor time (which leaves out what else the machine was doing).

    python tests/benchmarks/bench_policy_latency.py [--turns 40] [--calls 500] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import torch
from machine import machine
from tqdm import tqdm

from bicycle_controller.policy.export import to_onnx
from bicycle_controller.policy.policy import Policy, PolicyInfo, load_policy
from bicycle_controller.policy.torch_policy import TorchPolicy
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

SIZES = (6, 400, 300, 2)
RESULTS = Path(__file__).parent / "results" / "policy_latency.json"

Act = Callable[[np.ndarray], np.ndarray]


def policy(norm: bool = False) -> Policy:
    """Return the paper's actor with random weights."""
    rng = np.random.default_rng(0)
    tensors = {}
    for index, (inputs, outputs) in enumerate(pairwise(SIZES)):
        weight = rng.normal(size=(outputs, inputs)) / np.sqrt(inputs)
        tensors[f"layer.{index}.weight"] = weight.astype(np.float32)
        tensors[f"layer.{index}.bias"] = np.zeros(outputs, dtype=np.float32)
        if norm and index < len(SIZES) - 2:
            tensors[f"norm.{index}.weight"] = np.ones(outputs, dtype=np.float32)
            tensors[f"norm.{index}.bias"] = np.zeros(outputs, dtype=np.float32)
    scenario = SCENARIOS["random-start-random-goal"]
    info = PolicyInfo("latency", scenario, ChoiPlant(), (1.0,) * 6, (2.0, 0.2, 0.0))
    return Policy(info, tensors)


def onnx_act(actor: Policy) -> Act:
    """Return the actor in ONNX Runtime with one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    model = to_onnx(actor).SerializeToString()
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

    def act(observation: np.ndarray) -> np.ndarray:
        (action,) = session.run(None, {"observation": observation.astype(np.float32)})
        return np.asarray(action, dtype=np.float64)

    return act


def contestants() -> dict[str, Act]:
    """Return all who take part, by name."""
    plain, normed = policy(), policy(norm=True)
    return {
        "ours": plain.act,
        "ours, as shipped": load_policy().act,
        "torch eager": TorchPolicy(plain).act,
        "ONNX Runtime": onnx_act(plain),
        "ours, layer norm": normed.act,
        "torch eager, layer norm": TorchPolicy(normed).act,
    }


def turn(act: Act, observations: np.ndarray) -> tuple[list[int], list[int]]:
    """ns of wall and of processor time of each call."""
    walls, cpus = [], []
    for observation in observations:
        wall, cpu = time.perf_counter_ns(), time.thread_time_ns()
        act(observation)
        cpus.append(time.thread_time_ns() - cpu)
        walls.append(time.perf_counter_ns() - wall)
    return walls, cpus


def bench(turns: int, calls: int) -> dict[str, dict[str, float]]:
    """Percentiles in us of everybody, and how many times ours they are."""
    players = contestants()
    observations = np.random.default_rng(1).normal(size=(calls, 1, 6))
    walls: dict[str, list[int]] = {name: [] for name in players}
    cpus: dict[str, list[int]] = {name: [] for name in players}
    for act in players.values():
        turn(act, observations)
    for _ in tqdm(range(turns), unit="turn", disable=None):
        for name, act in players.items():
            wall, cpu = turn(act, observations)
            walls[name] += wall
            cpus[name] += cpu
    result: dict[str, dict[str, float]] = {}
    for name in players:
        row = {}
        for kind, times in (("wall", walls[name]), ("cpu", cpus[name])):
            for share in (50, 99):
                row[f"{kind}_p{share}_us"] = float(np.percentile(times, share)) / 1000.0
        result[name] = row
    for row in result.values():
        row["times ours"] = row["wall_p50_us"] / result["ours"]["wall_p50_us"]
    return result


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Return the results in lines."""
    lines = [f"{'us':26}  wall p50      p99   cpu p50      p99   x ours"]
    for name, row in rows.items():
        cells = " ".join(f"{value:8.1f}" for key, value in row.items() if key.endswith("us"))
        lines.append(f"{name:26} {cells} {row['times ours']:8.2f}")
    return "\n".join(lines)


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--turns", type=int, default=40)
    parser.add_argument("--calls", type=int, default=500)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    torch.set_num_threads(1)
    rows = bench(args.turns, args.calls)
    print(table(rows))
    about: dict[str, Any] = {"machine": machine("numpy", "torch", "onnxruntime")}
    about |= {"commit": origin()["commit"], "turns": args.turns, "calls": args.calls}
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps(about | {"contestants": rows}, indent=2) + "\n")
    print(f"written to {args.out}")


if __name__ == "__main__":
    main()
