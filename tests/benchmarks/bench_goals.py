"""Time until a learner rides to 99 % of 1,000 random goals: ours and stable-baselines3's.

One task for all: 10 km/h, displacement up to 20 cm, any start, goal and heading, faithful
physics. Ours learns by the preset `fast`, from nothing: no teacher. stable-baselines3's DDPG, TD3
and SAC learn on BicycleGoal-v0 with their own defaults and what is known to help them here:
observations in their natural ranges, rewards of a hundredth, the paper's 400 steps an episode and
its frozen falls, Ornstein-Uhlenbeck noise for DDPG and TD3.

Time is that of the processor, learning and collecting together; scoring is left out for all. Each
of stable-baselines3's is stopped at `--limit` times the time that ours took, the median of seeds.
After a learner has reached 99 % it is stopped. One thread each, one after the other.

    python tests/benchmarks/bench_goals.py [--seeds 1 2 3] [--limit 10] [--only ours ddpg td3 sac]
"""

from __future__ import annotations

import argparse
import json
import shlex
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from machine import machine
from tqdm import tqdm

from bicycle_controller.config import loading
from bicycle_controller.config.algorithms import NATURAL_SCALE
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.training import online
from bicycle_controller.training.run_folder import RunFolder, origin
from bicycle_sim.task.scenario import named

RESULTS = Path(__file__).parent / "results" / "goals.json"
SCENARIO = "random-start-random-goal"
GOALS = 1_000
WANTED = 0.99
SEED = 77
"""Of the goals that are scored, the same for all."""
EVERY = 500
"""Updates between two scores of ours."""
PEER_EVERY = 30.0
"""s of processor time between two scores of a peer."""
PEERS = ("ddpg", "td3", "sac")

Curve = list[dict[str, float]]


def reach_rate(controller: Any) -> float:
    """Share of the scored goals that it rides to."""
    found = evaluate(controller, named(SCENARIO), episodes=GOALS, seed=SEED).summary()
    return float(found["reach_rate"])


def ours(seed: int, limit: float) -> Curve:
    """Make one run of the preset `fast`, stopped at 99 % or after `limit` s."""
    changes = (f"seed={seed}", f"scenario={SCENARIO}", f"evaluation.every={EVERY}")
    small = ("evaluation.episodes=1", "evaluation.near_episodes=0", "tensorboard=false")
    config = loading.preset("fast", [*changes, *small])
    curve: Curve = []
    with tempfile.TemporaryDirectory() as folder:
        files = RunFolder(Path(folder) / "run")
        files.create(config)
        learner = online.Trainer(config, files)
        spent, begun, seen = 0.0, time.process_time(), 0

        def stop() -> bool:
            nonlocal spent, begun, seen
            if learner.updates < seen + EVERY:
                return False
            spent, seen = spent + time.process_time() - begun, learner.updates
            rate = reach_rate(learner.policy())
            steps = float(learner.collector.steps)
            curve.append({"cpu_s": spent, "steps": steps, "reach_rate": rate})
            begun = time.process_time()
            return rate >= WANTED or spent >= limit

        learner.train(progress=False, stop=stop)
    return curve


class SmallRewards(gymnasium.RewardWrapper[Any, Any]):
    """Rewards of a hundredth, which keep Q within about -20 and 0."""

    def reward(self, reward: Any) -> float:
        """Return a hundredth."""
        return 0.01 * float(reward)


