"""Falls in rides with sensor noise and turns, of the actor for any bicycle and of each one's LQR.

    python tests/benchmarks/bench_noisy_rides.py any-bicycle --rides 120 --out noisy_rides.json

Twelve measured bicycles with a motor of 7 N m that lags by 30 ms, at seven speeds and three
delays. A ride takes 24 s. Its wanted heading jumps to another one every 4 s, by up to 90 degrees
to either side. What the controller sees of lean, lean rate and steering has white noise and a
bias, and the steering rate has white noise, as the training rides have at most. A bicycle that
leans 30 degrees or steers 60 has fallen.

The regulators beside it are each bicycle's own and know the bicycle, its delay and its lag.
`lqr` has one set of weights for all and sees the same noisy state. `teachers` are those of the
preset sure-any-bicycle and see the noisy state, too; `teachers-true` are the same with the true
state, which is what an actor can hope for, and `first-teachers-true` those of any-bicycle. Each
cell is written as it comes.

`--random 9001` rides random bicycles of that seed, `--rides` of them and each once, in place of
the measured ones: whoever tunes an actor compares with these.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from bench_any_bicycle import BICYCLES, DELAYS, DESIGNS, LAG, LEAN, LIMIT, STEER, measured

from bicycle_common.geometry import wrap_angle
from bicycle_controller.config import loading
from bicycle_controller.config.imitation import RidingConfig, TeacherWeights, TurnConfig
from bicycle_controller.control.riding import Riding
from bicycle_controller.policy.policy import load_policy, write_atomically
from bicycle_controller.training.bicycle_park import teachers_of
from bicycle_controller.training.run_folder import origin
from bicycle_controller.training.teachers import COMMANDS, Seen, Teachers
from bicycle_sim.plants.whipple import random_bicycles
from bicycle_sim.plants.whipple.parameters import Resistance
from bicycle_sim.plants.whipple.plant import WhipplePlant

SPEEDS = (1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0)
"""m/s at which the rides begin; nothing holds them."""
SECONDS, TURN_EVERY = 24.0, 4.0
"""s."""
NOISE = RidingConfig()
LQR = TeacherWeights(lean=10.0, lean_rate=1.0, steer=1.0, steer_rate=0.1, torque=0.1)
"""Weights of `lqr`, those that real bicycles have in `control.lqr`."""
TEACHERS = {
    "teachers": "sure-any-bicycle",
    "teachers-true": "sure-any-bicycle",
    "first-teachers-true": "any-bicycle",
}
"""Presets of the teachers; those whose name ends in `true` see the true state."""
REGULATORS = ("lqr", *TEACHERS)


def main() -> int:
    """Ride, print a row for each cell, and write the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("policies", nargs="+", help=f"names, files, or {', '.join(REGULATORS)}")
    parser.add_argument("--rides", type=int, default=120, help="of each bicycle in each cell")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--random", type=int, help="seed of random bicycles to ride instead")
    parser.add_argument("--delays", type=float, nargs="+", default=DELAYS, help="s")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    bicycles = BICYCLES if args.random is None else (f"random, seed {args.random}",)
    result: dict[str, Any] = {
        "origin": origin(), "limit_nm": LIMIT, "rides": args.rides * len(bicycles),
        "bicycles": bicycles, "seed": args.seed, "cells": [],
        "policies": {n: load_policy(n).policy_id for n in args.policies if n not in REGULATORS},
    }  # fmt: skip
    for name, delay, speed in product(args.policies, args.delays, SPEEDS):
        rng = np.random.default_rng((args.seed, round(1000 * delay), round(100 * speed)))
        if args.random is None:
            plant = measured([(bicycle, delay) for bicycle in BICYCLES for _ in range(args.rides)])
        else:
            plant = drawn(args.rides, delay, args.random)
        fell = falls(name, plant, speed, rng).reshape(len(bicycles), -1).sum(axis=1)
        by_name = {b: int(n) for b, n in zip(bicycles, fell, strict=True) if n}
        cell = {"controller": name, "delay_s": delay, "speed": speed, "falls": int(fell.sum())}
        result["cells"].append(cell | {"by_bicycle": by_name})
        print(*cell.values(), f"of {result['rides']}", by_name or "", flush=True)
        if args.out is not None:
            write_atomically(args.out, json.dumps(result, indent=1).encode() + b"\n")
    return 0


def drawn(count: int, delay: float, seed: int) -> WhipplePlant:
    """Return random bicycles with the motor of all cells, on a level road without wind or drag."""
    none = (0.0, 0.0)
    ranges = random_bicycles.Ranges(
        torque_limit=(LIMIT, LIMIT), delay=(delay, delay), motor_lag=(LAG, LAG), friction=none,
        damping=none, grade=none, wind=none, plain_share=0.0,
    )  # fmt: skip
    parameters = random_bicycles.draw(count, np.random.default_rng(seed), ranges, 5)
    return WhipplePlant(replace(parameters, resistance=Resistance()))


def falls(name: str, plant: WhipplePlant, speed: float, rng: np.random.Generator) -> np.ndarray:
    """Return which rides end in a fall, bool (N,)."""
    count = plant.count
    assert count is not None
    zero, limits = np.zeros(count), np.full(count, LIMIT)
    state, wanted = plant.initial(zero, zero, zero, np.full(count, speed)), zero
    pairs = NOISE.lean_noise, NOISE.rate_noise, NOISE.steer_noise
    told = 0.0 if name.endswith("-true") else 1.0
    white = told * np.array([pair[0] for pair in pairs])
    most = told * np.array([pair[1] for pair in pairs])
    bias = rng.uniform(-most, most, (count, 3))
    if name == "lqr":
        teachers: Any = Teachers(plant, LQR, TurnConfig(), DESIGNS, limits)
    elif name in REGULATORS:
        config = loading.preset(TEACHERS[name]).imitation
        assert config is not None
        teachers, _ = teachers_of(plant, limits, config)
    else:
        riding = Riding(load_policy(name), count, plant)
    commands = np.zeros((count, COMMANDS))
    upright = np.ones(count, dtype=bool)
    for period in range(round(SECONDS / plant.time_step)):
        if period and period % round(TURN_EVERY / plant.time_step) == 0:
            wanted = wanted + rng.uniform(-np.pi / 2, np.pi / 2, count)
        error = wrap_angle(state.heading - wanted)
        noise = bias + white * rng.standard_normal((count, 3))
        lean, lean_rate = state.lean_angle + noise[:, 0], state.lean_rate + noise[:, 1]
        steer = state.steer_angle + noise[:, 2]
        steer_rate = state.steer_rate + told * NOISE.steer_rate_noise * rng.standard_normal(count)
        if name in REGULATORS:
            torque = teachers.act(
                Seen(
                    lean,
                    lean_rate,
                    steer,
                    steer_rate,
                    error,
                    state.speed,
                    state.motor_torque,
                    commands,
                )
            )
            commands = np.column_stack([torque, commands[:, :-1]])
        else:
            seen = np.column_stack(
                [steer, steer_rate, lean, lean_rate, state.lean_acceleration, error]
            )
            action = np.clip(riding.act(seen, state.speed), -LIMIT, LIMIT) * (1.0, 0.0, 0.0)
            riding.acted(seen, state.speed, action)
            torque = action[:, 0]
        state = plant.step(state, torque, zero, zero)
        upright &= (np.abs(state.lean_angle) < LEAN) & (np.abs(state.steer_angle) < STEER)
    return ~upright


if __name__ == "__main__":
    sys.exit(main())
