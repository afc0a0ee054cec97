"""Update of `ddpg.py` with hand-written gradients: the same numbers in a fraction of the time.

All parameters, gradients, moments and targets are flat vectors with named views that need no
gradient, and every large result is written into preallocated memory. Every switch of
`DdpgConfig` is supported; a test compares it with the autograd reference. Where a compiler is at
hand, `native_update.py` makes each update in one call; else torch makes it here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bicycle_controller.agents.ddpg import Ddpg, flushed_denormals
from bicycle_controller.agents.fused_net import Flat, FusedNet, flat_views
from bicycle_controller.agents.native import NativeAnswer, load
from bicycle_controller.agents.native_update import Moved, NativeUpdate, Networks
from bicycle_controller.agents.networks import Critic, folded, unfolded
from bicycle_controller.config.run import DdpgConfig
from bicycle_controller.data.replay_buffer import Batch, ReplayBuffer

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8
"""Adam's defaults."""
MANY = 32
"""Bicycles from which on the native library answers quicker than torch."""


class FlatAdam:
    """Adam on a slice of a flat vector, in one fused call."""

    def __init__(
        self,
        networks: Sequence[nn.Module],
        values: Tensor,
        gradient: Tensor,
        turned: bool,
        like: torch.optim.Adam,
    ) -> None:
        """Start with zero moments.

        Args:
            networks: owners of the parameters in `values`.
            values: flat, changed by `step`.
            gradient: flat, read by `step`.
            turned: their memory layout, see `fused_net`.
            like: torch's Adam, for the learning rate and the format of the saved state.
        """
        self.values, self.gradient = values, gradient
        self._groups = like.state_dict()["param_groups"]
        self.rate = float(self._groups[0]["lr"])
        self.mean, self.square = torch.zeros_like(values), torch.zeros_like(values)
        self.count = torch.zeros((), device=values.device)
        both = (flat_views(networks, moment, turned) for moment in (self.mean, self.square))
        self._moments = list(zip(*both, strict=True))

    def step(self) -> None:
        """Move the values against the gradient."""
        self.count += 1
        torch._fused_adam_(
            [self.values],
            [self.gradient],
            [self.mean],
            [self.square],
            [],
            [self.count],
            lr=self.rate,
            beta1=BETA_1,
            beta2=BETA_2,
            weight_decay=0.0,
            eps=EPSILON,
            amsgrad=False,
            maximize=False,
        )

    def moved(self, slow: Tensor) -> Moved:
        """Return its vectors and that of the target networks' parameters."""
        return Moved(self.values, self.gradient, self.mean, self.square, slow)

    def state_dict(self) -> dict[str, Any]:
        """Return the state in the format of torch's Adam, so that any backend can load it."""
        state = {
            index: {"step": self.count.clone(), "exp_avg": mean, "exp_avg_sq": square}
            for index, (mean, square) in enumerate(self._moments)
        }
        return {"state": state, "param_groups": self._groups}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        for index, found in state["state"].items():
            mean, square = self._moments[index]
            mean.copy_(found["exp_avg"])
            square.copy_(found["exp_avg_sq"])
            self.count.copy_(found["step"])


def _use_native(config: DdpgConfig, device: torch.device) -> bool:
    """Return True if `native.cpp` can be used: it supports one thread of the CPU only."""
    if config.backend == "native" and (device.type != "cpu" or load() is None):
        raise ValueError("ddpg.backend=native needs the CPU and a C++ compiler: choose auto")
    plain = config.backend == "auto" and device.type == "cpu" and torch.get_num_threads() == 1
    return config.backend == "native" or (plain and load() is not None)


