"""Learning from recorded rides: repeatable, resumable, guarded, and one line for mistakes."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from ride_bag_maker import Rider, write_bag
from run_compare import assert_same_run

from bicycle_common.command_line import USAGE_ERROR
from bicycle_controller.agents.ddpg import Ddpg
from bicycle_controller.agents.networks import Critic
from bicycle_controller.cli import main
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.data import dataset
from bicycle_controller.data.dataset import Dataset
from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.policy.policy import load_controller, load_policy
from bicycle_controller.training import offline
from bicycle_controller.training.learner import Learner, ddpg_of
from bicycle_controller.training.logger import Logger
from bicycle_controller.training.run_folder import RunFolder
from bicycle_sim.task.scenario import TEN_KM_H
from bicycle_sim.task.task import BicycleTask

SMALL = (
    "ddpg.actor_hidden=[16, 12]",
    "ddpg.critic_hidden=[14, 10]",
    "ddpg.batch=32",
    "evaluation.every=60",
    "evaluation.episodes=8",
    "evaluation.near_episodes=4",
    "evaluation.max_steps=60",
    "log_every=20",
    "offline_updates=200",
    "tensorboard=false",
)


def small(*overrides: str, preset: str = "offline") -> RunConfig:
    return loading.preset(preset, [*SMALL, *overrides])


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute of the LQR with exploration, with goals and falls."""
    folder = tmp_path_factory.mktemp("rides")
    return write_bag(folder / "bag", Rider(sigma=0.25, seed=0, field=8.0).ride(1200))


@pytest.fixture(scope="module")
def data(bag: Path) -> Dataset:
    return dataset.load([bag])


def after(rounds: int) -> Callable[[], bool]:
    """Says stop at the given round of updates."""
    left = iter(range(rounds))
    return lambda: next(left, None) is None


@pytest.mark.parametrize("preset", ["offline", "offline-plain"])
def test_a_resumed_run_gives_the_same_numbers_to_the_bit(
    preset: str, data: Dataset, tmp_path: Path
) -> None:
    config = small(preset=preset)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    result = offline.run(config, data, whole)
    assert (result.status, result.updates) == ("finished", 200)
    assert result.transitions == len(data.transitions)
    assert offline.run(config, data, parts, stop=after(7)).status == "interrupted"
    assert offline.resume(parts, stop=after(4)).status == "interrupted"
    assert offline.resume(parts).status == "finished"
    assert_same_run(whole, parts)


def test_the_policy_is_of_the_scenario_that_was_ridden(data: Dataset, tmp_path: Path) -> None:
    offline.run(small("scenario=learned-speed"), data, tmp_path / "run")
    policy = load_policy(tmp_path / "run")
    assert policy.info.scenario == data.scenario
    assert policy.info.trained["algorithm"] == "td3+bc"
    assert policy.info.action_limits == (2.0, 0.2, 0.0)


def test_imitation_comes_near_the_recorded_actions_and_q_alone_does_not(
    data: Dataset, tmp_path: Path
) -> None:
    """Measured against what the LQR does without the noise that it explored with."""
    seen = data.transitions.observation
    shown = load_controller("lqr").act(seen, np.full(len(seen), TEN_KM_H))
    distance = {}
    for weight in (0.0, 1000.0):
        config = small(f"ddpg.bc_weight={weight}", "offline_updates=1500", "ddpg.critics=1")
        offline.run(config, data, tmp_path / f"{weight}")
        action = load_policy(tmp_path / f"{weight}" / "last.safetensors").act(seen)
        error = (action - np.clip(shown, -2.0, 2.0))[:, :2] / data.scenario.action_limits[:2]
        distance[weight] = float(np.sqrt(np.mean(error**2)))
    assert distance[1000.0] < 0.5 * distance[0.0]


def test_a_candidate_whose_critic_dreams_is_refused(data: Dataset, tmp_path: Path) -> None:
    """No reward is positive, so a mean Q above zero is wrong, however well the actor rides."""
    files = RunFolder(tmp_path / "run")
    config = replace(small("ddpg.bound_values=false"), scenario=data.scenario)
    files.create(config)
    memory = ReplayBuffer(len(data.transitions), 2)
    memory.add(dataset.memory_rows(data, ddpg_of(config)))
    learner = Learner(config, files, memory)
    with Logger(files.path, 0, 0, False) as log:
        learner.advance(log, 60)
        assert learner.evaluate(log).kept
        best = files.best.read_bytes()
        learner.best = None
        with torch.no_grad():
            agent = learner.agent
            assert isinstance(agent, Ddpg)
            for net in (*agent.critics, *agent.critic_targets):
                assert isinstance(net, Critic)
                last = net.layers[-1]
                assert isinstance(last, torch.nn.Linear)
                last.bias.fill_(50.0)
        learner.advance(log, 60)
        candidate = learner.evaluate(log)
    assert candidate.q_policy is not None
    assert candidate.q_policy > 0
    assert candidate.overestimates
    assert not candidate.kept
    assert (learner.rejected, learner.best) == (1, None)
    assert files.best.read_bytes() == best


