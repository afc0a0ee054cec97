"""Training on a GPU beside training on the CPU: bicycles stepped, updates made, whole rounds.

In turns, in one process: steps of the dynamics and of the whole task, by numpy on one core and on
the GPU; updates of preset `paper`'s and preset `fast`'s learner from a full memory; and rounds of
training as `bicycle train` makes them, each a step of all bicycles and one update. Rates are per
second of wall time, medians over the turns.

    python tests/benchmarks/bench_device.py [--turns 5] [--device cuda] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from bicycles import batched
from machine import machine
from tqdm import tqdm

from bicycle_controller.config import loading
from bicycle_controller.training.factory import make_agent, make_collector, make_memory
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.dynamics import State
from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.plants.choi.plant import ChoiPlant

RESULTS = Path(__file__).parent / "results" / "device.json"
SIZES = (1024, 16384, 262144, 1048576)
BATCHES = (64, 256, 4096, 65536)
FLEETS = ((128, 256), (4096, 4096), (65536, 65536))
"""Bicycles and batch of a round."""
ROWS = 200_000
TURN = 0.3
"""s that a turn lasts."""

Work = Callable[[], None]


def stepped(count: int, device: str) -> Work:
    """Return the whole task: dynamics on `device`, goals and rewards in numpy."""
    return batched(count, plant=None if device == "cpu" else ChoiPlant().on_device(device))


def resident(count: int, device: str) -> Work:
    """Return the dynamics alone, with states that stay where they are."""
    names = [field.name for field in fields(State)]
    physics = Physics()
    zero = np.zeros(count)
    state = dynamics.upright(zero, zero, zero, zero + 2.7, physics.constants)
    there: dict[str, Any] = {
        name: torch.from_numpy(getattr(state, name)).to(device) for name in names
    }
    here = State(**there)
    nothing = torch.zeros(count, dtype=torch.float64, device=device)

    def work() -> None:
        dynamics.step(here, nothing, nothing, nothing, physics, None, torch)

    return work


def updated(preset: str, batch: int, device: str) -> Work:
    """Make one update from a full memory."""
    config = loading.preset(preset, [f"ddpg.batch={batch}", f"ddpg.capacity={ROWS}"])
    memory, agent = make_memory(config, device), make_agent(config, device)
    rng = np.random.default_rng(0)
    width = memory.table.shape[1]  # type: ignore[attr-defined]
    rows = rng.normal(size=(ROWS, width)).clip(-1.0, 1.0)
    rows[:, -4:] = 0.99, 0.0, 0.0, 0.0
    memory.add(rows)

    def work() -> None:
        agent.update(memory, 1)

    return work


def round_of(bicycles: int, batch: int, device: str) -> Work:
    """Return a step of all bicycles and one update, preset `fast`."""
    config = loading.preset("fast", [f"bicycles={bicycles}", f"ddpg.batch={batch}", "warm_up=0"])
    memory, agent = make_memory(config, device), make_agent(config, device)
    collector = make_collector(config, memory, device)
    for _ in range(20):
        collector.step(agent)

    def work() -> None:
        collector.step(agent)
        agent.update(memory, 1)

    return work


def contestants(device: str) -> dict[str, tuple[Work, int]]:
    """Return the functions that take turns, with the count of one call."""
    result: dict[str, tuple[Work, int]] = {}
    for count in SIZES:
        for where in ("cpu", device):
            result[f"bicycle steps/s, task, {count}, {where}"] = stepped(count, where), count
        result[f"bicycle steps/s, dynamics, {count}, {device}"] = resident(count, device), count
    for preset in ("paper", "fast"):
        for batch in BATCHES:
            for where in ("cpu", device):
                result[f"updates/s, {preset}, {batch}, {where}"] = updated(preset, batch, where), 1
    for bicycles, batch in FLEETS:
        for where in ("cpu", device):
            name = f"rounds/s, {bicycles} bicycles, batch {batch}, {where}"
            result[name] = round_of(bicycles, batch, where), 1
    return result


def rate(work: Work, counts: int, device: str) -> float:
    """Per second of wall time, over one turn."""
    done, begun = 0, time.perf_counter()
    while True:
        work()
        done += 1
        if time.perf_counter() - begun > TURN:
            if device != "cpu":
                torch.cuda.synchronize()
            return done * counts / (time.perf_counter() - begun)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    about: dict[str, Any] = {**origin(), **machine("torch", "numpy"), "turns": args.turns}
    if args.device != "cpu":
        about["gpu"] = torch.cuda.get_device_name()
    rates: dict[str, float] = {}
    for name, (work, counts) in tqdm(contestants(args.device).items(), unit="contestant"):
        where = name.rsplit(", ", 1)[1]
        rate(work, counts, where)
        turns = [rate(work, counts, where) for _ in range(args.turns)]
        rates[name] = round(statistics.median(turns), 1)
        print(f"{name:60} {rates[name]:>16,.0f}", flush=True)
    args.out.write_text(json.dumps({**about, "rates": rates}, indent=1) + "\n")


if __name__ == "__main__":
    main()
