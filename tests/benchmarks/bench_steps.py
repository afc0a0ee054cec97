"""Bicycle steps per second: batched, on all cores, and one bicycle through Gymnasium.

Each turn steps N bicycles under random actions, starting again those that ended, as training
does. Beside it, in turns: the same N as separate Gymnasium environments in one process, as
stable-baselines3's DummyVecEnv and Gymnasium's SyncVectorEnv step them (up to 256, they are slow),
and one Pendulum-v1, Gymnasium's own six-line pendulum, beside one bicycle. Gymnasium's CartPole-v1
in its numpy vector version is a vectorised environment of like cost; `BicycleVecEnv` is what
stable-baselines3 sees. Rates are per second of processor time of one core; `all cores` runs one
process a core and is per second of wall time.

    python tests/benchmarks/bench_steps.py [--turns 5] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from bicycles import batched
from machine import machine
from stable_baselines3.common.vec_env import DummyVecEnv
from tqdm import tqdm

from bicycle_controller.training.run_folder import origin
from bicycle_sim.task.gym_env import BicycleEnv, BicycleVectorEnv
from bicycle_sim.task.sb3 import BicycleVecEnv

RESULTS = Path(__file__).parent / "results" / "steps.json"
SIZES = (1, 16, 64, 256, 1024, 4096, 16384)
SEPARATE = (1, 16, 64, 256)
TURN = 0.4
"""s of processor time that a turn lasts."""
ALL_CORES = 3.0
"""s of wall time for all cores together."""

Step = Callable[[], None]


def vector_env(count: int) -> Step:
    """Return `BicycleVectorEnv`, which is what `gymnasium.make_vec` gives."""
    env = BicycleVectorEnv(count, fall="terminate")
    return _gym_step(env, count)


def vec_env(count: int) -> Step:
    """`BicycleVecEnv`, which is the same for stable-baselines3."""
    env = BicycleVecEnv("BicycleGoal-v0", count, fall="terminate")
    env.reset()
    action = (np.random.default_rng(0).normal(size=(count, 2)) * 0.05).astype(np.float32)

    def step() -> None:
        env.step(action)

    return step


def cart_poles(count: int) -> Step:
    """Gymnasium's own vectorised environment, whose four states cost less than the bicycle's."""
    env = gymnasium.make_vec("CartPole-v1", num_envs=count)
    env.reset(seed=0)
    action = np.random.default_rng(0).integers(0, 2, count)

    def step() -> None:
        env.step(action)

    return step


def sync_vector_env(count: int) -> Step:
    """Gymnasium's own vector of separate environments."""
    env = gymnasium.vector.SyncVectorEnv([lambda: BicycleEnv(fall="terminate")] * count)
    return _gym_step(env, count)


def _gym_step(env: Any, count: int) -> Step:
    env.reset(seed=0)
    action = (np.random.default_rng(0).normal(size=(count, 2)) * 0.05).astype(np.float32)

    def step() -> None:
        env.step(action)

    return step


def dummy_vec_env(count: int) -> Step:
    """stable-baselines3's."""
    env = DummyVecEnv([lambda: BicycleEnv(fall="terminate")] * count)
    env.reset()
    action = (np.random.default_rng(0).normal(size=(count, 2)) * 0.05).astype(np.float32)

    def step() -> None:
        env.step(action)

    return step


def single(env: gymnasium.Env[Any, Any], actions: int) -> Step:
    """Return one environment, begun again when it ends."""
    env.reset(seed=0)
    action = np.full(actions, 0.01, dtype=np.float32)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return step


def rate(step: Step, count: int) -> float:
    """Bicycle steps per second of processor time, over one turn."""
    rounds, begun = 0, time.process_time()
    while (spent := time.process_time() - begun) < TURN:
        step()
        rounds += 1
    return count * rounds / spent


def _work(count: int, seed: int, ready: Any, rates: Any) -> None:
    step = batched(count, seed)
    step()
    ready.wait()
    rounds, begun = 0, time.monotonic()
    while time.monotonic() - begun < ALL_CORES:
        step()
        rounds += 1
    rates.put(count * rounds / (time.monotonic() - begun))


def all_cores(count: int) -> float:
    """Bicycle steps per second of wall time, one process a core."""
    cores = os.cpu_count() or 1
    context = multiprocessing.get_context("spawn")
    ready, rates = context.Barrier(cores), context.Queue()
    workers = [
        context.Process(target=_work, args=(count, seed, ready, rates)) for seed in range(cores)
    ]
    for worker in workers:
        worker.start()
    total = sum(float(rates.get()) for _ in workers)
    for worker in workers:
        worker.join()
    return total


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    contestants: dict[str, tuple[Step, int]] = {}
    for count in SIZES:
        contestants[f"task, {count}"] = batched(count), count
        contestants[f"BicycleVectorEnv, {count}"] = vector_env(count), count
        contestants[f"CartPole-v1, vectorised, {count}"] = cart_poles(count), count
    for count in SEPARATE:
        contestants[f"BicycleVecEnv, {count}"] = vec_env(count), count
        contestants[f"SyncVectorEnv, {count}"] = sync_vector_env(count), count
        contestants[f"DummyVecEnv, {count}"] = dummy_vec_env(count), count
    contestants["BicycleEnv"] = single(BicycleEnv(fall="terminate"), 2), 1
    contestants["Pendulum-v1"] = single(gymnasium.make("Pendulum-v1"), 1), 1
    rates: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in tqdm(range(args.turns), unit="turn", disable=None):
        for name, (step, count) in contestants.items():
            rates[name].append(rate(step, count))
    medians = {name: statistics.median(found) for name, found in rates.items()}
    together = {
        count: [all_cores(count) for _ in range(args.turns)] for count in SIZES if count >= 4096
    }
    result = {
        "command": shlex.join(["python", *sys.argv]),
        "commit": origin()["commit"],
        "machine": machine("numpy", "gymnasium", "stable-baselines3"),
        "steps_per_cpu_s": medians,
        "all cores, steps_per_s": {
            f"{count} each": {"median": statistics.median(found), "best": max(found)}
            for count, found in together.items()
        },
        "ratios": {
            f"{count} bicycles, BicycleVecEnv over DummyVecEnv": medians[f"BicycleVecEnv, {count}"]
            / medians[f"DummyVecEnv, {count}"]
            for count in SEPARATE
        }
        | {
            f"{count}, BicycleVectorEnv over CartPole-v1": medians[f"BicycleVectorEnv, {count}"]
            / medians[f"CartPole-v1, vectorised, {count}"]
            for count in SIZES
        }
        | {"BicycleEnv over Pendulum-v1": medians["BicycleEnv"] / medians["Pendulum-v1"]},
        "turns": args.turns,
    }
    args.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
