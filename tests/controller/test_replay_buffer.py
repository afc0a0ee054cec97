from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pytest
import torch

from bicycle_controller.data.replay_buffer import NStepAccumulator, ReplayBuffer, RewardShaping

GAMMA = 0.9


def rows_of(numbers: Iterable[int], actions: int = 2) -> np.ndarray:
    """Return rows that hold their own number everywhere."""
    return np.repeat(np.array(list(numbers), dtype=np.float32)[:, None], 17 + actions, axis=1)


def test_the_ring_overwrites_the_oldest() -> None:
    replay = ReplayBuffer(5, 2)
    replay.add(rows_of([0, 1, 2]))
    assert (replay.size, replay.position) == (3, 3)
    replay.add(rows_of([3, 4, 5, 6]))
    assert (replay.size, replay.position) == (5, 2)
    assert replay.table[:, 0].tolist() == [5, 6, 2, 3, 4]


def test_a_memory_on_another_device_holds_the_same() -> None:
    """There rows cannot be written through numpy; the way that is taken then, on this device."""
    here, there = ReplayBuffer(5, 2), ReplayBuffer(5, 2)
    there._rows = None
    for numbers in ([0, 1], [2], [3, 4, 5, 6]):
        here.add(rows_of(numbers))
        there.add(rows_of(numbers))
        assert torch.equal(here.table, there.table)


def test_samples_are_even_over_what_is_stored_and_repeatable() -> None:
    replay = ReplayBuffer(100, 2)
    replay.add(rows_of(range(10)))
    drawn = [replay.sample(5000, torch.Generator().manual_seed(s)).reward for s in (1, 1, 2)]
    assert torch.equal(drawn[0], drawn[1])
    assert not torch.equal(drawn[0], drawn[2])
    counts = np.bincount(drawn[0].int().numpy(), minlength=10)
    assert len(counts) == 10
    # 500 expected each, with a standard deviation of 21.
    assert 400 < counts.min() <= counts.max() < 600


def test_a_batch_names_the_columns_in_their_order() -> None:
    replay = ReplayBuffer(1, 2)
    replay.add(np.arange(19, dtype=np.float32)[None])
    batch = replay.sample(1, torch.Generator())
    assert batch.observation.tolist() == [[0, 1, 2, 3, 4, 5]]
    assert batch.action.tolist() == [[6, 7]]
    assert batch.next_observation.tolist() == [[8, 9, 10, 11, 12, 13]]
    flags = (batch.reward, batch.discount, batch.terminated, batch.truncated, batch.fallen)
    assert [column.tolist() for column in flags] == [[14], [15], [16], [17], [18]]


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        (np.zeros((2, 5)), "rows of 19"),
        (np.zeros((2, 25)), "rows of 19"),
        (np.zeros((6, 19)), "up to 5 rows"),
        (np.full((1, 19), np.nan), "not finite"),
    ],
)
def test_rows_that_cannot_be_are_refused(rows: np.ndarray, word: str) -> None:
    replay = ReplayBuffer(5, 2)
    with pytest.raises(ValueError, match=word):
        replay.add(rows)
    assert replay.size == 0


def test_an_empty_memory_cannot_be_sampled() -> None:
    with pytest.raises(ValueError, match="empty"):
        ReplayBuffer(5, 2).sample(1, torch.Generator())


@pytest.mark.parametrize("count", [3, 7])
def test_a_saved_memory_goes_on_to_the_bit(count: int) -> None:
    replay, other = ReplayBuffer(5, 2), ReplayBuffer(5, 2)
    for number in range(count):
        replay.add(rows_of([number]))
    state = replay.state_dict()
    replay.add(rows_of([98]))
    other.load_state_dict(state)
    other.add(rows_of([98]))
    assert torch.equal(replay.table, other.table)
    assert (replay.size, replay.position) == (other.size, other.position)


def test_a_saved_memory_of_another_shape_is_refused() -> None:
    replay = ReplayBuffer(5, 2)
    replay.add(rows_of(range(5)))
    with pytest.raises(ValueError, match=r"memory of 4 rows of 19 .* cannot take 5 rows of 19$"):
        ReplayBuffer(4, 2).load_state_dict(replay.state_dict())
    with pytest.raises(ValueError, match=r"memory of 5 rows of 20 .* cannot take 5 rows of 19$"):
        ReplayBuffer(5, 3).load_state_dict(replay.state_dict())


