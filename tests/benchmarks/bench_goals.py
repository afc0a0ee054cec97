"""CPU time until a learner rides to 99 % of 1,000 random goals: ours and competent peers.

One task for all: 10 km/h, displacement up to 20 cm, any start, goal and heading, faithful physics.
Every peer runs on the project's vector environment (`bicycle_sim.task.sb3.BicycleVecEnv`) with
natural observations, falls that end with their value and a capped cost per step. `registered`
starts are the scenario's own, `fast` starts those of the preset (near goals, tilted bicycles).

    fast          the preset `fast`, from nothing, no teacher
    quick         the preset `quick`: fast with smaller critics and batches, three updates a step
    ppo           stable-baselines3 PPO, stock networks, 64 bicycles, registered starts
    ppo-fast      the same on fast's starts
    ppo-tuned, ppo-short    the same on registered starts with the learning rates, gamma, lambda,
                  steps and batches that were the quickest of 14 trials with one seed
    td3           stable-baselines3 TD3, stock networks, 64 bicycles, registered starts
    td3-recipe    stable-baselines3 TD3 with what fast's recipe is: networks, 128 bicycles, 5-step
                  returns, tau, batch, noise, fast's starts
    sac, tqc      stable-baselines3 SAC and sb3-contrib TQC, stock networks, registered starts
    sac-recipe    stable-baselines3 SAC with the recipe
    crossq-recipe sb3-contrib CrossQ with it; tau and layer norm are not in that algorithm
    sbx-td3       SBX TD3 with the recipe and layer norm, compiling included
    td3-quick, sbx-quick    td3-recipe and sbx-td3 with the networks, batches and updates of quick
    untuned-td3   one bicycle, frozen falls, one-step returns, no cap: what not to do

Time is that of the processor, for learning and collecting; scoring is left out for all. All are
scored at the same points, after 1 s and then whenever a tenth more is spent: by 20 goals, by 100
from 80 % on, and by the 1,000 from 97 % on. Seeds take turns, and within a seed the learners, so
that other work on the machine falls on all of them. A run is added to the file as soon as it ends;
runs that are there already are not repeated.

    python tests/benchmarks/bench_goals.py [--only fast ppo ...] [--seeds 1 2 3] [--limit 120]
"""

from __future__ import annotations

import argparse
import json
import shlex
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from machine import machine

from bicycle_controller.config import loading
from bicycle_controller.config.algorithms import NATURAL_SCALE
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.training import online
from bicycle_controller.training.run_folder import RunFolder, origin
from bicycle_sim.task.scenario import named
from bicycle_sim.task.training_variant import TrainingVariant

RESULTS = Path(__file__).parent / "results" / "goals.json"
SCENARIO = "random-start-random-goal"
WANTED = 0.99
SCORED = {20: 0.8, 100: 0.97, 1000: WANTED}
"""Goals of each score, and the share of them from which the next score is taken."""
SEED = 77
"""Seed of the scored goals, the same for all."""
FIRST, APART = 1.0, 0.1
"""s of processor time until the first score, and the share of it between two scores."""
REGISTERED = TrainingVariant(
    near_share=0.0,
    tilt=0.0,
    tilt_rate=0.0,
    steer=0.0,
    steer_rate=0.0,
    any_speed=False,
    max_steps=400,
)
"""The scenario's own starts, with falls that end with their value and a capped cost."""

FUSED = {"optimizer_kwargs": {"fused": True}}
"""Adam in one call, as ours."""

PPO = {"n_steps": 128, "batch_size": 1024}
TUNED: dict[str, dict[str, Any]] = {
    "ppo-tuned": {**PPO, "learning_rate": 2e-3, "gamma": 0.98, "gae_lambda": 0.9},
    "ppo-short": {
        "n_steps": 64,
        "batch_size": 512,
        "learning_rate": 1e-3,
        "gamma": 0.98,
        "gae_lambda": 0.9,
    },
}
"""Options of PPO by the name of the peer."""

Row = dict[str, Any]


def reach_rate(controller: Any) -> tuple[float, int]:
    """Share of the scored goals that it rides to, and their number."""
    for goals, wanted in SCORED.items():
        found = evaluate(controller, named(SCENARIO), episodes=goals, seed=SEED).summary()
        rate = float(found["reach_rate"])
        if rate < wanted:
            break
    return rate, goals


