"""DDPG, NAF and PPO on Gymnasium's Pendulum-v1, beside stable-baselines3's DDPG and PPO.

Whether our baselines learn what others' learn. Each pair has the same hyperparameters: of the
off-policy learners two hidden layers of 64, batch 64, gamma 0.98, tau 0.005, Adam 1e-3 and
Gaussian noise of 0.1; of PPO those of rl-baselines3-zoo without its state-dependent noise (4
environments, rollouts of 4,096 steps, gamma 0.9, Adam 1e-3). What differs: our hidden units are
rectified, stable-baselines3's PPO has tanh; our PPO squashes its mean. NAF runs twice: with
rewards as large as the pendulum's it is slower than DDPG, with a tenth of them it is not.

Scores are returns of episodes without exploration, from the same starts for all. Published for
stable-baselines3: PPO -230 +- 143 and -212 +- 129, DDPG -190 +- 113 (huggingface.co:
sb3/ppo-Pendulum-v1, qgallouedec/ppo-Pendulum-v1-1422831320 and ddpg-Pendulum-v1-3347268901).

    python tests/benchmarks/bench_pendulum.py [--seeds 1 2 3] [--only NAME ...] [--out FILE]

With --only, the other learners' rows of the results file stay as they are.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from machine import machine
from pendulum import PendulumTask, pendulum_run, returns, train
from tqdm import tqdm

from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "pendulum.json"
OFF_POLICY_STEPS = 10_000
PPO_STEPS = 102_400
EPISODES = 100
PACKAGES = ("torch", "numpy", "gymnasium", "stable-baselines3")
EVALUATION_SEED = 50_000
"""Seed of the first scored episode."""

OFF_POLICY = (
    f"steps={OFF_POLICY_STEPS}",
    "warm_up=1000",
    "noise.kind=gaussian",
    "noise.sigma=0.1",
)
SHARED = (
    "gamma=0.98",
    "tau=0.005",
    "batch=64",
    "reward_scale=1",
    "observation_scale=[1,1,1,1,1,1]",
)
NAF = (
    *OFF_POLICY,
    *(f"naf.{text}" for text in SHARED),
    "naf.hidden=[64,64]",
    "naf.initialisation=fan_in",
)
OURS: dict[str, tuple[str, ...]] = {
    "ddpg": (
        *OFF_POLICY,
        *(f"ddpg.{text}" for text in SHARED),
        "ddpg.actor_hidden=[64,64]",
        "ddpg.critic_hidden=[64,64]",
        "ddpg.action_layer=1",
        "ddpg.initialisation=fan_in",
    ),
    "naf": NAF,
    "naf, reward x 0.1": (*NAF, "naf.reward_scale=0.1"),
    "ppo": (
        f"steps={PPO_STEPS}",
        "bicycles=4",
        "ppo.rollout=1024",
        "ppo.gamma=0.9",
        "ppo.learning_rate=0.001",
        "ppo.reward_scale=1",
        "ppo.observation_scale=[1,1,1,1,1,1]",
    ),
}
PRESETS = {"ddpg": "paper", "naf": "naf", "naf, reward x 0.1": "naf", "ppo": "ppo"}


def ours(name: str, seed: int) -> np.ndarray:
    """Train ours; the returns of its deterministic policy."""
    config = pendulum_run(PRESETS[name], *OURS[name], f"seed={seed}")
    scale = config.learner.observation_scale
    return returns(train(config).deployed, scale, EPISODES, EVALUATION_SEED)


def theirs(name: str, seed: int) -> np.ndarray:
    """Train stable-baselines3's; the returns of its deterministic policy."""
    from stable_baselines3 import DDPG, PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.noise import NormalActionNoise

    sizes: dict[str, Any] = {"net_arch": [64, 64]}
    model: Any
    if name == "ppo":
        model = PPO(
            "MlpPolicy",
            make_vec_env("Pendulum-v1", n_envs=4, seed=seed),
            n_steps=1024,
            gamma=0.9,
            learning_rate=1e-3,
            seed=seed,
            device="cpu",
        )
        model.learn(PPO_STEPS)
    else:
        model = DDPG(
            "MlpPolicy",
            gymnasium.make("Pendulum-v1"),
            learning_starts=1000,
            batch_size=64,
            gamma=0.98,
            action_noise=NormalActionNoise(np.zeros(1), np.full(1, 0.1)),
            policy_kwargs=sizes,
            seed=seed,
            device="cpu",
        )
        model.learn(OFF_POLICY_STEPS)
    task = PendulumTask(EPISODES, EVALUATION_SEED)
    total = np.zeros(EPISODES)
    for _ in range(200):
        observation = task.observation()[:, :3].astype(np.float32)
        total += task.step(model.predict(observation, deterministic=True)[0]).reward
    return total


Contestant = tuple[str, Callable[[str, int], np.ndarray], str]
"""Title, training and name of the algorithm."""


def contestants(only: list[str] | None) -> list[Contestant]:
    """Return all who take part, or those of the given titles."""
    found: list[Contestant] = [(f"ours, {name}", ours, name) for name in OURS]
    if machine(*PACKAGES)["stable-baselines3"] is None:
        print("without stable-baselines3: install ros2_ws/requirements/bench.lock")
    else:
        found += [(f"stable-baselines3, {name}", theirs, name) for name in ("ddpg", "ppo")]
    return [one for one in found if only is None or one[0] in only]


def trial(learner: Callable[[str, int], np.ndarray], name: str, seed: int) -> dict[str, float]:
    """Run one training, scored."""
    start = time.process_time()
    found = learner(name, seed)
    row = {"seed": seed, "mean": float(found.mean()), "std": float(found.std())}
    return row | {"cpu_s": time.process_time() - start}


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--only", nargs="+", metavar="NAME", help="such as 'ours, naf'")
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    torch.set_num_threads(1)
    players = contestants(args.only)
    old = json.loads(args.out.read_text()) if args.only and args.out.exists() else {}
    rows: dict[str, list[dict[str, float]]] = old.get("returns", {})
    rows |= {title: [] for title, _, _ in players}
    command = shlex.join(["python", *sys.argv])
    about = {"commands": [*old.get("commands", []), command], "commit": origin()["commit"]}
    about |= {"steps": {"ddpg, naf": OFF_POLICY_STEPS, "ppo": PPO_STEPS}, "episodes": EPISODES}
    args.out.parent.mkdir(parents=True, exist_ok=True)
    trials = [(seed, one) for seed in args.seeds for one in players]
    for seed, (title, learner, name) in tqdm(trials, unit="run", disable=None):
        rows[title].append(trial(learner, name, seed))
        tqdm.write(f"{title:24} {rows[title][-1]}")
        result = about | {"machine": machine(*PACKAGES), "returns": rows}
        args.out.write_text(json.dumps(result, indent=2) + "\n")
    for title, found in rows.items():
        means = [row["mean"] for row in found]
        print(f"{title:24} {np.mean(means):8.1f}  ({', '.join(f'{m:.0f}' for m in means)})")
    print(f"written to {args.out}")


if __name__ == "__main__":
    main()
