"""Replay memory: one packed float32 table, and the n-step returns that fill it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bicycle_controller.config.algorithms import LearnerConfig

OBSERVATIONS = 6
"""Numbers per observation of the paper's actor."""


@dataclass(frozen=True)
class Batch:
    """B transitions, all float32; observations raw, actions normalised."""

    observation: Tensor
    """(B, inputs of the actor), followed by the critic's extra inputs."""
    action: Tensor
    """(B, actions), within [-1, 1]."""
    next_observation: Tensor
    """Observation n steps later; meaningless if `discount` is 0."""
    reward: Tensor
    """(B,), discounted sum of up to n rewards, and of all that follow an absorbing fall."""
    discount: Tensor
    """(B,), factor of the next observation's value: gamma^(actual n), 0 if none follows."""
    terminated: Tensor
    """(B,), 1 if the goal was reached."""
    truncated: Tensor
    """(B,), 1 if the step limit was reached."""
    fallen: Tensor
    """(B,), 1 if the bicycle lies afterwards."""
    expert_action: Tensor | None = None
    """(B, actions), the teacher's action, if the memory stores it."""

    def parts(self, size: int) -> Iterator[Batch]:
        """Split the batch into batches of `size` transitions, in order."""
        for first in range(0, len(self.reward), size):
            rows = slice(first, first + size)
            columns = vars(self).values()
            cut: list[Any] = [column if column is None else column[rows] for column in columns]
            yield Batch(*cut)


