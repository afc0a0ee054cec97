"""Imitation of each bicycle's LQR, from the command line to the policy that rides."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_compare import after, assert_same_run
from train_process import bicycle_train, struck, went_on

from bicycle_controller.cli import main
from bicycle_controller.config import loading
from bicycle_controller.config.imitation import ImitationConfig
from bicycle_controller.policy.policy import Policy, load_policy
from bicycle_controller.training import imitation
from bicycle_controller.training.bicycle_park import SPEEDS, Park

SMALL = [
    "bicycles=64",
    "steps=9600",
    "warm_up=640",
    "log_every=20",
    "tensorboard=false",
    "imitation.rounds=1",
    "imitation.rows=8000",
    "imitation.batch=256",
    "imitation.hidden=[16, 16]",
    "imitation.periods=4",
    "evaluation.episodes=4",
    "evaluation.max_steps=100",
]


def own(*changes: str) -> ImitationConfig:
    found = loading.preset("any-bicycle", [*SMALL, *changes]).imitation
    assert found is not None
    return found


def test_a_run_ends_with_a_policy_for_any_bicycle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = [word for change in SMALL for word in ("--set", change)]
    out = tmp_path / "run"
    words = ["train", "--preset", "any-bicycle", "--out", str(out), "--json", "--quiet", *sets]
    assert main.main(words) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["status"], result["steps"]) == ("finished", 9600)
    policy = load_policy(out)
    assert policy.memory == 4
    assert policy.info.plants == ("whipple",)
    assert policy.info.speeds == (0.9, 6.6)
    assert policy.info.trained["teachers"] == "each random bicycle's own LQR"
    rows = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [row["kind"] for row in rows][-1] == "evaluation"
    assert likeness(policy) > 0.6


def likeness(policy: Policy) -> float:
    """The correlation of its torques with the teachers' on rides of bicycles it has not seen."""
    park = Park(own(), 64, policy.memory, np.random.default_rng(77))
    pairs = []
    for _ in range(60):
        wanted = park.taught_torque()
        chosen = policy.act(park.seen, park.speed, park.past)[:, 0]
        pairs.append((wanted, np.clip(chosen, -park.limits, park.limits)))
        park.step(wanted, 1.0)
    first, second = (np.concatenate(values) for values in zip(*pairs, strict=True))
    return float(np.corrcoef(first, second)[0, 1])


THREE_ROUNDS = ("imitation.rounds=3", "steps=6400", "save_every=0.05", "log_every=10")
"""A run whose bicycles are drawn three times."""


def test_a_resumed_run_gives_the_same_numbers_to_the_bit(tmp_path: Path) -> None:
    config = loading.preset("any-bicycle", [*SMALL, *THREE_ROUNDS])
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert imitation.run(config, whole).status == "finished"
    first = imitation.run(config, parts, stop=after(25))
    assert (first.status, first.steps) == ("interrupted", 26 * 64)
    # The second part begins and ends within later rounds.
    assert imitation.resume(parts, stop=after(30)).status == "interrupted"
    result = imitation.resume(parts)
    assert (result.status, result.steps) == ("finished", 6400)
    assert result.updates > first.updates > 0
    assert_same_run(whole, parts)


def test_a_run_that_signals_end_goes_on_to_the_same_end(tmp_path: Path) -> None:
    config = loading.preset("any-bicycle", [*SMALL, *THREE_ROUNDS])
    imitation.run(config, tmp_path / "whole")
    parts = tmp_path / "parts"
    said = struck(bicycle_train(parts, config=config), parts, 3, signal.SIGINT)
    assert f"go on with: bicycle train --resume --out {parts}" in said
    struck(bicycle_train(parts, "--resume"), parts, 9, signal.SIGKILL)
    assert "finished after 6400 steps" in went_on(bicycle_train(parts, "--resume"))
    assert_same_run(tmp_path / "whole", parts)


def test_the_teacher_s_rides_do_not_fall_without_kicks() -> None:
    config = own("imitation.riding.kick_share=0.0", "imitation.riding.gust=0.0")
    park = Park(config, 64, 4, np.random.default_rng(1))
    good = park.caught.min(axis=0) > 5.0
    assert good.mean() > 0.6
    fallen = 0
    for _ in range(200):
        park.step(park.taught_torque(), 1.0)
        fallen += park.metrics()["fall_share"] > 0
    assert park.caught.shape == (len(SPEEDS), 64)
    assert fallen < 30


def test_the_actor_sees_noise_and_the_teacher_does_not() -> None:
    park = Park(own(), 64, 4, np.random.default_rng(2))
    np.testing.assert_array_equal(park.state.lean_angle, np.zeros(64))
    assert np.abs(park.seen[:, 2]).max() > 0.001
    assert not park.taught_torque().any()
    quiet = replace(own(), riding=replace(own().riding, noise=0.0))
    assert not Park(quiet, 64, 4, np.random.default_rng(2)).seen[:, 2].any()


def test_what_it_remembers_is_what_happened() -> None:
    park = Park(own(), 64, 4, np.random.default_rng(3))
    kept = []
    for _ in range(5):
        kept.append((park.seen.copy(), park.rides))
        park.step(park.taught_torque() + 0.5, 0.0)
    same = park.past.observation[:, 0, 2] == kept[-1][0][:, 2]
    begun = ~same
    assert begun.sum() <= park.rides
    assert same.mean() > 0.9
    limits = park.limits[same]
    assert (np.abs(park.past.action[same, 0, 0]) <= limits + 1e-12).all()


def test_an_input_that_it_does_not_know_is_told() -> None:
    with pytest.raises(ValueError, match=r"imitation\.before"):
        replace(own(), before=("displacement",))
    with pytest.raises(ValueError, match="what the actor chooses"):
        replace(own(), now=("torque",))


def test_other_trainings_refuse_it() -> None:
    with pytest.raises(ValueError, match="bicycle train"):
        _ = loading.preset("any-bicycle").learner
