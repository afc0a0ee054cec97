"""Deep deterministic policy gradient by autograd: the readable reference.

Equations (14) to (18) of the paper, and behind switches of `DdpgConfig` what was found since.
`fused.py` makes the same update without autograd.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from bicycle_controller.config import DdpgConfig
from bicycle_controller.networks import Actor, Critic, initialise
from bicycle_controller.replay import OBSERVATIONS, Batch, Replay


class Ddpg:
    """Actor, critics, their targets and their optimisers.

    Attributes:
        actor: the policy.
        critics: one, or the twins.
        actor_target: slow copy of the actor.
        critic_targets: slow copies of the critics.
        updates: critic updates made.
    """

    def __init__(
        self, config: DdpgConfig, actions: int, seed: int, device: torch.device | str = "cpu"
    ) -> None:
        """Draw the networks.

        Args:
            config: every number and switch.
            actions: numbers per action.
            seed: of the networks' start, of the draws from the memory and of smoothing noise.
            device: where networks and updates live.
        """
        self.config, self.device, self.updates = config, torch.device(device), 0
        start = torch.Generator().manual_seed(seed)
        self.actor = Actor(OBSERVATIONS, config.actor_hidden, actions, config.actor_layer_norm)
        self.critics = nn.ModuleList(
            Critic(
                OBSERVATIONS,
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
        self.actor_optimiser = torch.optim.Adam(
            self.actor.parameters(), config.actor_learning_rate, fused=True
        )
        self.critic_optimiser = torch.optim.Adam(
            self.critics.parameters(), config.critic_learning_rate, fused=True
        )
        self.generator = torch.Generator(self.device).manual_seed(seed + 1)
        self.scale = torch.tensor(config.observation_scale, device=self.device)
        self._sums: dict[str, Tensor] = {}
        self._counts: dict[str, int] = {}

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """Normalised actions (N, actions) for raw observations (N, 6), without noise."""
        raw = torch.as_tensor(observation, dtype=torch.float32, device=self.device)
        action: np.ndarray = self.actor(raw / self.scale).cpu().numpy()
        return action

    def update(self, replay: Replay, count: int) -> None:
        """Make `count` updates from one draw out of the memory."""
        size = self.config.batch
        drawn = replay.sample(count * size, self.generator)
        for index in range(count):
            rows = slice(index * size, (index + 1) * size)
            self.update_on(Batch(*(column[rows] for column in vars(drawn).values())))

    def update_on(self, batch: Batch) -> None:
        """Make one update from `batch`: steps (5) to (7) of section 4.3."""
        config = self.config
        batch = self._prepared(batch)
        self._update_critics(batch, self.targets(batch))
        self.updates += 1
        if self.updates % config.actor_every == 0:
            self._update_actor(batch)
            self._update_targets()

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """The critics' targets y (B,), equation (15), for a scaled batch."""
        config = self.config
        action = self.actor_target(batch.next_observation)
        if config.smoothing > 0:
            noise = torch.randn(action.shape, generator=self.generator, device=self.device)
            noise = (noise * config.smoothing).clamp(-config.smoothing_clip, config.smoothing_clip)
            action = (action + noise).clamp(-1.0, 1.0)
        values = [critic(batch.next_observation, action) for critic in self.critic_targets]
        target = batch.reward + batch.discount * torch.stack(values).amin(dim=0)
        if config.bound_values:
            target = target.clamp(config.value_min, 0.0)
        return target

    def _prepared(self, batch: Batch) -> Batch:
        """The batch with scaled observations and rewards, half of it mirrored if so wished."""
        observation = batch.observation / self.scale
        next_observation = batch.next_observation / self.scale
        action = batch.action
        if self.config.mirror:
            size = (len(action), 1)
            sign = torch.randint(0, 2, size, generator=self.generator, device=self.device)
            sign = (2 * sign - 1).to(action.dtype)
            observation, next_observation = observation * sign, next_observation * sign
            # Torque and displacement change sides, the pedal force does not.
            action = torch.cat([action[:, :2] * sign, action[:, 2:]], dim=1)
        rest = (batch.terminated, batch.truncated, batch.fallen)
        reward = batch.reward * self.config.reward_scale
        return Batch(observation, action, next_observation, reward, batch.discount, *rest)

    def _update_critics(self, batch: Batch, target: Tensor) -> None:
        """Equation (14): the squared distance of Q to its target."""
        config = self.config
        values = [critic(batch.observation, batch.action) for critic in self.critics]
        if config.huber > 0:
            loss = sum(functional.huber_loss(q, target, delta=config.huber) for q in values)
        else:
            loss = sum(functional.mse_loss(q, target) for q in values)
        assert isinstance(loss, Tensor)
        self.critic_optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for critic in self.critics:
            self._clip(critic)
        self.critic_optimiser.step()
        self._note("critic_loss", loss)
        self._note("q_data", values[0].mean())

    def _update_actor(self, batch: Batch) -> None:
        """Equation (17): up the first critic's slope; with bc_weight not far from the data."""
        config = self.config
        self.critics.requires_grad_(False)
        raw = self.actor.raw(batch.observation)
        action = torch.tanh(raw)
        value = self.critics[0](batch.observation, action)
        loss = -value.mean()
        if config.bc_weight > 0:
            loss = loss * (config.bc_alpha / value.detach().abs().mean().clamp_min(1e-6))
            loss = loss + config.bc_weight * functional.mse_loss(action, batch.action)
        if config.saturation_penalty > 0:
            loss = loss + config.saturation_penalty * raw.square().mean()
        self.actor_optimiser.zero_grad()
        loss.backward()
        self._clip(self.actor)
        self.actor_optimiser.step()
        self.critics.requires_grad_(True)
        self._note("q_policy", value.mean())

    @torch.no_grad()
    def _update_targets(self) -> None:
        """Equations (16) and (18)."""
        slow: list[Tensor] = [*self.actor_target.parameters(), *self.critic_targets.parameters()]
        main: list[Tensor] = [*self.actor.parameters(), *self.critics.parameters()]
        torch._foreach_lerp_(slow, main, self.config.tau)

    def _clip(self, network: nn.Module) -> None:
        if self.config.grad_clip > 0:
            nn.utils.clip_grad_norm_(network.parameters(), self.config.grad_clip)

    def _note(self, name: str, value: Tensor) -> None:
        """Add to a mean without waiting for the device."""
        old = self._sums.get(name)
        self._sums[name] = value.detach() if old is None else old + value.detach()
        self._counts[name] = self._counts.get(name, 0) + 1

    def metrics(self) -> dict[str, float]:
        """Means of the losses and values since the last call."""
        means = {name: float(total) / self._counts[name] for name, total in self._sums.items()}
        self._sums, self._counts = {}, {}
        return means

    def state_dict(self) -> dict[str, Any]:
        """Networks, targets, optimisers, generator and counter."""
        networks = ("actor", "critics", "actor_target", "critic_targets")
        optimisers = ("actor_optimiser", "critic_optimiser")
        state = {name: getattr(self, name).state_dict() for name in (*networks, *optimisers)}
        return state | {"generator": self.generator.get_state(), "updates": self.updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state`, to the bit."""
        for name, value in state.items():
            if name == "generator":
                self.generator.set_state(value.cpu())
            elif name == "updates":
                self.updates = int(value)
            else:
                getattr(self, name).load_state_dict(value)
