"""Hidden state of a bicycle that no observation shows: a motor's torque, commands under way.

A linear gain on such states is a linear gain on the last commands: delayed commands are states
themselves, and a motor's torque is a linear function of earlier commands.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from bicycle_sim.plants.base import Linear

WAITING = re.compile(r"(\w+)\[-(\d+)\]")
"""A command that is sent but not yet in force, such as `torque[-2]`, two periods old."""
MOTOR = "motor_torque"
FORGOTTEN = 0.005
"""Share of a command's effect on the motor below which it is no longer remembered."""


def settled_in(model: Linear, seen: Sequence[str]) -> int:
    """Return the number of past commands from which the states that are not in `seen` follow."""
    ages = [int(found[2]) for name in model.states if (found := WAITING.fullmatch(name))]
    waiting = max(ages, default=0)
    if MOTOR not in model.states or MOTOR in seen:
        return waiting
    place = model.states.index(MOTOR)
    kept = abs(float(model.a[place, place]))
    periods = 1 if kept < FORGOTTEN else int(np.ceil(np.log(FORGOTTEN) / np.log(kept)))
    return waiting + periods


def through_commands(
    model: Linear,
    gain: np.ndarray,
    seen: Sequence[str],
    inputs: Sequence[str],
    length: int,
) -> np.ndarray:
    """Return a gain on states that are not in `seen` as one on the last commands.

    Args:
        model: discrete.
        gain: (outputs, n) on all states of the model.
        seen: states that observations show; the gains on them are left out.
        inputs: names of the commands that are remembered.
        length: number of past commands, see `settled_in`.

    Returns:
        (outputs, length, inputs), the newest command first. Gains on other states that no
        observation shows, a leaning rider's, are left out too.
    """
    found = np.zeros((len(gain), length, len(inputs)))
    columns = {}
    for index, name in enumerate(model.states):
        waiting = WAITING.fullmatch(name)
        if waiting:
            columns[int(waiting[2]), waiting[1]] = index
            if waiting[1] in inputs:
                found[:, int(waiting[2]) - 1, inputs.index(waiting[1])] += gain[:, index]
    if MOTOR in model.states and MOTOR not in seen:
        place = model.states.index(MOTOR)
        for number, name in enumerate(inputs):
            found[:, :, number] += np.outer(gain[:, place], _motor(model, place, name, length))
    return found


def _motor(model: Linear, place: int, name: str, length: int) -> np.ndarray:
    """Return the share of each of the last commands in the motor's present torque, (length,)."""
    kept = model.a[place, place]
    taken = np.zeros(length + 1)  # of the command of that age, in one period
    taken[0] = model.b[place, model.inputs.index(name)]
    for index, state in enumerate(model.states):
        waiting = WAITING.fullmatch(state)
        if waiting and waiting[1] == name:
            taken[int(waiting[2])] = model.a[place, index]
    share, shares = 0.0, np.zeros(length)
    for age in range(1, length + 1):  # given a period ago, it acted in the period since
        share = kept * share + taken[age - 1]
        shares[age - 1] = share
    return shares