class FusedDdpg(Ddpg):
    """`Ddpg` without autograd; networks and checkpoints have the same interface."""

    def __init__(
        self, config: DdpgConfig, actions: int, seed: int, device: torch.device | str = "cpu"
    ) -> None:
        """Create the same networks as `Ddpg` and move them into flat memory."""
        super().__init__(config, actions, seed, device)
        native = _use_native(config, self.device)
        self.backend = "native" if native else "fused"
        main = Flat([self.actor, *self.critics], not native)
        slow = Flat([self.actor_target, *self.critic_targets], not native)
        self._main, self._slow = main.values, slow.values
        gradient = torch.zeros_like(main.values)
        first = main.sizes[0]
        critics = [critic for critic in self.critics if isinstance(critic, Critic)]
        targets = [critic for critic in self.critic_targets if isinstance(critic, Critic)]
        own, others = slice(None, first), slice(first, None)
        self.actor_optimiser = FlatAdam(
            [self.actor], main.values[own], gradient[own], not native, self.actor_optimiser
        )
        self.critic_optimiser = FlatAdam(
            critics, main.values[others], gradient[others], not native, self.critic_optimiser
        )
        self._whole: NativeUpdate | None = None
        self._native_answer: NativeAnswer | None = None
        if native:
            networks = Networks(
                self.actor, critics, self.actor_target, targets, self.actor_average
            )
            acting = self.actor_optimiser.moved(slow.values[own])
            judging = self.critic_optimiser.moved(slow.values[others])
            self._whole = NativeUpdate(config, networks, acting, judging, self.scale)
            return
        batch = config.batch
        mine, *parts = torch.split(gradient, main.sizes)
        rows = 2 * batch if config.symmetric_actor else batch
        self._actor = FusedNet(self.actor, rows, mine)
        self._actor_target = FusedNet(self.actor_target, rows, None)
        pairs = zip(critics, parts, strict=True)
        self._critics = [FusedNet(critic, batch, part) for critic, part in pairs]
        self._critic_targets = [FusedNet(critic, batch, None) for critic in targets]
        self._minus_mean = torch.full((batch, 1), -1.0 / batch, device=self.device)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return normalised actions (N, actions) for raw observations (N, seen), without noise."""
        count = len(observation)
        if self._whole is None or count < MANY:
            return super().act(observation)
        if self._native_answer is None or self._native_answer.count != count:
            self._native_answer = NativeAnswer(self.actor, self.scale[: self.seen], count)
        return self._native_answer(observation)

    def update(self, replay: ReplayBuffer, count: int) -> None:
        """Make `count` updates from one draw of the memory."""
        if self._whole is None:
            super().update(replay, count)
            return
        index = replay.draw(count * self.config.batch, self.generator)
        with flushed_denormals():
            self._update_whole(self._whole, replay.table, index)

    def update_on(self, batch: Batch) -> None:
        """Make one update from `batch`, as drawn from the memory.

        Raises:
            ValueError: if it has not the configuration's size.
        """
        if self._whole is None:
            super().update_on(batch)
            return
        if len(batch.reward) != self.config.batch:
            raise ValueError(f"a batch has {self.config.batch} rows, not {len(batch.reward)}")
        columns = [column for column in vars(batch).values() if column is not None]
        table = torch.cat([column.view(len(batch.reward), -1) for column in columns], dim=1)
        self._update_whole(self._whole, table.contiguous(), torch.arange(len(table)))

    def _update_whole(self, whole: NativeUpdate, table: Tensor, index: Tensor) -> None:
        """Make an update from each B of the rows `index` of the memory's `table`."""
        size, config = self.config.batch, self.config
        signs = self._signs(len(index)) if config.mirror else None
        for first in range(0, len(index), size):
            rows = slice(first, first + size)
            acts = (self.updates + 1) % config.actor_every == 0
            noise = None
            if config.smoothing > 0:
                noise = self._smoothing(torch.Size((size, self._actions)))
            self.critic_optimiser.count += 1
            self.actor_optimiser.count += acts
            optimisers = self.critic_optimiser, self.actor_optimiser
            rates = optimisers[0].rate, optimisers[1].rate
            steps = int(optimisers[0].count), int(optimisers[1].count)
            sign = None if signs is None else signs[rows]
            whole(table, index[rows], sign, noise, rates, steps, acts)
            if self.logs:
                loss, data, policy = map(torch.tensor, whole.notes)
                self.notes.add(critic_loss=loss, q_data=data)
                if acts:
                    self.notes.add(q_policy=policy)
            self.updates += 1

    @property
    def _actions(self) -> int:
        return self.actor.layers[-1].out_features  # type: ignore[return-value]

    def _set_rates(self, actor: float, critic: float) -> None:
        self.actor_optimiser.rate, self.critic_optimiser.rate = actor, critic

    def targets(self, batch: Batch) -> Tensor:
        """Return the critics' targets y (B,), equation (15), for a scaled batch."""
        if self._whole is not None:
            return super().targets(batch)
        seen = batch.next_observation[:, : self.seen]
        action = self._smoothed(self._raw(self._actor_target, seen).tanh())
        values = [net.forward(batch.next_observation, action) for net in self._critic_targets]
        least = values[0] if len(values) == 1 else torch.minimum(*values)
        target = torch.addcmul(batch.reward, batch.discount, least.squeeze(1))
        return target.clamp_(self.config.value_min, 0.0) if self.config.bound_values else target

    def _raw(self, actor: FusedNet, seen: Tensor) -> Tensor:
        """Return the input of the actor's tanh, (B, actions), for scaled (B, seen)."""
        if not self.config.symmetric_actor:
            return actor.forward(seen)
        return folded(actor.forward(self.actor.both(seen)))

    def _update_critics(self, batch: Batch, target: Tensor) -> None:
        """Equation (14); the loss's gradient in Q is 2 (Q - y) / B, bounded by Huber's."""
        config, size = self.config, len(target)
        for index, net in enumerate(self._critics):
            value = net.forward(batch.observation, batch.action)
            error = value - target.unsqueeze(1)
            if self.logs and index == 0:
                self.notes.add(critic_loss=self._loss(value.squeeze(1), target))
                self.notes.add(q_data=value.mean())
            if config.huber > 0:
                error.clamp_(-config.huber, config.huber).mul_(1.0 / size)
            else:
                error.mul_(2.0 / size)
            net.backward(error)
            self._clip_gradient(net)
        self.critic_optimiser.step()

    def _update_actor(self, batch: Batch) -> None:
        """Equation (17): the critic's gradient in the action, through tanh into the actor."""
        config = self.config
        raw = self._raw(self._actor, batch.observation[:, : self.seen])
        action = torch.tanh(raw)
        value = self._critics[0].forward(batch.observation, action)
        slope = self._critics[0].action_slope(self._minus_mean)
        if config.bc_weight > 0:
            slope.mul_(config.bc_alpha / value.abs().mean().clamp_min(1e-6))
            slope.add_(action - self._wanted(batch), alpha=2.0 * config.bc_weight / action.numel())
        slope.mul_(1.0 - action * action)
        if config.saturation_penalty > 0:
            slope.add_(raw, alpha=2.0 * config.saturation_penalty / raw.numel())
        if self.logs:
            self.notes.add(q_policy=value.mean())
        self._actor.backward(unfolded(slope) if config.symmetric_actor else slope)
        self._clip_gradient(self._actor)
        self.actor_optimiser.step()

    def _update_targets(self) -> None:
        """Update the target networks by equations (16) and (18)."""
        self._slow.lerp_(self._main, self.config.tau)

    def _clip_gradient(self, net: FusedNet) -> None:
        if self.config.grad_clip > 0 and net.gradient is not None:
            norm = net.gradient.norm()
            net.gradient.mul_((self.config.grad_clip / (norm + 1e-6)).clamp(max=1.0))
