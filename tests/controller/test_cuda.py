"""The same training code on a GPU; skipped where there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from run_compare import after, assert_same_run
from training_maker import small_run

from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.policy.devices import actor_on
from bicycle_controller.policy.policy import load_policy
from bicycle_controller.training import online
from bicycle_sim.task.scenario import named

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")

FEW = ("device=cuda", "steps=4000", "evaluation.episodes=8", "tensorboard=false")
RUNS: dict[str, RunConfig] = {
    "paper": small_run("device=cuda"),
    "autograd": small_run("device=cuda", "ddpg.backend=autograd"),
    "fast": small_run("device=cuda", preset="fast"),
    "naf": loading.preset("naf", [*FEW, "bicycles=8", "warm_up=200"]),
    "ppo": loading.preset("ppo", [*FEW, "ppo.rollout=32"]),
}


@pytest.mark.parametrize("name", RUNS)
def test_a_run_is_repeated_and_resumed_to_the_bit(name: str, tmp_path: Path) -> None:
    config = RUNS[name]
    assert online.run(config, tmp_path / "one").status == "finished"
    online.run(config, tmp_path / "two", stop=after(17))
    assert online.resume(tmp_path / "two").status == "finished"
    assert_same_run(tmp_path / "one", tmp_path / "two")


def test_a_policy_rides_there_as_here() -> None:
    policy, scenario = load_policy(), named("random-start-random-goal")
    here, there = (
        evaluate(actor_on(policy, device), scenario, episodes=200).rides
        for device in ("cpu", "cuda")
    )
    assert (here.reached == there.reached).all()
    np.testing.assert_allclose(here.path, there.path, atol=0.1)
