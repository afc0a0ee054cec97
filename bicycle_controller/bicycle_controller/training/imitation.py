"""Run of imitation: an actor rides random bicycles and learns what their teachers would do.

Dataset aggregation (Ross, Gordon and Bagnell 2011): the actor rides, each bicycle's own LQR says
what it would do in the actor's states, and the actor learns that from all states so far. What the
actor does not know of the bicycle it has to see in its past.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bicycle_controller.agents.mirrored import MirroredActor
from bicycle_controller.config import loading
from bicycle_controller.config.imitation import SCALES, ImitationConfig
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.score import Score, score
from bicycle_controller.policy.inputs import Inputs, parse, with_history
from bicycle_controller.policy.policy import Policy, PolicyInfo, save_policy
from bicycle_controller.training import online
from bicycle_controller.training.bicycle_park import Park
from bicycle_controller.training.logger import Logger, Progress, Shown
from bicycle_controller.training.run_folder import RunFolder
from bicycle_controller.training.session import Result, TrainingSession

UNMIRRORED = ("speed", "pedal_force")
"""Inputs that a mirror leaves alone; parameters of the bicycle, too."""
LEAST_RATE = 0.01
"""Share of the learning rate that is left at the end."""


def run(
    config: RunConfig,
    folder: Path,
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result[Score]:
    """Train in a new folder; arguments and errors as `online.run`."""
    return online.run(config, folder, progress, stop, Imitation)


def resume(
    folder: Path,
    overrides: Iterable[loading.Override] = (),
    progress: Shown = False,
    stop: Callable[[], bool] = lambda: False,
) -> Result[Score]:
    """Go on from the last checkpoint, to the bit; as `online.resume`."""
    return online.resume(folder, overrides, progress, stop, Imitation)


class Imitation(TrainingSession[Score]):
    """One run.

    Attributes:
        steps: control periods of all bicycles so far.
        park: the bicycles of this round; None before the first step.
    """

    score_type = Score

    def __init__(self, config: RunConfig, files: RunFolder) -> None:
        """Draw the weights."""
        assert config.imitation is not None
        super().__init__(config, files)
        torch.manual_seed(config.seed)
        self.config, self.own = config, config.imitation
        self.inputs = Inputs(inputs_of(self.own))
        self.scale = np.array([SCALES[parse(name)[0]] for name in self.inputs.names])
        fields = [parse(name)[0] for name in self.inputs.names]
        mirror = [1.0 if name in UNMIRRORED else -1.0 for name in fields]
        self.actor = MirroredActor(mirror, self.own.hidden)
        self.average = copy.deepcopy(self.actor)
        self.optimiser = torch.optim.Adam(self.actor.parameters(), self.own.rate)
        width = len(self.inputs.names) + 2
        self.rows = np.zeros((self.own.rows, width), dtype=np.float32)
        self.filled = self.steps = 0
        self.park: Park | None = None
        self._drawn_at = 0
        self._loss = (0.0, 0)

    def leave_actor(self) -> None:
        """Write it as the last policy."""
        save_policy(self.policy(), self.files.last)

    @property
    def done(self) -> int:
        """Control periods of all bicycles so far."""
        return self.steps

    @property
    def budget(self) -> int:
        """Control periods of all bicycles to be ridden."""
        return self.config.steps

    def _drawn(self) -> Park:
        """Return this round's bicycles, drawn anew where a round begins."""
        per_round = math.ceil(self.config.steps / self.own.rounds)
        if self.park is None or self.steps // per_round != self._drawn_at // per_round:
            self._drawn_at = self.steps
            self.park = self._park()
        return self.park

    def _park(self) -> Park:
        """Return the bicycles that are drawn at `_drawn_at`."""
        rng = np.random.default_rng((self.config.seed, self._drawn_at))
        return Park(self.own, self.config.bicycles, self.inputs.memory, rng)

    def step(self, log: Logger, bar: Progress) -> None:
        """Ride one control period and make one update, or more."""
        config, own, park = self.config, self.own, self._drawn()
        share = max(own.teacher_share, 1.0 - 4.0 * self.steps / config.steps)
        inputs = self.inputs.gather(park.seen, park.speed, park.past) / self.scale
        wanted = park.taught_torque()
        self._remember(inputs, wanted, park.limits)
        with torch.inference_mode():
            chosen = self.actor(torch.as_tensor(inputs, dtype=torch.float32)).numpy()
        torque = np.where(park.teacher_rides, wanted, own.torque_limit * chosen)
        park.step(torque, share)
        self.steps += config.bicycles
        self.evaluation_due = self.finished
        bar.advance(config.bicycles)
        if self.steps < config.warm_up or (self.steps // config.bicycles) % config.update_every:
            return
        before = self.updates
        for _ in range(config.updates):
            self._update(park.rng)
        if self.crossed(config.log_every, before):
            loss, count = self._loss
            self._loss = (0.0, 0)
            row = {"loss": loss / max(1, count), "teacher_share": share} | park.metrics()
            log.write("train", self.steps, self.row(row))
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
        total, count = self._loss
        self._loss = (total + float(loss.detach()), count + 1)

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
            trained=trained | self.made_by,
            inputs=self.inputs.names,
            plants=(config.physics.name,),
            speeds=own.riding.speeds,
        )
        return Policy(info, self.average.tensors())

    def score_actor(self) -> Score:
        """Return the score of its rides of the scenario on the run's bicycle."""
        config = self.config
        return score(self.policy(), config.scenario, config.physics, config.evaluation)

    def take_score(self, found: Score, log: Logger, bar: Progress) -> bool:
        """Keep the policy, which is the only one that is scored; return False."""
        self.best = found
        log.write("evaluation", self.steps, self.row(asdict(found)))
        save_policy(self.policy(), self.files.best)
        return False

    def state_dict(self) -> dict[str, Any]:
        """Return everything that future numbers depend on."""
        own = {
            "actor": self.actor.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "rows": self.rows[: self.filled],
            "filled": self.filled,
            "steps": self.steps,
            "loss": list(self._loss),
            "drawn_at": self._drawn_at,
            "park": None if self.park is None else self.park.state_dict(),
        }
        return super().state_dict() | own

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        super().load_state_dict(state)
        self.actor.load_state_dict(state["actor"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.rows[: len(state["rows"])] = state["rows"]
        self.filled, self.steps = state["filled"], state["steps"]
        self._loss = (state["loss"][0], state["loss"][1])
        self._drawn_at = state["drawn_at"]
        if state["park"] is not None:
            self.park = self._park()
            self.park.load_state_dict(state["park"])


def inputs_of(config: ImitationConfig) -> tuple[str, ...]:
    """Return the names of the actor's inputs."""
    return with_history(config.now, config.before, config.periods)
