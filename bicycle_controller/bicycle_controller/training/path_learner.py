"""DDPG for followers of paths, guided by the classical one.

The actor first imitates the classical follower on the states that it meets itself (Ross et al.
2011, DAgger); then twin critics (TD3) improve it, held near the teacher as in the presets
`guided`. Its update is not `agents.ddpg`'s: the first weights, the smoothing and the loss are its
own, and the shipped follower is made of these numbers.
"""

from __future__ import annotations

import copy
import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from bicycle_controller.agents.networks import blend
from bicycle_controller.control.learned_follower import SCALE, SPEED

WIDTH = len(SCALE)
PARTS = ("actor", "critics", "slow_actor", "slow_critics", "_actor_step", "_critic_step")
"""Networks and optimisers of a learner."""


@dataclass(frozen=True)
class PathLearning:
    """Numbers of the learner."""

    hidden: tuple[int, ...] = (64, 64)
    """Units of the actor's and the critics' hidden layers."""
    rate: float = 1e-3
    """Adam's step."""
    discount: float = 0.98
    """gamma."""
    tau: float = 0.01
    """Share of the networks that enters their targets."""
    batch: int = 256
    """Transitions of an update."""
    capacity: int = 300_000
    """Transitions that are remembered."""
    imitate: float = 4.0
    """Weight of the distance to the teacher's torque."""
    noise: float = 0.05
    """Standard deviation of the exploration, shares of the largest torque."""