class Rider:
    """Random episodes of three bicycles, remembered step by step."""

    def __init__(self, absorbing: bool, n_step: int, penalty: float = 0.0) -> None:
        self.rng = np.random.default_rng(n_step)
        self.absorbing, self.n_step, self.penalty = absorbing, n_step, penalty
        self.returns = NStepAccumulator(3, 2, RewardShaping(n_step, GAMMA, penalty, absorbing))
        self.tracks: list[list[list[dict[str, Any]]]] = [[[]] for _ in range(3)]
        self.rows = np.zeros((0, 19), dtype=np.float32)
        self.time = 0

    def ride(self, steps: int) -> None:
        for _ in range(steps):
            kind = self.rng.choice(4, size=3, p=[0.7, 0.1, 0.1, 0.1])
            flags = [kind == number for number in (1, 2, 3)]
            reward = -self.rng.random(3)
            # The observation is the time, so that a row says which steps it spans.
            now, then = np.full((3, 6), self.time), np.full((3, 6), self.time + 1)
            action = self.rng.uniform(-1, 1, (3, 2))
            found = self.returns.push(now, action, reward, then, *flags)
            self.rows = np.concatenate([self.rows, found])
            for who in range(3):
                names = ("terminated", "truncated", "fallen")
                step: dict[str, Any] = {n: bool(f[who]) for n, f in zip(names, flags, strict=True)}
                step |= {"time": self.time, "reward": reward[who], "action": action[who]}
                self.tracks[who][-1].append(step)
                final = step["terminated"] or step["truncated"]
                if final or (step["fallen"] and self.absorbing):
                    self.tracks[who].append([])
            self.time += 1

    def expected(self) -> Iterator[np.ndarray]:
        """Every complete transition, by the definition, episode by episode."""
        for episodes in self.tracks:
            for number, episode in enumerate(episodes):
                for first in range(len(episode)):
                    span = episode[first : first + self.n_step]
                    if len(span) == self.n_step or number < len(episodes) - 1:
                        yield self.row(span)

    def row(self, span: list[dict[str, Any]]) -> np.ndarray:
        last = span[-1]
        total = 0.0
        for power, step in enumerate(span):
            reward = step["reward"] - self.penalty * step["fallen"]
            if step["fallen"] and self.absorbing:
                reward = reward / (1 - GAMMA)
            total += GAMMA**power * reward
        ends = last["terminated"] or (last["fallen"] and self.absorbing)
        discount = 0.0 if ends else GAMMA ** len(span)
        flags = [last[name] for name in ("terminated", "truncated", "fallen")]
        first, after = [span[0]["time"]] * 6, [last["time"] + 1] * 6
        return np.array([*first, *span[0]["action"], *after, total, discount, *flags])


@pytest.mark.parametrize("n_step", [1, 3, 5])
@pytest.mark.parametrize("absorbing", [False, True])
def test_n_step_returns_follow_their_definition(n_step: int, absorbing: bool) -> None:
    rider = Rider(absorbing, n_step, penalty=0.25)
    rider.ride(200)
    expected = np.array(sorted(map(tuple, rider.expected())))
    found = np.array(sorted(map(tuple, rider.rows.astype(float))))
    assert len(found) > 500
    assert found.shape == expected.shape
    # Sorted by time, then action: rewards in single precision cannot reorder them.
    assert np.allclose(found, expected, rtol=1e-5, atol=1e-6)


def test_the_cap_bounds_a_steps_cost_before_the_fall_penalty() -> None:
    returns = NStepAccumulator(2, 1, RewardShaping(1, GAMMA, 6.0, absorbing=True, cost_cap=4.0))
    no, one = np.zeros(2, dtype=bool), np.zeros((2, 6))
    fallen = np.array([False, True])
    rows = returns.push(one, one[:, :1], np.array([-9.0, -1.0]), one, no, no, fallen)
    assert rows[:, 13].tolist() == pytest.approx([-4.0, (-1.0 - 6.0) / (1 - GAMMA)])
    rows = returns.push(one, one[:, :1], np.array([-3.0, -9.0]), one, no, no, fallen)
    assert rows[:, 13].tolist() == pytest.approx([-3.0, (-4.0 - 6.0) / (1 - GAMMA)])


def test_pending_returns_go_on_to_the_bit() -> None:
    rider = Rider(True, 4)
    rider.ride(20)
    other = NStepAccumulator(3, 2, RewardShaping(4, GAMMA, 0.0, True))
    other.load_state_dict(rider.returns.state_dict())
    arguments = (np.ones((3, 6)), np.ones((3, 2)), np.ones(3), np.ones((3, 6)))
    flags = (np.array([True, False, False]), np.zeros(3, dtype=bool), np.zeros(3, dtype=bool))
    for _ in range(4):
        found = [returns.push(*arguments, *flags) for returns in (rider.returns, other)]
        assert np.array_equal(found[0], found[1])


@pytest.mark.parametrize("absorbing", [False, True])
def test_one_step_returns_are_those_of_the_general_way(absorbing: bool) -> None:
    """The results are equal to the bit, and the pending state is the same."""
    worth = RewardShaping(1, 0.99, 0.3, absorbing, cost_cap=2.0, step_cost=0.1)
    quick, general = (NStepAccumulator(5, 2, worth, expert_action=True) for _ in range(2))
    rng = np.random.default_rng(1)
    for _ in range(300):
        observation, action, following = (rng.normal(size=(5, width)) for width in (6, 2, 6))
        reward, expert_action = (
            -rng.exponential(1.0, 5) * rng.integers(0, 2, 5),
            rng.normal(size=(5, 2)),
        )
        goal, cut, fall = rng.random((3, 5)) < 0.2
        result = quick.push(
            observation, action, reward, following, goal, cut, fall, -0.0, expert_action
        )
        worthy, final = general._worth(reward, goal, fall, -0.0)
        general.observation[0], general.action[0], general.expert_action[0] = (
            observation,
            action,
            expert_action,
        )
        wanted = general._push(worthy, final, following, (goal, cut, fall))
        assert result.tobytes() == wanted.tobytes()
        one, other = quick.state_dict(), general.state_dict()
        assert all(np.array_equal(one[name], other[name]) for name in other)