class ReplayBuffer:
    """Ring buffer of transitions, one row each, on any device.

    Attributes:
        table: (capacity, width) float32.
        size: rows that hold a transition.
        position: row of the next transition.
    """

    def __init__(
        self,
        capacity: int,
        actions: int,
        device: torch.device | str = "cpu",
        observations: int = OBSERVATIONS,
        expert_action: bool = False,
    ) -> None:
        """Create an empty memory for `capacity` transitions of given widths.

        With `expert_action` each has a second action to its right, the teacher's.
        """
        self.capacity = capacity
        self.actions = actions
        self.columns = [observations, actions, observations, 1, 1, 1, 1, 1] + [
            actions
        ] * expert_action
        self.table = torch.zeros((capacity, sum(self.columns)), device=device)
        self._rows = self.table.numpy() if self.table.device.type == "cpu" else None
        self.size = 0
        self.position = 0

    def add(self, rows: np.ndarray) -> None:
        """Store transitions (M, width), M up to the capacity, in the order of `Batch`'s fields.

        Raises:
            ValueError: if a row has a wrong width, a value is not finite, or the rows exceed the
                capacity.
        """
        count = len(rows)
        if count == 0:
            return
        if rows.shape != (count, self.table.shape[1]) or count > self.capacity:
            raise ValueError(
                f"the replay memory takes up to {self.capacity} rows of {self.table.shape[1]}"
                f" numbers, not an array of shape {rows.shape}"
            )
        if not np.isfinite(rows).all():
            raise ValueError("a transition holds a value that is not finite")
        first = min(count, self.capacity - self.position)
        self._put(self.position, rows[:first])
        if first < count:
            self._put(0, rows[first:])
        self.position = (self.position + count) % self.capacity
        self.size = min(self.size + count, self.capacity)

    def _put(self, position: int, rows: np.ndarray) -> None:
        if self._rows is not None:
            self._rows[position : position + len(rows)] = rows
            return
        source = torch.from_numpy(np.ascontiguousarray(rows, dtype=np.float32))
        self.table[position : position + len(rows)] = source.to(self.table.device)

    def sample(self, count: int, generator: torch.Generator) -> Batch:
        """Draw `count` transitions uniformly, with repetition; one gather serves several updates.

        Raises:
            ValueError: if the memory is empty.
        """
        index = self.draw(count, generator)
        parts = torch.split_with_sizes(self.table.index_select(0, index), self.columns, 1)
        return Batch(*parts[:3], *(part.squeeze(1) for part in parts[3:8]), *parts[8:])

    def draw(self, count: int, generator: torch.Generator) -> Tensor:
        """Draw `count` rows of the table uniformly, with repetition, (count,) int64.

        Raises:
            ValueError: if the memory is empty.
        """
        if self.size == 0:
            raise ValueError("cannot sample from an empty replay memory")
        return torch.randint(self.size, (count,), generator=generator, device=self.table.device)

    def state_dict(self) -> dict[str, Any]:
        """Return the used rows and the position."""
        return {"rows": self.table[: self.size].clone().cpu(), "position": self.position}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`.

        Raises:
            ValueError: if its rows do not fit this memory.
        """
        rows = state["rows"]
        if rows.shape[1] != self.table.shape[1] or len(rows) > self.capacity:
            raise ValueError(
                f"a replay memory of {self.capacity} rows of {self.table.shape[1]} numbers"
                f" cannot take {len(rows)} rows of {rows.shape[1]}"
            )
        self.size, self.position = len(rows), int(state["position"])
        self.table[: self.size] = rows.to(self.table.device)


@dataclass(frozen=True)
class RewardShaping:
    """Learner's value of steps and falls; see `config.algorithms` for each field."""

    n_step: int
    gamma: float
    fall_penalty: float = 0.0
    """Subtracted from the reward of every step in which a bicycle lies."""
    absorbing: bool = False
    """True if a fall ends the episode with the value of lying for ever."""
    cost_cap: float = 0.0
    """Largest cost of one step; 0 disables the cap."""
    step_cost: float = 0.0
    """Subtracted from every reward after that."""

    @classmethod
    def of(cls, learner: LearnerConfig) -> RewardShaping:
        """Return a learner's reward shaping."""
        return cls(
            learner.n_step,
            learner.gamma,
            learner.fall_penalty,
            learner.fall == "absorbing",
            learner.cost_cap,
            learner.step_cost,
        )


_SAVED = {name: name for name in ("observation", "action", "sum", "age", "open")}
_SAVED["shown"] = "expert_action"
"""Attributes of `NStepAccumulator` by their keys in a checkpoint, which stay as in 0.1.0."""


class NStepAccumulator:
    """Turns the steps of N bicycles into n-step transitions, cut at the end of each episode.

    After n steps, or at an episode's end, a transition is emitted with the discounted sum of its
    k <= n rewards and the discount gamma^k, or 0 if the goal was reached. When falls absorb, the
    reward of a fall counts as r / (1 - gamma), the value of repeating it for ever.
    """

    def __init__(
        self,
        count: int,
        actions: int,
        shaping: RewardShaping,
        observations: int = OBSERVATIONS,
        expert_action: bool = False,
    ) -> None:
        """Start without pending steps.

        Args:
            count: N, the number of bicycles.
            actions: numbers per action.
            shaping: n, discount and reward shaping.
            observations: numbers per observation.
            expert_action: True to store a teacher's action with each.
        """
        self.shaping, n_step = shaping, shaping.n_step
        self.observation = np.zeros((n_step, count, observations), dtype=np.float32)
        self.action = np.zeros((n_step, count, actions), dtype=np.float32)
        self.expert_action = np.zeros(
            (n_step, count, actions if expert_action else 0), dtype=np.float32
        )
        self.sum = np.zeros((n_step, count))
        self.age = np.zeros((n_step, count), dtype=np.int64)
        self.open = np.zeros((n_step, count), dtype=bool)
        self.slot = 0

    def push(
        self,
        observation: np.ndarray,
        action: np.ndarray,
        reward: np.ndarray,
        next_observation: np.ndarray,
        terminated: np.ndarray,
        truncated: np.ndarray,
        fallen: np.ndarray,
        shaping: np.ndarray | float = 0.0,
        expert_action: np.ndarray | None = None,
    ) -> np.ndarray:
        """Take one step of every bicycle.

        Args:
            observation: (N, observations) before the step.
            action: (N, actions), normalised.
            reward: (N,) of the step.
            next_observation: the same after it, before any reset.
            terminated: bool (N,), True if the goal was reached.
            truncated: bool (N,), True at the step limit.
            fallen: bool (N,), True if the bicycle lies afterwards.
            shaping: (N,), added to the reward after `cost_cap`.
            expert_action: (N, actions), a teacher's answer to the observation, if stored.

        Returns:
            The transitions that are complete now, (M, width) float32, for `ReplayBuffer.add`.
        """
        reward, final = self._worth(reward, terminated, fallen, shaping)
        self.observation[self.slot], self.action[self.slot] = observation, action
        if expert_action is not None:
            self.expert_action[self.slot] = expert_action
        ends = (terminated, truncated, fallen)
        if self.shaping.n_step == 1:
            self.sum[0], self.age[0] = reward + 0.0, 1
            discount = np.where(final, 0.0, self.shaping.gamma)
            kept = observation, action, next_observation
            return self._rows(kept, (self.sum[0], discount, *ends), self.expert_action[0])
        return self._push(reward, final, next_observation, ends)

    def _worth(
        self,
        reward: np.ndarray,
        terminated: np.ndarray,
        fallen: np.ndarray,
        shaping: np.ndarray | float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the learner's reward of a step (N,), and True where nothing follows it."""
        worth = self.shaping
        if worth.cost_cap > 0:
            reward = np.maximum(reward, -worth.cost_cap)
        reward = reward + shaping - worth.step_cost - worth.fall_penalty * fallen
        if not worth.absorbing:
            return reward, terminated
        return np.where(fallen, reward / (1.0 - worth.gamma), reward), terminated | fallen

    def _push(
        self,
        reward: np.ndarray,
        final: np.ndarray,
        next_observation: np.ndarray,
        ends: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> np.ndarray:
        """Add a step's reward to the pending steps; return the transitions that it completes."""
        n_step, gamma = self.shaping.n_step, self.shaping.gamma
        self.sum[self.slot], self.age[self.slot], self.open[self.slot] = 0.0, 0, True
        self.sum += np.where(self.open, gamma**self.age * reward, 0.0)
        self.age += self.open
        ready = self.open & (final | ends[1] | (self.age == n_step))
        slots, who = np.nonzero(ready)
        discount = np.where(final[who], 0.0, gamma ** self.age[slots, who])
        self.open &= ~ready
        self.slot = (self.slot + 1) % n_step
        kept = self.observation[slots, who], self.action[slots, who], next_observation[who]
        columns = (self.sum[slots, who], discount, *(end[who] for end in ends))
        return self._rows(kept, columns, self.expert_action[slots, who])

    @staticmethod
    def _rows(
        kept: tuple[np.ndarray, ...], columns: tuple[np.ndarray, ...], expert_action: np.ndarray
    ) -> np.ndarray:
        """Return transitions as rows, (M, width) float32."""
        count = len(expert_action)
        blocks = [*kept, *columns, expert_action]
        widths = [1 if block.ndim == 1 else block.shape[1] for block in blocks]
        rows = np.empty((count, sum(widths)), dtype=np.float32)
        at = 0
        for block, width in zip(blocks, widths, strict=True):
            rows[:, at : at + width] = block.reshape(count, width)
            at += width
        return rows

    def state_dict(self) -> dict[str, Any]:
        """Return the pending steps."""
        return {key: getattr(self, name).copy() for key, name in _SAVED.items()} | {
            "slot": self.slot
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        for key, name in _SAVED.items():
            getattr(self, name)[...] = state[key]
        self.slot = int(state["slot"])
