"""Training on harder rides: speeds, kicks, late actions, two physics at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bicycle_controller.config import loading
from bicycle_controller.training import online
from bicycle_controller.training.factory import make_collector, make_memory
from bicycle_sim.plants import registry

SMALL = [
    "bicycles=32",
    "warm_up=100000",
    "steps=640",
    "ddpg.actor_hidden=[8]",
    "ddpg.critic_hidden=[8]",
]


def rates(*changes: str) -> tuple[np.ndarray, np.ndarray]:
    """Lean rates and speeds of 32 bicycles on their first 40 steps, without exploration."""
    config = loading.preset(
        "sure", [*SMALL, "warm_up=0", "noise.sigma=0", "noise.sigma_max=0", *changes]
    )
    collector = make_collector(config, make_memory(config, "cpu"), "cpu")

    class Idle:
        def act(self, observation: np.ndarray) -> np.ndarray:
            return np.zeros((len(observation), 2))

    found = []
    for _ in range(40):
        collector.step(Idle())
        found.append(collector.task.state.lean_rate.copy())
    return np.array(found), collector.task.state.speed


def test_speeds_are_drawn() -> None:
    speed = rates()[1]
    assert speed.min() < 2.0 < 4.0 < speed.max()
    assert np.ptp(rates("starts.speeds=null")[1]) < 1e-9


def test_kicks_come_at_their_rate() -> None:
    changes = ("starts.tilt=0", "starts.tilt_rate=0", "starts.steer=0", "starts.steer_rate=0")
    jumps = np.abs(np.diff(rates(*changes, "starts.kick_every=0.5")[0], axis=0)) > 0.15
    assert 20 < jumps.sum() < 200
    calm = np.abs(np.diff(rates(*changes, "starts.kick=0.0")[0], axis=0))
    assert calm.max() < 0.15


def test_the_preset_rides_both_physics() -> None:
    config = loading.preset("sure")
    assert config.physics_too == registry.named(physics="corrected")


def test_a_run_goes_on_to_the_bit(tmp_path: Path) -> None:
    config = loading.preset(
        "sure", [*SMALL, "warm_up=320", "evaluation.every=1000", "tensorboard=false"]
    )
    whole = online.run(config, tmp_path / "whole")
    calls = iter(range(1000))
    online.run(config, tmp_path / "parts", stop=lambda: next(calls) > 14)
    online.resume(tmp_path / "parts")
    assert whole.status == "finished"
    files = [(tmp_path / name / "last.safetensors").read_bytes() for name in ("whole", "parts")]
    sizes = [int.from_bytes(data[:8], "little") for data in files]
    assert files[0][8 + sizes[0] :] == files[1][8 + sizes[1] :]


def test_bad_values_are_told() -> None:
    with pytest.raises(ValueError, match=r"starts\.speeds"):
        loading.preset("fast", ["starts.speeds=[3, 1]"])
    with pytest.raises(ValueError, match=r"starts\.delay"):
        loading.preset("fast", ["starts.delay=-1"])
