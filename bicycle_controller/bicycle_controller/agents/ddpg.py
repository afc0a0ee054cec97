"""Deep deterministic policy gradient by autograd: the readable reference.

Equations (14) to (18) of the paper, and later extensions behind switches of `DdpgConfig`.
`fused.py` makes the same update without autograd.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from bicycle_controller.agents.answer import Answer
from bicycle_controller.agents.networks import Actor, Critic, blend, initialise
from bicycle_controller.agents.running_means import RunningMeans
from bicycle_controller.config.run import DdpgConfig
from bicycle_controller.data.replay_buffer import Batch, ReplayBuffer

LOG_EVERY = 12
"""Updates between two that are logged."""


class Ddpg:
    """Actor, critics, their targets and their optimisers.

    Attributes:
        actor: the policy.
        critics: one, or the twins.
        actor_target: slow copy of the actor.
        actor_average: running average of the actor, maintained if the config's is above 0.
        critic_targets: slow copies of the critics.
        updates: critic updates made.
        seen: number of the actor's inputs, the first of what the critics see.
    """

    backend = "autograd"

    def __init__(
        self, config: DdpgConfig, actions: int, seed: int, device: torch.device | str = "cpu"
    ) -> None:
        """Initialise the networks.

        Args:
            config: every number and switch.
            actions: numbers per action.
            seed: of initialisation, draws from the memory and smoothing noise.
            device: of networks and updates.
        """
        self.config, self.device, self.updates = config, torch.device(device), 0
        start = torch.Generator().manual_seed(seed)
        self.seen = len(config.inputs)
        self.actor = Actor(
            len(config.inputs),
            config.actor_hidden,
            actions,
            config.actor_layer_norm,
            config.symmetric_actor,
            config.actor_mirror,
        )
        self.critics = nn.ModuleList(
            Critic(
                len(config.critic_scale),
                config.critic_hidden,
                actions,
                config.action_layer,
                config.critic_layer_norm,
            )
            for _ in range(config.critics)
        )
        for network in (self.actor, *self.critics):
            initialise(network, config.initialisation, start)
            network.to(self.device)
        self.actor_target = copy.deepcopy(self.actor).requires_grad_(False)
        self.critic_targets = copy.deepcopy(self.critics).requires_grad_(False)
        self.actor_average = copy.deepcopy(self.actor_target)
        actor, critics = self.actor.parameters(), self.critics.parameters()
        # Not typed as Adam: the fused learner has its own optimiser.
        self.actor_optimiser: Any = torch.optim.Adam(actor, config.actor_learning_rate, fused=True)
        self.critic_optimiser: Any = torch.optim.Adam(
            critics, config.critic_learning_rate, fused=True
        )
        self.generator = torch.Generator(self.device).manual_seed(seed + 1)
        self.scale = torch.tensor(config.critic_scale, device=self.device)
        self.notes = RunningMeans()

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return normalised actions (N, actions) for raw observations (N, seen), without noise."""
        return self._answer(observation)

    @cached_property
    def _answer(self) -> Answer:
        return Answer(self.actor, self.scale[: self.seen])

    @property
    def deployed(self) -> Actor:
        """Policy to score and keep: the actor, or its running average."""
        return self.actor_average if self.config.actor_average > 0 else self.actor

    def anneal(self, progress: float) -> None:
        """Set the learning rates for a run of which the share `progress` is done."""
        config = self.config
        share = 1.0 - (1.0 - config.learning_rate_end) * min(progress, 1.0)
        self._set_rates(share * config.actor_learning_rate, share * config.critic_learning_rate)

    def _set_rates(self, actor: float, critic: float) -> None:
        for optimiser, rate in ((self.actor_optimiser, actor), (self.critic_optimiser, critic)):
            for group in optimiser.param_groups:
                group["lr"] = rate

    @property
    def logs(self) -> bool:
        """True if this update is logged; to log every one would cost too much time."""
        return self.updates % LOG_EVERY < self.config.actor_every

    def update(self, replay: ReplayBuffer, count: int) -> None:
        """Make `count` updates from one draw of the memory."""
        size = self.config.batch
        drawn = self._prepared(replay.sample(count * size, self.generator))
        with flushed_denormals():
            for batch in drawn.parts(size):
                self._learn(batch)

    def update_on(self, batch: Batch) -> None:
        """Make one update from `batch`, as drawn from the memory."""
        self._learn(self._prepared(batch))

    def _learn(self, batch: Batch) -> None:
        """Make steps (5) to (7) of section 4.3 with a scaled batch."""
        self._update_critics(batch, self.targets(batch))
        if (self.updates + 1) % self.config.actor_every == 0:
            self._update_actor(batch)
            self._update_targets()
            self._update_average()
        self.updates += 1

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Return the critics' targets y (B,), equation (15), for a scaled batch."""
        action = self._smoothed(self.actor_target(batch.next_observation[:, : self.seen]))
        values = [critic(batch.next_observation, action) for critic in self.critic_targets]
        target = batch.reward + batch.discount * torch.stack(values).amin(dim=0)
        return target.clamp(self.config.value_min, 0.0) if self.config.bound_values else target

    def _smoothed(self, action: Tensor) -> Tensor:
        """Return the target's action with TD3's clipped noise."""
        if self.config.smoothing == 0:
            return action
        return (action + self._smoothing(action.shape)).clamp(-1.0, 1.0)

    def _smoothing(self, shape: torch.Size) -> Tensor:
        """Draw that noise."""
        config = self.config
        noise = torch.randn(shape, generator=self.generator, device=self.device)
        return (noise * config.smoothing).clamp(-config.smoothing_clip, config.smoothing_clip)

    def _prepared(self, batch: Batch) -> Batch:
        """Return the batch with scaled observations and rewards, half of it mirrored if asked."""
        observation = batch.observation / self.scale
        next_observation = batch.next_observation / self.scale
        action, expert_action = batch.action, batch.expert_action
        if self.config.mirror:
            sign = self._signs(len(action))
            sides = torch.where(sign < 0, self.actor.mirror, torch.ones_like(self.actor.mirror))
            observation[:, : self.seen] *= sides
            next_observation[:, : self.seen] *= sides
            # Torque and displacement change sign, the pedal force does not.
            action = torch.cat([action[:, :2] * sign, action[:, 2:]], dim=1)
            if expert_action is not None:
                expert_action = torch.cat(
                    [expert_action[:, :2] * sign, expert_action[:, 2:]], dim=1
                )
        rest = (batch.terminated, batch.truncated, batch.fallen)
        reward = batch.reward * self.config.reward_scale
        return Batch(
            observation, action, next_observation, reward, batch.discount, *rest, expert_action
        )

    def _signs(self, count: int) -> Tensor:
        """Draw which transitions to mirror: (count, 1), -1 for those, 1 for the others."""
        size = (count, 1)
        sign = torch.randint(0, 2, size, generator=self.generator, device=self.device)
        return (2 * sign - 1).to(torch.float32)

    def _wanted(self, batch: Batch) -> Tensor:
        """Return the actions that imitation aims at, (B, actions)."""
        if self.config.bc_to == "recorded":
            return batch.action
        assert batch.expert_action is not None
        return batch.expert_action

    def _update_critics(self, batch: Batch, target: Tensor) -> None:
        """Equation (14): the squared distance of Q to its target."""
        values = [critic(batch.observation, batch.action) for critic in self.critics]
        losses = [self._loss(value, target) for value in values]
        loss = torch.stack(losses).sum()
        self.critic_optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for critic in self.critics:
            self._clip(critic)
        self.critic_optimiser.step()
        if self.logs:
            self.notes.add(critic_loss=losses[0])
            self.notes.add(q_data=values[0].mean())

    def _loss(self, value: Tensor, target: Tensor) -> Tensor:
        if self.config.huber > 0:
            return functional.huber_loss(value, target, delta=self.config.huber)
        return functional.mse_loss(value, target)

    def _update_actor(self, batch: Batch) -> None:
        """Equation (17): ascend the first critic's gradient; bc_weight stays near the data."""
        config = self.config
        self.critics.requires_grad_(False)
        raw = self.actor.raw(batch.observation[:, : self.seen])
        action = torch.tanh(raw)
        value = self.critics[0](batch.observation, action)
        loss = -value.mean()
        if config.bc_weight > 0:
            loss = loss * (config.bc_alpha / value.detach().abs().mean().clamp_min(1e-6))
            loss = loss + config.bc_weight * functional.mse_loss(action, self._wanted(batch))
        if config.saturation_penalty > 0:
            loss = loss + config.saturation_penalty * raw.square().mean()
        self.actor_optimiser.zero_grad()
        loss.backward()
        self._clip(self.actor)
        self.actor_optimiser.step()
        self.critics.requires_grad_(True)
        if self.logs:
            self.notes.add(q_policy=value.mean())

    @torch.no_grad()
    def _update_targets(self) -> None:
        """Update the target networks by equations (16) and (18)."""
        blend(
            [self.actor_target, self.critic_targets], [self.actor, self.critics], self.config.tau
        )

    @torch.no_grad()
    def _update_average(self) -> None:
        """Update the averaged actor, as (18) with its own share."""
        if self.config.actor_average > 0:
            blend([self.actor_average], [self.actor], self.config.actor_average)

    def _clip(self, network: nn.Module) -> None:
        if self.config.grad_clip > 0:
            nn.utils.clip_grad_norm_(network.parameters(), self.config.grad_clip)

    def metrics(self) -> dict[str, float]:
        """Return the means of the losses and values since the last call."""
        return self.notes.take()

    def state_dict(self) -> dict[str, Any]:
        """Return the networks, targets, optimisers, generator and counter."""
        networks = ("actor", "critics", "actor_target", "critic_targets", "actor_average")
        parts = (*networks, "actor_optimiser", "critic_optimiser", "notes")
        state = {name: getattr(self, name).state_dict() for name in parts}
        return state | {"generator": self.generator.get_state(), "updates": self.updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        for name, value in state.items():
            if name == "generator":
                self.generator.set_state(value.cpu())
            elif name == "updates":
                self.updates = int(value)
            else:
                getattr(self, name).load_state_dict(value)


@contextmanager
def flushed_denormals() -> Iterator[None]:
    """Treat numbers below 1e-38 as zero in this context.

    Adam's moments of units without a gradient decay to denormals, which double its time.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
