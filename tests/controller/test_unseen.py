"""Gains on what no observation shows, as gains on the last commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bicycle_controller.control.lqr import INPUTS, STATES
from bicycle_controller.control.unseen import settled_in, through_commands
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant


@pytest.mark.parametrize(
    ("bicycle", "delay", "lag", "length"),
    [
        ("benchmark", 0.0, 0.0, 0),
        ("benchmark", 0.06, 0.0, 3),
        ("benchmark", 0.0, 0.03, 7),
        ("benchmark", 0.06, 0.03, 10),
        ("browser-leaning-rider", 0.05, 0.03, 9),
    ],
)
def test_the_last_commands_tell_the_motor_and_what_is_under_way(
    bicycle: str, delay: float, lag: float, length: int
) -> None:
    known = catalogue.load(bicycle).parameters
    plant = WhipplePlant(replace(known, delay=delay, motor=Motor(lag=lag)))
    model = plant.linearize(3.0, discrete=True)
    inputs = INPUTS[: len(model.inputs)]
    assert settled_in(model, STATES) == length
    rng = np.random.default_rng(2)
    hidden = [not (name in STATES or name.startswith("rider")) for name in model.states]
    gain = rng.normal(size=(2, len(model.states))) * hidden
    state, sent = np.zeros(len(model.states)), np.zeros((0, len(inputs)))
    for _ in range(40):
        command = rng.normal(size=len(inputs))
        state = model.a @ state + model.b @ command
        sent = np.concatenate([command[None], sent])
    found = through_commands(model, gain, STATES, inputs, length)
    reached = np.einsum("oli,li->o", found, sent[:length])
    np.testing.assert_allclose(reached, gain @ state, atol=0.02)


def test_the_papers_bicycle_hides_nothing() -> None:
    assert settled_in(ChoiPlant().linearize(2.0, discrete=True), STATES) == 0