class Peer:
    """A stable-baselines3 actor as a controller."""

    policy_id = "stable-baselines3"

    def __init__(self, model: Any) -> None:
        """Wrap a model that sees scaled observations and gives normalised actions."""
        self.model, self.limits = model, named(SCENARIO).action_limits

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Physical actions (N, 3), without exploration."""
        scaled = (observation / np.array(NATURAL_SCALE)).astype(np.float32)
        action = np.zeros((len(scaled), 3))
        action[:, :2] = self.model.predict(scaled, deterministic=True)[0]
        return action * self.limits


def peer(name: str, seed: int, limit: float) -> Curve:
    """Make one run of stable-baselines3's, stopped at 99 % or after `limit` s."""
    from dataclasses import replace

    from stable_baselines3 import DDPG, SAC, TD3
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.noise import OrnsteinUhlenbeckActionNoise

    scenario = replace(named(SCENARIO), max_steps=400)
    env = gymnasium.make(
        "bicycle_sim:BicycleGoal-v0",
        scenario=scenario,
        observation_scale=NATURAL_SCALE,
    )
    options: dict[str, Any] = {"learning_starts": 1000, "seed": seed, "device": "cpu"}
    if name != "sac":
        noise = OrnsteinUhlenbeckActionNoise(np.zeros(2), np.full(2, 0.2), theta=0.15, dt=1.0)
        options["action_noise"] = noise
    kinds: dict[str, Any] = {"ddpg": DDPG, "td3": TD3, "sac": SAC}
    model = kinds[name]("MlpPolicy", SmallRewards(env), **options)
    curve: Curve = []

    class Score(BaseCallback):
        spent, begun = 0.0, time.process_time()

        def _on_step(self) -> bool:
            now = time.process_time()
            if now - self.begun < PEER_EVERY:
                return True
            self.spent += now - self.begun
            rate = reach_rate(Peer(self.model))
            row = {"cpu_s": self.spent, "steps": float(self.num_timesteps), "reach_rate": rate}
            curve.append(row)
            self.begun = time.process_time()
            return rate < WANTED and self.spent < limit

    model.learn(10**9, callback=Score())
    return curve


def summary(rows: dict[str, list[Curve]]) -> dict[str, Any]:
    """Medians over seeds; a learner that was stopped first counts with its limit, as `beyond`."""
    found: dict[str, Any] = {}
    for name, curves in rows.items():
        if curves:
            found[name] = {
                "cpu_s": statistics.median(curve[-1]["cpu_s"] for curve in curves),
                "steps": statistics.median(curve[-1]["steps"] for curve in curves),
                "reached": [curve[-1]["reach_rate"] >= WANTED for curve in curves],
                "best_rate": [max(row["reach_rate"] for row in curve) for curve in curves],
            }
    for row in found.values():
        if "ours" in found:
            row["times ours"] = row["cpu_s"] / found["ours"]["cpu_s"]
        row["beyond"] = not all(row["reached"])
    return found


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--peer-seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--limit", type=float, default=10.0, help="times ours, for the others")
    parser.add_argument("--only", nargs="+", choices=("ours", *PEERS), default=["ours", *PEERS])
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    torch.set_num_threads(1)
    old = json.loads(args.out.read_text()) if args.out.exists() else {}
    rows: dict[str, list[Curve]] = old.get("curves", {}) | {name: [] for name in args.only}
    command = shlex.join(["python", *sys.argv])
    about = {"commands": [*old.get("commands", []), {"command": command, **_where()}]}
    trials = [("ours", seed) for seed in args.seeds if "ours" in args.only]
    trials += [(name, seed) for name in PEERS if name in args.only for seed in args.peer_seeds]
    for name, seed in tqdm(trials, unit="run", disable=None):
        if name == "ours":
            rows[name].append(ours(seed, limit=1200.0))
        else:
            limit = args.limit * statistics.median(one[-1]["cpu_s"] for one in rows["ours"])
            rows[name].append(peer(name, seed, limit))
        tqdm.write(f"{name:5} seed {seed}: {rows[name][-1][-1]}")
        result = about | {"goals": GOALS, "wanted": WANTED, "summary": summary(rows)}
        args.out.write_text(json.dumps(result | {"curves": rows}, indent=1) + "\n")
    print(json.dumps(summary(rows), indent=2))


def _where() -> dict[str, Any]:
    packages = ("numpy", "torch", "gymnasium", "stable-baselines3")
    return {"commit": origin()["commit"], "machine": machine(*packages)}


if __name__ == "__main__":
    main()
