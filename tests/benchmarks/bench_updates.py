"""DDPG updates per second at the paper's sizes: ours, stable-baselines3, SBX, CleanRL's style.

Actor 6-400-300-3, critic 200-200, Adam, both targets followed: steps (5) to (7) of the paper's
section 4.3, from the draw out of the memory on. All contestants take turns in one process with
one thread; each turn lasts about a tenth of a second, and the medians over all turns are told.
stable-baselines3 and SBX take the action at the critic's first layer, 1 % less work than the
paper's second; everything else is the same for all. SBX compiles the updates of one call into one
program, so it is told for 1, 8 and 160 a call; compiling is left out. Each batch is
written as soon as it ends; the file keeps those that this run leaves out.

    python tests/benchmarks/bench_updates.py [--batch 64 1024] [--turns 15] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from machine import machine
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from bicycle_controller.agents import native
from bicycle_controller.agents.ddpg import Ddpg
from bicycle_controller.agents.fused import FusedDdpg
from bicycle_controller.agents.networks import Actor, Critic
from bicycle_controller.config import loading
from bicycle_controller.config.run import DdpgConfig
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.training.run_folder import origin

ACTIONS = 3
ROWS = 100_000
"""Transitions in every memory."""
TURN = 0.1
"""s that a turn lasts."""
SBX_BURSTS = (1, 8, 160)
"""Updates that SBX makes in one call."""
PEERS = (
    *("stable-baselines3", "stable-baselines3, fused Adam", "CleanRL's style"),
    *(f"SBX, {burst} a call" for burst in SBX_BURSTS),
)
"""Contestants with whom each is compared, turn by turn."""
RESULTS = Path(__file__).parent / "results" / "updates.json"

Update = Callable[[int], None]
"""Makes so many updates."""


def paper() -> DdpgConfig:
    """Tables 2 and 3."""
    config = loading.preset("paper").ddpg
    assert config is not None
    return config


def transitions() -> dict[str, np.ndarray]:
    """Return the same random transitions for all."""
    rng = np.random.default_rng(0)
    return {
        "observation": rng.normal(size=(ROWS, 6)).astype(np.float32),
        "action": rng.uniform(-1.0, 1.0, (ROWS, ACTIONS)).astype(np.float32),
        "next_observation": rng.normal(size=(ROWS, 6)).astype(np.float32),
        "reward": -rng.random(ROWS).astype(np.float32),
        "final": (rng.random(ROWS) < 0.01).astype(np.float32),
    }


def ours(backend: str, batch: int, data: dict[str, np.ndarray], burst: int = 1) -> Update:
    """This project's learner; `burst` updates from one draw."""
    config = replace(paper(), batch=batch, backend=backend)
    replay = ReplayBuffer(ROWS, ACTIONS)
    columns = [data[name] for name in ("observation", "action", "next_observation")]
    ends = [data["reward"], config.gamma * (1.0 - data["final"]), data["final"]]
    zero = np.zeros((ROWS, 2), dtype=np.float32)
    replay.add(np.concatenate([*columns, np.stack(ends, axis=1), zero], axis=1))
    agent = (Ddpg if backend == "autograd" else FusedDdpg)(config, ACTIONS, 0)

    def update(count: int) -> None:
        for _ in range(max(1, count // burst)):
            agent.update(replay, burst)

    return update


class CleanLoop:
    """One file's DDPG as CleanRL writes them: plain modules, Adam, a loop over parameters."""

    def __init__(self, batch: int, data: dict[str, np.ndarray]) -> None:
        """Make networks of the paper's sizes."""
        config = paper()
        self.batch, self.data, self.config = batch, data, config
        self.rng = np.random.default_rng(0)
        self.actor, self.actor_target = (Actor(6, config.actor_hidden, ACTIONS) for _ in "12")
        self.critic, self.critic_target = (Critic(6, config.critic_hidden, ACTIONS) for _ in "12")
        self.actor_target.load_state_dict(self.actor.state_dict())
        self.critic_target.load_state_dict(self.critic.state_dict())
        self.critic_optimiser = torch.optim.Adam(self.critic.parameters(), lr=1e-3)
        self.actor_optimiser = torch.optim.Adam(self.actor.parameters(), lr=1e-3)

    def __call__(self, count: int) -> None:
        """Make `count` updates."""
        for _ in range(count):
            self._update()

    def _update(self) -> None:
        gamma, tau = self.config.gamma, self.config.tau
        index = self.rng.integers(0, ROWS, self.batch)
        draw = {name: torch.as_tensor(values[index]) for name, values in self.data.items()}
        with torch.no_grad():
            next_action = self.actor_target(draw["next_observation"])
            value = self.critic_target(draw["next_observation"], next_action)
            target = draw["reward"] + (1.0 - draw["final"]) * gamma * value
        loss = functional.mse_loss(self.critic(draw["observation"], draw["action"]), target)
        self._step(self.critic_optimiser, loss)
        action = self.actor(draw["observation"])
        self._step(self.actor_optimiser, -self.critic(draw["observation"], action).mean())
        for slow, main in ((self.actor_target, self.actor), (self.critic_target, self.critic)):
            _follow(slow, main, tau)

    @staticmethod
    def _step(optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()


def _follow(slow: nn.Module, main: nn.Module, tau: float) -> None:
    for target, source in zip(slow.parameters(), main.parameters(), strict=True):
        target.data.copy_(tau * source.data + (1.0 - tau) * target.data)


def stable_baselines3(
    batch: int, data: dict[str, np.ndarray], kind: Any = None, fused: bool = False, burst: int = 0
) -> Update:
    """stable-baselines3's DDPG, or SBX's, as near to the paper as its options allow.

    Args:
        batch: transitions of an update.
        data: the memory.
        kind: the class; stable-baselines3's by default.
        fused: whether Adam is torch's fused one.
        burst: updates in one call; all at once by default.
    """
    import gymnasium
    from stable_baselines3 import DDPG
    from stable_baselines3.common.logger import Logger

    learner = DDPG if kind is None else kind

    class Empty(gymnasium.Env[np.ndarray, np.ndarray]):
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (6,), np.float32)
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (ACTIONS,), np.float32)

    config = paper()
    sizes = {"pi": list(config.actor_hidden), "qf": list(config.critic_hidden)}
    options = {"optimizer_kwargs": {"fused": True}} if fused else {}
    model = learner(
        "MlpPolicy",
        Empty(),
        learning_rate=config.critic_learning_rate,
        buffer_size=ROWS,
        batch_size=batch,
        tau=config.tau,
        gamma=config.gamma,
        policy_kwargs={"net_arch": sizes, **options},
        device="cpu",
        seed=0,
    )
    model.set_logger(Logger(None, []))
    memory = model.replay_buffer
    memory.observations[:, 0], memory.next_observations[:, 0] = (
        data["observation"],
        data["next_observation"],
    )
    memory.actions[:, 0], memory.rewards[:, 0] = data["action"], data["reward"]
    memory.dones[:, 0], memory.full = data["final"], True

    def update(count: int) -> None:
        size = burst or count
        for _ in range(max(1, count // size)):
            model.train(gradient_steps=size, batch_size=batch)

    return update


def contestants(batch: int) -> dict[str, Update]:
    """Return all who take part, by name."""
    data = transitions()
    found: dict[str, Update] = {}
    if native.load() is not None:
        found["ours, native"] = ours("native", batch, data)
        found["ours, native, 8 from one draw"] = ours("native", batch, data, burst=8)
    found["ours, torch by hand"] = ours("fused", batch, data)
    found["ours, autograd"] = ours("autograd", batch, data)
    found["CleanRL's style"] = CleanLoop(batch, data)
    try:
        found["stable-baselines3"] = stable_baselines3(batch, data)
        found["stable-baselines3, fused Adam"] = stable_baselines3(batch, data, fused=True)
    except ModuleNotFoundError as error:
        print(f"without stable-baselines3 ({error}): install ros2_ws/requirements/bench.lock")
    try:
        from sbx import DDPG
    except ModuleNotFoundError as error:
        print(f"without SBX ({error}): install ros2_ws/requirements/bench.lock")
        return found
    for burst in SBX_BURSTS:
        found[f"SBX, {burst} a call"] = stable_baselines3(batch, data, DDPG, burst=burst)
    return found


def rates(update: Update, count: int) -> tuple[float, float]:
    """Updates per second of processor time and of wall time."""
    wall, cpu = time.perf_counter(), time.process_time()
    update(count)
    return count / (time.process_time() - cpu), count / (time.perf_counter() - wall)


def bench(batch: int, turns: int) -> dict[str, Any]:
    """Medians over `turns` of everybody at one batch size."""
    players = contestants(batch)
    counts = {}
    for name, update in players.items():
        whole = 160 if name.endswith("160 a call") else 8
        update(whole)  # compiles, where something is
        counts[name] = max(whole, round(rates(update, 2 * whole)[0] * TURN / whole) * whole)
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in players}
    for _ in tqdm(range(turns), desc=f"batch {batch}", unit="turn", disable=None):
        for name, update in players.items():
            found[name].append(rates(update, counts[name]))
    result: dict[str, Any] = {}
    for name, pairs in found.items():
        cpu, wall = (list(column) for column in zip(*pairs, strict=True))
        row = {"updates_per_cpu_s": statistics.median(cpu), "best": max(cpu)}
        row["updates_per_wall_s"] = statistics.median(wall)
        row["samples_per_cpu_s"] = row["updates_per_cpu_s"] * batch
        for other in PEERS:
            if other in found:
                # Turn by turn, so that what else the machine did meets both.
                ratio = [
                    mine[0] / theirs[0] for mine, theirs in zip(pairs, found[other], strict=True)
                ]
                row[f"times {other}"] = statistics.median(ratio)
        result[name] = row
    return result


def table(results: dict[str, dict[str, Any]]) -> str:
    """Return the results in lines."""
    lines = []
    for batch, rows in results.items():
        lines.append(f"batch {batch:28} updates/s    best  samples/s   x SB3  x CleanRL")
        for name, row in rows.items():
            ratios = [
                row.get(f"times {n}", float("nan"))
                for n in ("stable-baselines3", "CleanRL's style")
            ]
            numbers = f"{row['updates_per_cpu_s']:9.0f} {row['best']:7.0f}"
            numbers += f" {row['samples_per_cpu_s']:10.0f} {ratios[0]:7.2f} {ratios[1]:10.2f}"
            lines.append(f"  {name:31} {numbers}")
    return "\n".join(lines)


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--batch", type=int, nargs="+", default=[64, 256, 1024])
    parser.add_argument("--turns", type=int, default=40)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    torch.set_num_threads(1)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    found = json.loads(args.out.read_text()) if args.out.exists() else {}
    for batch in args.batch:
        about = {
            "command": shlex.join(["python", *sys.argv]),
            "machine": machine("torch", "stable-baselines3", "sbx-rl", "jax"),
            "threads": torch.get_num_threads(),
            "commit": origin()["commit"],
            "turns": args.turns,
        }
        results = bench(batch, args.turns)
        print(table({str(batch): results}))
        found[f"batch {batch}"] = about | {"results": results}
        args.out.write_text(json.dumps(found, indent=2) + "\n")
    print(f"written to {args.out}")


if __name__ == "__main__":
    main()
