"""Run of imitation: an actor rides random bicycles and learns what their teachers would do.

Dataset aggregation (Ross, Gordon and Bagnell 2011): the actor rides, each bicycle's own LQR says
what it would do in the actor's states, and the actor learns that from all states so far. What the
actor does not know of the bicycle it has to see in its past.
"""

from __future__ import annotations

import copy
import math
import re
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bicycle_common.signals import InterruptError, StopRequest
from bicycle_controller.agents.mirrored import MirroredActor
from bicycle_controller.config import loading
from bicycle_controller.config.imitation import SCALES, ImitationConfig
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.score import Score, score
from bicycle_controller.policy.inputs import Inputs, parse, with_history
from bicycle_controller.policy.policy import Policy, PolicyInfo, save_policy
from bicycle_controller.training import checkpoint, online
from bicycle_controller.training.bicycle_park import Park
from bicycle_controller.training.logger import Logger, Progress, Shown
from bicycle_controller.training.online import Result
from bicycle_controller.training.run_folder import RunFolder, origin

UNMIRRORED = ("speed", "pedal_force")
"""Inputs that a mirror leaves alone; parameters of the bicycle, too."""
LEAST_RATE = 0.01
"""Share of the learning rate that is left at the end."""


def run(
    config: RunConfig,
    folder: Path,
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result:
    """Train in a new folder; arguments and errors as `online.run`."""
    return online.run(config, folder, progress, stop, Imitation)


def resume(
    folder: Path,
    overrides: Iterable[loading.Override] = (),
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result:
    """Go on from the last checkpoint, with newly drawn bicycles; as `online.resume`."""
    return online.resume(folder, overrides, progress, stop, Imitation)


class Imitation:
    """One run.

    Attributes:
        steps: control periods of all bicycles so far.
        updates: updates so far.
    """

    def __init__(self, config: RunConfig, files: RunFolder) -> None:
        """Draw the weights."""
        assert config.imitation is not None
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        self.config, self.files, self.own = config, files, config.imitation
        self.inputs = Inputs(inputs_of(self.own))
        self.scale = np.array([SCALES[parse(name)[0]] for name in self.inputs.names])
        fields = [parse(name)[0] for name in self.inputs.names]
        mirror = [1.0 if name in UNMIRRORED else -1.0 for name in fields]
        self.actor = MirroredActor(mirror, self.own.hidden)
        self.average = copy.deepcopy(self.actor)
        self.optimiser = torch.optim.Adam(self.actor.parameters(), self.own.rate)
        width = len(self.inputs.names) + 2
        self.rows = np.zeros((self.own.rows, width), dtype=np.float32)
        self.filled = self.steps = self.updates = 0
        self.best: Score | None = None
        self.log_bytes = 0
        self._origin, self._spent = origin(), (0.0, 0.0)
        self._loss = [0.0, 0]

    def train(self, progress: Shown, stop: Callable[[], bool]) -> Result:
        """Train until the steps are made or a stop is requested."""
        config = self.config
        self._began = time.monotonic(), time.process_time()
        status, saved = "finished", time.monotonic()
        per_round = math.ceil(config.steps / self.own.rounds)
        park, drawn = self._park(), self.steps // per_round
        log = Logger(self.files.path, self.log_bytes, self.steps, config.tensorboard)
        with log, Progress(config.steps, self.steps, progress) as bar, StopRequest() as interrupt:
            while self.steps < config.steps:
                number = self.steps // per_round
                if number != drawn:
                    drawn, park = number, self._park()
                self._step(park, log, bar)
                if interrupt.signal or stop():
                    status = "interrupted"
                    break
                if time.monotonic() - saved >= config.save_every:
                    self._save(log)
                    saved = time.monotonic()
            policy = self.policy()
            save_policy(policy, self.files.last)
            if status == "finished":
                self._score(policy, log, interrupt)
            self._save(log)
        wall, cpu = self._time()
        return Result(status, interrupt.signal, self.steps, self.updates, self.best, wall, cpu)

    def _park(self) -> Park:
        """Return newly drawn bicycles."""
        rng = np.random.default_rng((self.config.seed, self.steps))
        return Park(self.own, self.config.bicycles, self.inputs.memory, rng)

    def _step(self, park: Park, log: Logger, bar: Progress) -> None:
        """Ride one control period and make one update, or more."""
        config, own = self.config, self.own
        share = max(own.teacher_share, 1.0 - 4.0 * self.steps / config.steps)
        inputs = self.inputs.gather(park.seen, park.speed, park.past) / self.scale
        wanted = park.taught_torque()
        self._remember(inputs, wanted, park.limits)
        with torch.inference_mode():
            chosen = self.actor(torch.as_tensor(inputs, dtype=torch.float32)).numpy()
        torque = np.where(park.teacher_rides, wanted, own.torque_limit * chosen)
        park.step(torque, share)
        self.steps += config.bicycles
        bar.advance(config.bicycles)
        if self.steps < config.warm_up or (self.steps // config.bicycles) % config.update_every:
            return
        before = self.updates
        for _ in range(config.updates):
            self._update(park.rng)
        if self.updates // config.log_every > before // config.log_every:
            loss, count = self._loss
            self._loss = [0.0, 0]
            row: dict[str, float] = {
                "loss": loss / max(1, count),
                "teacher_share": share,
            } | park.metrics()
            wall, cpu = self._time()
            log.write(
                "train", self.steps, {"updates": self.updates, **row, "wall_s": wall, "cpu_s": cpu}
            )
            bar.show(updates=self.updates, loss=row["loss"], falls=row["fall_share"])

    def _remember(self, inputs: np.ndarray, wanted: np.ndarray, limits: np.ndarray) -> None:
        """Store states with the teachers' answers; the oldest are forgotten."""
        rows = np.column_stack([inputs, wanted, limits])
        places = (self.filled + np.arange(len(rows))) % self.own.rows
        self.rows[places] = rows
        self.filled += len(rows)

    def _update(self, rng: np.random.Generator) -> None:
        """Make one update from a batch of the stored states."""
        own = self.own
        done = min(1.0, self.steps / self.config.steps)
        rate = LEAST_RATE + (1.0 - LEAST_RATE) * 0.5 * (1.0 + math.cos(math.pi * done))
        for group in self.optimiser.param_groups:
            group["lr"] = own.rate * rate
        index = rng.integers(0, min(self.filled, own.rows), own.batch)
        rows = torch.from_numpy(self.rows[index])
        limits = rows[:, -1]
        torque = own.torque_limit * self.actor(rows[:, :-2])
        torque = torch.maximum(torch.minimum(torque, limits), -limits)
        error = torch.asinh(torque / own.fine) - torch.asinh(rows[:, -2] / own.fine)
        loss = torch.nn.functional.smooth_l1_loss(error, torch.zeros_like(error))
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.actor.parameters(), 1.0)
        self.optimiser.step()
        self.updates += 1
        keep = min(own.average, (1.0 + self.updates) / (10.0 + self.updates))
        with torch.no_grad():
            for mean, value in zip(
                self.average.parameters(), self.actor.parameters(), strict=True
            ):
                mean.lerp_(value, 1.0 - keep)
        self._loss[0] += float(loss.detach())
        self._loss[1] += 1

    def policy(self) -> Policy:
        """Return the averaged actor with its metadata."""
        config, own = self.config, self.own
        name = f"{config.preset or 'imitation'}-{config.seed}"
        trained: dict[str, Any] = {
            "algorithm": "imitation",
            "teachers": "each random bicycle's own LQR",
            "preset": config.preset,
            "seed": config.seed,
            "steps": self.steps,
            "updates": self.updates,
        }
        info = PolicyInfo(
            name=re.sub(r"[^A-Za-z0-9._-]", "-", name)[:64],
            scenario=config.scenario,
            plant=config.physics,
            observation_scale=tuple(self.scale.tolist()),
            action_limits=(own.torque_limit, 0.0, 0.0),
            trained=trained | {key: self._origin[key] for key in ("command", "commit", "version")},
            inputs=self.inputs.names,
            plants=(config.physics.name,),
            speeds=own.riding.speeds,
        )
        return Policy(info, self.average.tensors())

    def _score(self, policy: Policy, log: Logger, interrupt: StopRequest) -> None:
        """Ride the scenario on the run's bicycle, and keep the policy as the best."""
        config = self.config
        try:
            with interrupt.at_once():
                found = score(policy, config.scenario, config.physics, config.evaluation)
        except InterruptError:
            return
        self.best = found
        log.write("evaluation", self.steps, asdict(found))
        save_policy(policy, self.files.best)

    def _time(self) -> tuple[float, float]:
        """Return wall and processor time in s, summed over all calls of the run."""
        wall, cpu = (
            now() - start
            for now, start in zip((time.monotonic, time.process_time), self._began, strict=True)
        )
        return self._spent[0] + wall, self._spent[1] + cpu

    def _save(self, log: Logger) -> None:
        """Write the checkpoint."""
        self.log_bytes = log.sync()
        checkpoint.save(self.files.checkpoint, self.state_dict())

    def state_dict(self) -> dict[str, Any]:
        """Return the state that a resumed run needs: all but the bicycles and visited states."""
        return {
            "actor": self.actor.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "rows": self.rows[: self.filled],
            "filled": self.filled,
            "steps": self.steps,
            "updates": self.updates,
            "log_bytes": self.log_bytes,
            "spent": list(self._time()),
            "origin": self._origin,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        self.actor.load_state_dict(state["actor"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.rows[: len(state["rows"])] = state["rows"]
        self.filled, self.steps, self.updates = state["filled"], state["steps"], state["updates"]
        self.log_bytes = state["log_bytes"]
        self._spent = (state["spent"][0], state["spent"][1])


def inputs_of(config: ImitationConfig) -> tuple[str, ...]:
    """Return the names of the actor's inputs."""
    return with_history(config.now, config.before, config.periods)
