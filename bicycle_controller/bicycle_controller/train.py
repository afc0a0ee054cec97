"""The training run: collect, update, evaluate, keep the best policy, save."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bicycle_controller import metrics, settings
from bicycle_controller.agents.base import Agent
from bicycle_controller.agents.ddpg import Ddpg
from bicycle_controller.collect import Collector
from bicycle_controller.config import RunConfig
from bicycle_controller.policy import Policy, PolicyInfo, save_policy
from bicycle_controller.replay import Replay
from bicycle_controller.score import Score, score

WORST = (-2.0, -float("inf"))
"""Below the rank of any policy."""


@dataclass(frozen=True)
class Result:
    """How a run ended."""

    status: str
    """`finished` (all steps made), `reached` (`stop_at` was met) or `interrupted`."""
    steps: int
    """Environment steps made."""
    updates: int
    best: Score | None
    """Score of `best.safetensors`."""
    seconds: float
    """Wall time of this call."""


class Trainer:
    """All the state of a run, and its one loop."""

    def __init__(self, config: RunConfig, folder: Path) -> None:
        """Build everything from the configuration and its seed."""
        torch.set_num_threads(config.threads)
        self.config, self.folder = config, folder
        actions = int((config.scenario.action_limits > 0).sum())
        self.replay = Replay(config.ddpg.capacity, actions, config.device)
        self.collector = Collector(config, self.replay)
        self.agent: Agent = Ddpg(config.ddpg, actions, config.seed, config.device)
        self.updates = 0
        self.best: Score | None = None

    def policy(self) -> Policy:
        """The actor as it is now, with what is known about it."""
        config = self.config
        trained = {
            "algorithm": "ddpg",
            "preset": config.preset,
            "seed": config.seed,
            "steps": self.collector.steps,
            "updates": self.updates,
        }
        info = PolicyInfo(
            name=config.preset or "ddpg",
            scenario=config.scenario,
            physics=config.physics,
            observation_scale=config.ddpg.observation_scale,
            action_limits=tuple(config.scenario.action_limits.tolist()),
            trained=trained,
        )
        tensors: dict[str, np.ndarray] = {}
        for name, value in self.agent.actor.state_dict().items():
            tensors[name.replace("layers.", "layer.").replace("norms.", "norm.")] = (
                value.cpu().numpy().copy()
            )
        return Policy(info, tensors)

    def advance(self) -> bool:
        """Step all bicycles once and make the updates that are due; whether to evaluate."""
        config = self.config
        self.collector.step(self.agent)
        warm = self.collector.steps >= config.warm_up
        if not warm or self.collector.rounds % config.update_every:
            return False
        before = self.updates // config.evaluation.every
        self.agent.update(self.replay, config.updates)
        self.updates += config.updates
        return self.updates // config.evaluation.every > before

    def evaluate(self) -> Score:
        """Score the actor, and keep it as the best if it is."""
        config, policy = self.config, self.policy()
        fixed = config.evaluation
        found = score(policy, config.scenario, config.physics, fixed.episodes, fixed.seed)
        if found.rank > (self.best.rank if self.best else WORST):
            self.best = found
            save_policy(policy, self.folder / "best.safetensors")
        save_policy(policy, self.folder / "last.safetensors")
        return found


def run(
    config: RunConfig,
    folder: Path,
    show_progress: bool = True,
    stop: Callable[[], bool] = lambda: False,
) -> Result:
    """Train until the steps are made, the goal rate is met or `stop` says so.

    Args:
        config: the whole run.
        folder: made if need be; gets config.yaml, log.jsonl and the policies.
        show_progress: whether to draw the bar.
        stop: asked after every step of all bicycles.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.yaml").write_text(settings.dump(config))
    trainer = Trainer(config, folder)
    log = metrics.Log(folder, None, 0, tensorboard=False)
    bar = metrics.progress_bar(config.steps, 0, show_progress)
    start, cpu = time.monotonic(), time.process_time()
    status = "finished"
    while trainer.collector.steps < config.steps:
        due = trainer.advance()
        bar.update(config.bicycles)
        if due:
            found = trainer.evaluate()
            row: dict[str, Any] = trainer.collector.metrics() | trainer.agent.metrics()
            row |= {"updates": trainer.updates, "reach_rate": found.reach_rate}
            row |= {"eval_falls": found.fall_rate, "median_time_s": found.median_time}
            row |= {"wall_s": time.monotonic() - start, "cpu_s": time.process_time() - cpu}
            log.write("evaluation", trainer.collector.steps, row)
            bar.set_postfix(reach=found.reach_rate, falls=found.fall_rate, ret=row["return"])
            limits = config.evaluation
            met = found.reach_rate >= limits.stop_at and found.fall_rate <= limits.stop_falls
            if limits.stop_at > 0 and met:
                status = "reached"
                break
        if stop():
            status = "interrupted"
            break
    bar.close()
    log.close()
    seconds = time.monotonic() - start
    return Result(status, trainer.collector.steps, trainer.updates, trainer.best, seconds)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle train`."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the run folder")
    parser.add_argument(
        "--preset", help=f"one of {', '.join(settings.preset_names())} (default: fast)"
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="YAML instead of a preset")
    parser.add_argument("--scenario", help="where from and where to (default: the preset's)")
    parser.add_argument("--seed", type=int, help="of everything random (default: the preset's)")
    parser.add_argument("--device", choices=("cpu", "cuda"), help="where to train")
    parser.add_argument("--steps", help="environment steps over all bicycles")
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change one value, for instance ddpg.tau=0.01; may be repeated",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def config_of(args: argparse.Namespace) -> RunConfig:
    """The configuration that the arguments ask for.

    Raises:
        ValueError: on an unknown name or a value out of range.
    """
    named = {name: getattr(args, name) for name in ("scenario", "seed", "device", "steps")}
    overrides = [f"{name}={value}" for name, value in named.items() if value is not None]
    overrides += args.overrides
    if args.config is not None:
        return settings.load(args.config, overrides)
    return settings.preset(args.preset or "fast", overrides)


def run_command(args: argparse.Namespace) -> int:
    """Run `bicycle train`; the exit status.

    Raises:
        ValueError: on a user's mistake, with the remedy in one line.
    """
    result = run(config_of(args), args.out, show_progress=not args.quiet)
    print(json.dumps(asdict(result)))
    return 130 if result.status == "interrupted" else 0