class Clock:
    """Processor time of learning, and a score after each second of it."""

    def __init__(self, controller: Callable[[], Any], limit: float) -> None:
        """Start; stop after `limit` s."""
        self.controller, self.limit = controller, limit
        self.spent, self.next, self.begun = 0.0, FIRST, time.process_time()
        self.curve: list[Row] = []

    def goes_on(self, steps: int, updates: int) -> bool:
        """Score if it is time; return False at 99 % or at the limit."""
        spent = self.spent + time.process_time() - self.begun
        if spent < self.next:
            return True
        rate, goals = reach_rate(self.controller())
        self.curve.append(
            {"cpu_s": spent, "steps": steps, "updates": updates, "rate": rate, "goals": goals}
        )
        self.spent, self.next = spent, (1.0 + APART) * spent
        self.begun = time.process_time()
        return not (goals == 1000 and rate >= WANTED) and spent < self.limit


def ours(name: str, seed: int, limit: float) -> list[Row]:
    """One run of a preset of ours."""
    changes = (f"seed={seed}", f"scenario={SCENARIO}", "evaluation.every=1000000")
    small = ("evaluation.episodes=1", "evaluation.near_episodes=0", "tensorboard=false")
    config = loading.preset(name, [*changes, *small])
    with tempfile.TemporaryDirectory() as folder:
        files = RunFolder(Path(folder) / "run")
        files.create(config)
        learner = online.Trainer(config, files)
        clock = Clock(learner.policy, limit)

        def stop() -> bool:
            return not clock.goes_on(learner.collector.steps, learner.updates)

        learner.train(progress=False, stop=stop)
    return clock.curve


class Peer:
    """An actor of stable-baselines3 or SBX as a controller."""

    policy_id = "peer"

    def __init__(self, model: Any) -> None:
        """Wrap a model that sees natural observations and gives shares of the limits."""
        self.model, self.limits = model, named(SCENARIO).action_limits
        self.padded = type(model).__module__.startswith("sbx")

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Physical actions (N, 3), without exploration."""
        count = len(observation)
        # SBX compiles anew for each number of rows, which falls as rides end.
        rows = next(goals for goals in SCORED if count <= goals) if self.padded else count
        scaled = np.zeros((rows, 6), np.float32)
        scaled[:count] = observation / np.array(NATURAL_SCALE)
        action = np.zeros((count, 3))
        found = self.model.predict(scaled, deterministic=True)[0][:count]
        action[:, :2] = np.clip(found, -1.0, 1.0)
        return action * self.limits


def bicycles(count: int, variant: TrainingVariant) -> Any:
    """The project's vector environment for stable-baselines3."""
    from bicycle_sim.task.sb3 import BicycleVecEnv

    return BicycleVecEnv(
        f"bicycle/{SCENARIO}-v0", count, variant=variant, observation_scale="natural"
    )


def recipe(count: int) -> dict[str, Any]:
    """Return the part of fast's recipe that an off-policy learner of stable-baselines3 has."""
    from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise

    noise = NormalActionNoise(np.zeros(2), np.full(2, 0.15))
    return {
        "learning_rate": 1e-3,
        "learning_starts": 6400,
        "batch_size": 256,
        "tau": 0.02,
        "n_steps": 5,
        "train_freq": 1,
        "gradient_steps": 1,
        "action_noise": VectorizedActionNoise(noise, count),
    }


def model_of(name: str, seed: int) -> Any:
    """A peer before its first step."""
    options: dict[str, Any] = {"seed": seed, "device": "cpu", "verbose": 0}
    sizes = {"pi": [128, 128], "qf": [256, 256]}
    quick = {"train_freq": 1, "gradient_steps": 1, "learning_starts": 6400}
    import stable_baselines3 as sb3

    if name in ("ppo", "ppo-fast"):
        starts = REGISTERED if name == "ppo" else TrainingVariant()
        return sb3.PPO("MlpPolicy", bicycles(64, starts), **PPO, **options)
    if name in TUNED:
        return sb3.PPO("MlpPolicy", bicycles(64, REGISTERED), **TUNED[name], **options)
    if name in ("td3", "sac"):
        kind = getattr(sb3, name.upper())
        return kind("MlpPolicy", bicycles(64, REGISTERED), **quick, **options)
    if name == "tqc":
        from sb3_contrib import TQC

        return TQC("MlpPolicy", bicycles(64, REGISTERED), **quick, **options)
    if name == "untuned-td3":
        from stable_baselines3.common.env_util import make_vec_env

        keywords = {"observation_scale": "natural", "max_episode_steps": 400}
        env = make_vec_env(f"bicycle/{SCENARIO}-v0", env_kwargs=keywords)
        return sb3.TD3("MlpPolicy", env, **options)
    env, taken = bicycles(128, TrainingVariant()), recipe(128)
    if name.endswith("-quick"):
        sizes["qf"], taken["batch_size"], taken["gradient_steps"] = [128, 128], 64, 3
    networks: dict[str, Any] = {"net_arch": sizes}
    if name in ("td3-recipe", "td3-quick"):
        td3 = {"policy_delay": 1, "target_policy_noise": 0.05, "target_noise_clip": 0.1}
        return sb3.TD3("MlpPolicy", env, policy_kwargs=networks | FUSED, **td3, **taken, **options)
    if name in ("sac-recipe", "crossq-recipe"):
        taken.pop("action_noise")
        if name == "sac-recipe":
            return sb3.SAC("MlpPolicy", env, policy_kwargs=networks | FUSED, **taken, **options)
        from sb3_contrib import CrossQ

        taken.pop("tau")
        return CrossQ("MlpPolicy", env, policy_kwargs=networks, **taken, **options)
    from sbx import TD3

    networks |= {"layer_norm": True}
    return TD3("MlpPolicy", env, policy_kwargs=networks, policy_delay=1, **taken, **options)


