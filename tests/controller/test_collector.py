from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from training_maker import ddpg_of, small_run

from bicycle_controller.config.run import ShapingConfig, StartsConfig
from bicycle_controller.data.replay_buffer import Batch, ReplayBuffer
from bicycle_controller.policy.policy import load_controller
from bicycle_controller.training.collector import Collector
from bicycle_controller.training.starts import restart, ride_on, training_scenario
from bicycle_sim.task.scenario import SCENARIOS
from bicycle_sim.task.task import BicycleTask

EVERYONE = np.ones(2000, dtype=bool)


def task_of(count: int = 2000) -> BicycleTask:
    scenario = SCENARIOS["random-start-random-goal"]
    return BicycleTask(scenario, None, count, np.random.default_rng(0))


class Still:
    """A policy that does nothing."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.zeros((len(observation), 2))


class Broken:
    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.full((len(observation), 2), np.nan)


def collected(steps: int, *overrides: str) -> tuple[Collector, Batch]:
    """Return all transitions of a few steps of two bicycles, in order."""
    config = small_run("bicycles=2", "warm_up=0", "noise.kind=none", *overrides)
    replay = ReplayBuffer(10_000, 2)
    collector = Collector(config, replay)
    for _ in range(steps):
        collector.step(Still())
    table = replay.table[: replay.size]
    parts: list[Any] = [part.numpy() for part in torch.split(table, replay.columns, dim=1)]
    return collector, Batch(*parts[:3], *(part[:, 0] for part in parts[3:]))


def test_near_goals_lie_at_any_bearing_within_their_distances() -> None:
    task = task_of()
    restart(task, EVERYONE, StartsConfig(near_share=0.5, near_distance=(1.5, 15.0)))
    distance = task.goal_distance()
    near = distance <= 15.0
    assert distance.min() >= 1.5
    # Of the scenario's own goals in 200 m by 200 m about 1.5 % are as near.
    assert 0.45 < near.mean() < 0.56
    error = task.observation()[near, 5]
    counts = np.histogram(error, bins=8, range=(-np.pi, np.pi))[0]
    assert counts.min() > 0.09 * near.sum()


def test_tilted_starts_stay_within_their_bounds() -> None:
    task = task_of()
    spreads: dict[str, Any] = {"tilt": 0.1, "tilt_rate": 0.2, "steer": 0.3, "steer_rate": 0.4}
    restart(task, EVERYONE, StartsConfig(**spreads))
    state = task.state
    found = (state.lean_angle, state.lean_rate, state.steer_angle, state.steer_rate)
    for values, spread in zip(found, spreads.values(), strict=True):
        assert 0.98 * spread < np.abs(values).max() <= spread
        assert abs(values.mean()) < 0.05 * spread


def test_any_speed_is_drawn_only_where_the_scenario_has_limits() -> None:
    scenario = SCENARIOS["learned-speed"]
    task = BicycleTask(scenario, None, 2000, np.random.default_rng(0))
    restart(task, EVERYONE, StartsConfig(any_speed=True))
    assert 1.0 <= task.state.speed.min() < 1.01
    assert 4.99 < task.state.speed.max() <= 5.0
    fixed = task_of()
    restart(fixed, EVERYONE, StartsConfig(any_speed=True))
    assert np.ptp(fixed.state.speed) == 0.0


def test_only_the_chosen_start_again() -> None:
    task = task_of(4)
    for _ in range(3):
        task.step(np.zeros((4, 3)))
    before = task.snapshot()
    restart(task, np.array([True, False, False, True]), StartsConfig(tilt=0.1, near_share=1.0))
    assert np.array_equal(task.state.rear_x[1:3], before.rear_x[1:3])
    assert np.array_equal(task.state.lean_angle[1:3], before.lean_angle[1:3])
    assert task.steps.tolist() == [0, 3, 3, 0]


def test_riding_on_changes_the_goal_and_nothing_else() -> None:
    task = task_of(4)
    for _ in range(3):
        task.step(np.full((4, 3), 0.1))
    before, goals = task.snapshot(), task.goal_x.copy()
    ride_on(task, np.array([True, True, False, False]), StartsConfig())
    for name, values in vars(before).items():
        assert np.array_equal(getattr(task.state, name), values)
    assert (task.goal_x != goals).tolist() == [True, True, False, False]
    assert task.steps.tolist() == [0, 0, 3, 3]


def test_the_training_limit_replaces_the_scenarios() -> None:
    scenario = SCENARIOS["random-start-random-goal"]
    assert training_scenario(scenario, StartsConfig()).max_steps == 4000
    assert training_scenario(scenario, StartsConfig(max_steps=400)).max_steps == 400
    assert scenario.max_steps == 4000


def test_row_25_frozen_falls_enter_the_memory_up_to_the_step_limit() -> None:
    # Tilted by up to half a radian and never steered, both bicycles fall within 40 steps.
    _, batch = collected(40, "ddpg.fall=frozen", "starts.tilt=0.5")
    assert len(batch.reward) == 80
    for who in range(2):
        mine = Batch(*(column[who::2] for column in list(vars(batch).values())[:8]))
        first = int(np.argmax(mine.fallen))
        assert 0 < first < 39
        assert mine.fallen[first:].all()
        assert np.ptp(mine.reward[first:]) == 0.0
        assert not np.ptp(mine.next_observation[first:], axis=0).any()
        assert np.allclose(mine.discount, 0.99)
        assert mine.truncated.tolist() == [0.0] * 39 + [1.0]


def test_absorbing_falls_start_again_at_once_and_are_worth_lying_for_ever() -> None:
    collector, batch = collected(40, "ddpg.fall=absorbing", "starts.tilt=0.5")
    _, frozen = collected(40, "ddpg.fall=frozen", "starts.tilt=0.5")
    falls = np.flatnonzero(batch.fallen)
    assert len(falls) >= 2
    assert not batch.discount[falls].any()
    assert batch.discount[batch.fallen == 0] == pytest.approx(0.99)
    first = falls[0]
    assert frozen.fallen[first]
    assert batch.reward[first] == pytest.approx(frozen.reward[first] / 0.01, rel=1e-5)
    # The next transition of the same bicycle begins upright and unhurried.
    assert batch.observation[first + 2][3] == 0.0
    assert collector.metrics()["fall_rate"] == 1.0


def test_the_warm_up_draws_the_whole_range_and_ends_in_time() -> None:
    config = small_run("bicycles=50", "warm_up=1000")
    replay = ReplayBuffer(3000, 2)
    collector = Collector(config, replay)
    for _ in range(40):
        collector.step(Still())
    actions = replay.table[: replay.size, 6:8].numpy()
    assert np.abs(actions[:1000]).max() > 0.99
    assert abs(actions[:1000].mean()) < 0.05
    # After it, only Ornstein-Uhlenbeck noise of 0.2 remains.
    assert actions[1000:].std() < 0.6


def test_the_policy_chooses_only_driven_actions() -> None:
    pedal = small_run("scenario=learned-speed", "scenario.max_steps=60")
    assert Collector(pedal, ReplayBuffer(10, 3)).driven.tolist() == [0, 1, 2]
    assert Collector(small_run(), ReplayBuffer(10, 2)).driven.tolist() == [0, 1]


def test_a_diverged_policy_is_one_line() -> None:
    collector = Collector(small_run("warm_up=0"), ReplayBuffer(100, 2))
    with pytest.raises(RuntimeError, match=r"diverged after 0 steps.*learning rates"):
        collector.step(Broken())


def test_a_saved_collection_goes_on_to_the_bit() -> None:
    config = small_run("starts.near_share=0.5", "starts.ride_on=0.5", "ddpg.n_step=3")
    config = replace(config, ddpg=replace(ddpg_of(config), fall="absorbing"))
    memories = ReplayBuffer(9000, 2), ReplayBuffer(9000, 2)
    first, second = (Collector(config, memory) for memory in memories)
    for _ in range(60):
        first.step(Still())
    second.load_state_dict(first.state_dict())
    memories[0].size = memories[0].position = 0
    for _ in range(60):
        for collector in (first, second):
            collector.step(Still())
    rows = [memory.table[: memory.size].numpy() for memory in memories]
    assert len(rows[0]) > 400
    assert np.array_equal(rows[0], rows[1])
    assert first.metrics() == second.metrics()


def test_progress_costs_what_brings_the_bicycle_no_nearer() -> None:
    plain, shaped = collected(3)[1], collected(3, "shaping.progress=4")[1]
    error = plain.next_observation[:, 5]
    # At a fixed speed v cos(error) / v_top is cos(error).
    assert shaped.reward == pytest.approx(plain.reward - 4.0 * (1.0 - np.cos(error)), abs=1e-5)


def test_progress_counts_the_speed_where_there_are_gears_to_go() -> None:
    options = ("scenario=learned-speed", "shaping.progress=5", "ddpg.critic_sees=[speed]")
    config = small_run("bicycles=2", "warm_up=0", "noise.kind=none", *options)
    collector = Collector(config, ReplayBuffer(10, 3, observations=7))
    collector.step(Coasting())
    row = collector.replay.table[:2].numpy()  # type: ignore[attr-defined]
    plain = Collector(
        replace(config, shaping=ShapingConfig()), ReplayBuffer(10, 3, observations=7)
    )
    plain.step(Coasting())
    before = plain.replay.table[:2].numpy()  # type: ignore[attr-defined]
    error = row[:, 7 + 3 + 5]
    assert row[:, 6] == pytest.approx([2.0, 2.0])
    assert before[:, 17] - row[:, 17] == pytest.approx(5.0 * (1.0 - 2.0 / 5.0 * np.cos(error)))


class Coasting:
    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.zeros((len(observation), 3))


def test_training_may_do_without_the_heading_term() -> None:
    plain, spared = collected(3)[1], collected(3, "shaping.heading_share=0.25")[1]
    heading = 2.0 * plain.next_observation[:, 5] ** 2
    assert spared.reward == pytest.approx(plain.reward + 0.75 * heading, abs=1e-5)
    assert heading.max() > 0.1


def test_the_critic_is_shown_speed_and_a_bounded_distance() -> None:
    config = small_run("ddpg.critic_sees=[goal_distance, speed]", "bicycles=8", "warm_up=0")
    replay = ReplayBuffer(100, 2, observations=8)
    collector = Collector(config, replay)
    distance = collector.task.goal_distance()
    collector.step(Still())
    assert replay.table[:8, 6].numpy() == pytest.approx(np.minimum(distance, 20.0), abs=1e-4)
    assert replay.table[:8, 7].numpy() == pytest.approx(np.full(8, 10 / 3.6))


def test_a_teacher_rides_its_share() -> None:
    options = ("bicycles=8", "warm_up=0", "noise.kind=none", "starts.steer=0.3")
    teacher = ("teacher.controller=lqr-20cm", "teacher.share=0.375")
    replay = ReplayBuffer(100, 2)
    collector = Collector(small_run(*options, *teacher), replay)
    seen, speed = collector.observation, collector.task.state.speed
    expected = load_controller("lqr-20cm").act(seen, speed)[:, :2] / (2.0, 0.2)
    collector.step(Still())
    action = replay.table[:8, 6:8].numpy()
    taught = np.abs(action).max(axis=1) > 0
    assert taught.sum() == 3
    assert action[taught] == pytest.approx(expected[taught], abs=1e-6)


def test_the_memory_holds_what_the_teacher_would_have_done() -> None:
    options = ("bicycles=8", "warm_up=0", "noise.kind=none", "starts.steer=0.3")
    teacher = ("teacher.controller=lqr-20cm", "teacher.share=0.125", "ddpg.bc_to=teacher")
    replay = ReplayBuffer(100, 2, expert_action=True)
    collector = Collector(small_run(*options, *teacher), replay)
    seen, speed = collector.observation, collector.task.state.speed
    expected = load_controller("lqr-20cm").act(seen, speed)[:, :2] / (2.0, 0.2)
    collector.step(Still())
    assert replay.table[:8, -2:].numpy() == pytest.approx(np.clip(expected, -1, 1), abs=1e-6)
    assert np.abs(replay.table[:7, 6:8].numpy()).max() == 0.0


def test_imitating_a_teacher_needs_one() -> None:
    with pytest.raises(ValueError, match=r"bc_to=teacher needs a teacher: set teacher.controller"):
        small_run("ddpg.bc_to=teacher")