def test_diverged_networks_are_told_of_and_not_kept(data: Dataset, tmp_path: Path) -> None:
    files = RunFolder(tmp_path / "run")
    config = replace(small(), scenario=data.scenario)
    files.create(config)
    learner = Learner(config, files, ReplayBuffer(10, 2))
    with torch.no_grad():
        next(learner.agent.actor.parameters()).fill_(float("nan"))
    with (
        Logger(files.path, 0, 0, False) as log,
        pytest.raises(RuntimeError, match="diverged after 0 updates"),
    ):
        learner.evaluate(log)
    assert not files.best.exists()


def test_changed_bags_and_foreign_folders_are_not_resumed(
    bag: Path, data: Dataset, tmp_path: Path
) -> None:
    offline.run(small(), data, tmp_path / "run", stop=after(3))
    about = json.loads((tmp_path / "run" / offline.DATA).read_text())
    assert [entry["path"] for entry in about["bags"]] == [str(bag)]
    about["digest"] = "0" * 64
    (tmp_path / "run" / offline.DATA).write_text(json.dumps(about))
    with pytest.raises(ValueError, match="the bags have changed"):
        offline.resume(tmp_path / "run")
    with pytest.raises(ValueError, match="no run of 'bicycle learn'"):
        offline.resume(tmp_path)
    with pytest.raises(ValueError, match="holds a run already"):
        offline.run(small(), data, tmp_path / "run")
    with pytest.raises(ValueError, match="ppo cannot learn from recorded rides"):
        offline.run(loading.preset("ppo"), data, tmp_path / "ppo")


@pytest.mark.parametrize(
    ("override", "name"),
    [
        ("ddpg.critic_sees=[speed]", "ddpg.critic_sees"),
        ("shaping.progress=1", "shaping"),
        ("teacher={controller: lqr, share: 0.5}", "teacher"),
    ],
)
def test_what_no_bag_holds_is_refused(override: str, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} works in simulation only"):
        ddpg_of(small(override))


# The command.


def command(*words: object) -> int:
    return main.main(["learn", *map(str, words)])


def small_words(out: Path) -> list[object]:
    words: list[object] = ["--out", out, "--least", 1000, "--quiet"]
    changes = [change for change in SMALL if not change.startswith("offline_updates")]
    return [*words, *(word for change in changes for word in ("--set", change))]


def test_the_command_describes_learns_and_prints_json(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(bag, "--seed", 5, "--updates", 120, "--json", *small_words(tmp_path / "r")) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["status"], result["updates"]) == ("finished", 120)
    assert result["data"]["transitions"] == result["transitions"]
    assert result["best"]["reach_rate"] >= 0
    assert loading.load(tmp_path / "r" / "config.yaml").seed == 5
    assert command(bag, "--report", "--least", 1000) == 0
    assert "falls" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "name the run's folder with --out DIR"),
        (["--out", "x"], "name a bag"),
        (["BAG", "--out", "x"], "too few to learn from"),
        (["nowhere", "--out", "x"], "there is no bag nowhere"),
        (["BAG", "--out", "x", "--preset", "offlin"], "did you mean 'offline'?"),
        (["BAG", "--out", "x", "--set", "ddpg.bc_wait=1"], "did you mean 'bc_weight'?"),
        (["--resume", "--out", "x", "--seed", "3"], "a resumed run has its own seed"),
        (["BAG", "--out", "x", "--scenario", "moon"], "unknown scenario 'moon'"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(
    bag: Path, words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(*(bag if word == "BAG" else word for word in words)) == USAGE_ERROR
    said = capsys.readouterr().err.strip().splitlines()
    assert line in said[-1]
    assert said[-1].startswith("bicycle learn: ")


def test_ctrl_c_saves_and_the_run_goes_on(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    advance, calls = Learner.advance, iter(range(100))

    def interrupted(self: Learner, *args: Any) -> None:
        advance(self, *args)
        if next(calls) == 4:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Learner, "advance", interrupted)
    words = ["--updates", 200, *small_words(tmp_path / "r")]
    assert command(bag, *words) == 128 + signal.SIGINT
    assert f"go on with: bicycle learn --resume --out {tmp_path / 'r'}" in capsys.readouterr().out
    assert command("--resume", "--out", tmp_path / "r", "--quiet") == 0
    assert "finished after 200 updates" in capsys.readouterr().out


@pytest.mark.slow
def test_an_actor_learns_to_stay_upright_from_recorded_rides_alone(tmp_path: Path) -> None:
    """Upright for 5 s after two and a half minutes of rides, where a fixed action falls."""
    bag = write_bag(tmp_path / "bag", Rider(sigma=0.15, seed=3).ride(6000))
    config = loading.preset(
        "offline",
        [
            "offline_updates=2000",
            "evaluation.every=500",
            "evaluation.episodes=64",
            "evaluation.near_episodes=0",
            "evaluation.max_steps=200",
            "ddpg.bc_alpha=0.1",
            "ddpg.batch=128",
            "tensorboard=false",
        ],
    )
    result = offline.run(config, dataset.load([bag]), tmp_path / "run")
    assert result.best is not None
    assert result.best.fall_rate < 0.1
    task = BicycleTask(config.scenario, count=64, rng=np.random.default_rng(0))
    for _ in range(200):
        step = task.step(np.zeros((64, 3)) + np.array([0.0, 0.01, 0.0]))
    assert step.fallen.all()