OURS = ("fast", "quick")
PEERS = (
    *("td3-recipe", "td3-quick", "sbx-td3", "sbx-quick"),
    *("ppo-fast", "sac-recipe", "crossq-recipe"),
    *("ppo-tuned", "ppo-short", "ppo", "td3", "sac", "tqc", "untuned-td3"),
)


def peer(name: str, seed: int, limit: float) -> list[Row]:
    """One run of a peer."""
    import gymnasium  # noqa: F401  # before the environments, which it names
    from stable_baselines3.common.callbacks import BaseCallback

    begun = time.process_time()
    model = model_of(name, seed)
    clock = Clock(lambda: Peer(model), limit)
    clock.begun = begun

    class Score(BaseCallback):
        def _on_step(self) -> bool:
            return clock.goes_on(self.num_timesteps, self.model._n_updates)

    model.learn(10**9, callback=Score())
    return clock.curve


def summary(runs: dict[str, dict[str, list[Row]]]) -> dict[str, Any]:
    """Medians over seeds, for those that reached 99 % and for all."""
    found: dict[str, Any] = {}
    for name, curves in runs.items():
        ends = [curve[-1] for curve in curves.values()]
        reached = [row["goals"] == 1000 and row["rate"] >= WANTED for row in ends]
        found[name] = {
            "seeds": len(ends),
            "reached 99 %": sum(reached),
            "cpu_s": statistics.median(row["cpu_s"] for row in ends),
            "cpu_s of each": [round(row["cpu_s"], 1) for row in ends],
            "steps": statistics.median(row["steps"] for row in ends),
            "updates": statistics.median(row["updates"] for row in ends),
            "last rate of each": [row["rate"] for row in ends],
        }
    for mine in set(OURS) & set(found):
        for row in found.values():
            row[f"times {mine}"] = round(row["cpu_s"] / found[mine]["cpu_s"], 2)
    return found


def main() -> None:
    """Run, and write the results after each run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--peer-seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--limit", type=float, default=120.0, help="s of processor time of a run")
    parser.add_argument("--only", nargs="+", choices=(*OURS, *PEERS), default=[*OURS, *PEERS])
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    torch.set_num_threads(1)
    old = json.loads(args.out.read_text()) if args.out.exists() else {}
    runs: dict[str, dict[str, list[Row]]] = old.get("runs", {})
    about = {"command": shlex.join(["python", *sys.argv]), "commit": origin()["commit"]}
    packages = ("numpy", "torch", "gymnasium", "stable-baselines3", "sb3-contrib", "sbx-rl")
    about["machine"] = machine(*packages)
    commands = [*old.get("commands", []), about]
    for seed in sorted({*args.seeds, *args.peer_seeds}):
        for name in args.only:
            mine = name in OURS
            done = runs.setdefault(name, {})
            if str(seed) in done or seed not in (args.seeds if mine else args.peer_seeds):
                continue
            done[str(seed)] = (
                ours(name, seed, args.limit) if mine else peer(name, seed, args.limit)
            )
            print(f"{name} seed {seed}: {done[str(seed)][-1]}", flush=True)
            found = {name: curves for name, curves in runs.items() if curves}
            result = {"wanted": WANTED, "summary": summary(found), "commands": commands}
            args.out.write_text(json.dumps(result | {"runs": found}, indent=1) + "\n")
    print(json.dumps(summary({n: c for n, c in runs.items() if c}), indent=2))


if __name__ == "__main__":
    main()