class FollowerActor(nn.Module):
    """Actor that is symmetric: for a mirrored observation it answers with the opposite torque."""

    def __init__(self, hidden: tuple[int, ...]) -> None:
        super().__init__()
        sizes = [WIDTH, *hidden, 1]
        pairs = itertools.pairwise(sizes)
        self.layers = nn.ModuleList(nn.Linear(one, other) for one, other in pairs)
        sign = -torch.ones(WIDTH)
        sign[SPEED] = 1.0
        self.register_buffer("sign", sign)

    def _raw(self, x: Tensor) -> Tensor:
        *hidden, last = self.layers
        for layer in hidden:
            x = torch.tanh(layer(x))
        return torch.as_tensor(last(x))

    def forward(self, x: Tensor) -> Tensor:
        """Return (B, 1) shares of the largest torque for (B, WIDTH) observations."""
        sign = self.get_buffer("sign")
        return torch.tanh(0.5 * (self._raw(x) - self._raw(x * sign)))

    def arrays(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Return weights (in, out) and biases of the layers."""
        weights, biases = [], []
        for layer in self.layers:
            weights.append(layer.get_parameter("weight").detach().numpy().T.astype(np.float64))
            biases.append(layer.get_parameter("bias").detach().numpy().astype(np.float64))
        return tuple(weights), tuple(biases)


def _critic(hidden: tuple[int, ...]) -> nn.Module:
    layers: list[nn.Module] = []
    sizes = [WIDTH + 1, *hidden]
    for one, other in itertools.pairwise(sizes):
        layers += [nn.Linear(one, other), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], 1))


class PathLearner:
    """Actor, twin critics, their targets, and the memory."""

    def __init__(self, config: PathLearning, seed: int) -> None:
        """Initialise the networks."""
        torch.manual_seed(seed)
        self.config = config
        self.actor = FollowerActor(config.hidden)
        self.critics = nn.ModuleList(_critic(config.hidden) for _ in range(2))
        self.slow_actor = copy.deepcopy(self.actor).requires_grad_(False)
        self.slow_critics = copy.deepcopy(self.critics).requires_grad_(False)
        self._actor_step = torch.optim.Adam(self.actor.parameters(), config.rate)
        self._critic_step = torch.optim.Adam(self.critics.parameters(), config.rate)
        self._rng = np.random.default_rng(seed)
        # Goes on where the networks' first weights left the global generator.
        self._generator = torch.Generator()
        self._generator.set_state(torch.get_rng_state())
        # Columns: observation, action, teacher, reward, next observation, lost.
        self._memory = np.zeros((config.capacity, 2 * WIDTH + 4), dtype=np.float32)
        self._held = self._next = 0
        self.updates = 0

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return (N,) shares of the largest torque."""
        with torch.no_grad():
            found = self.actor(torch.as_tensor(observation, dtype=torch.float32))
        return np.asarray(found.numpy()[:, 0], dtype=np.float64)

    def remember(self, rows: np.ndarray) -> None:
        """Store transitions (M, 2 * WIDTH + 4)."""
        places = (self._next + np.arange(len(rows))) % len(self._memory)
        self._memory[places] = rows
        self._next = int((self._next + len(rows)) % len(self._memory))
        self._held = min(len(self._memory), self._held + len(rows))

    def _draw(self) -> tuple[Tensor, ...]:
        rows = self._memory[self._rng.integers(self._held, size=self.config.batch)]
        batch = torch.from_numpy(rows)
        at, w = torch.split(batch, [WIDTH, 4, WIDTH], dim=1), batch[:, WIDTH : WIDTH + 4]
        return at[0], w[:, :1], w[:, 1:2], w[:, 2:3], at[2], w[:, 3:4]

    def anneal(self, progress: float) -> None:
        """Set Adam's step for a run of which a share is done."""
        for optimiser in (self._actor_step, self._critic_step):
            for group in optimiser.param_groups:
                group["lr"] = self.config.rate * max(0.05, 1.0 - progress)

    def imitate(self) -> float:
        """Make one step towards the teacher's torque; return the mean squared distance."""
        seen, _, teacher, _, _, _ = self._draw()
        loss = functional.mse_loss(self.actor(seen), teacher)
        self._actor_step.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._actor_step.step()
        return float(loss.detach())

    def improve(self, actor_too: bool = True) -> None:
        """Make one update of the critics, and of the actor every other time."""
        c = self.config
        seen, action, teacher, reward, then, lost = self._draw()
        with torch.no_grad():
            noise = torch.randn(len(then), 1, generator=self._generator)
            next_action = (self.slow_actor(then) + 0.02 * noise).clamp(-1.0, 1.0)
            both = torch.cat([then, next_action], dim=1)
            values = [one(both) for one in self.slow_critics]
            target = reward + c.discount * (1.0 - lost) * torch.minimum(*values)
        both = torch.cat([seen, action], dim=1)
        losses = [functional.smooth_l1_loss(one(both), target) for one in self.critics]
        self._critic_step.zero_grad()
        torch.stack(losses).sum().backward()  # type: ignore[no-untyped-call]
        self._critic_step.step()
        self.updates += 1
        if self.updates % 2 == 0:
            if actor_too:
                self._improve_actor(seen, teacher)
            slow, main = (self.slow_actor, self.slow_critics), (self.actor, self.critics)
            blend(slow, main, c.tau)

    def _improve_actor(self, seen: Tensor, teacher: Tensor) -> None:
        chosen = self.actor(seen)
        value = self.critics[0](torch.cat([seen, chosen], dim=1))
        loss = -value.mean() / value.detach().abs().mean().clamp_min(0.1)
        loss = loss + self.config.imitate * functional.mse_loss(chosen, teacher)
        self._actor_step.zero_grad()
        loss.backward()
        self._actor_step.step()

    def state_dict(self) -> dict[str, Any]:
        """Return the networks, targets, optimisers, memory, generators and counter."""
        return {name: getattr(self, name).state_dict() for name in PARTS} | {
            "memory": self._memory[: self._held],
            "next": self._next,
            "rng": self._rng.bit_generator.state,
            "generator": self._generator.get_state(),
            "updates": self.updates,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        for name in PARTS:
            getattr(self, name).load_state_dict(state[name])
        self._held, self._next = len(state["memory"]), state["next"]
        self._memory[: self._held] = state["memory"]
        self._rng.bit_generator.state = state["rng"]
        self._generator.set_state(state["generator"])
        self.updates = state["updates"]
