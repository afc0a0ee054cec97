"""Largest kick caught by the actor for any bicycle, beside the best LQR of a grid for each.

    python tests/benchmarks/bench_any_bicycle.py any-bicycle --out any_bicycle.json

Measured bicycles, at five speeds and three delays, with a motor of 7 N m that lags by 30 ms, all
at once.

A cell is one bicycle at one speed under one delay: the least of four kicks, left and right,
riding straight and in a turn, found by bisection. The yardstick is the best of ten sets of weights
(`evaluation.lqr_grid.GRID`) in that cell; these regulators are told the bicycle, its delay and its
lag and see the motor's torque, the actor is told nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_controller.config.imitation import TeacherWeights, TurnConfig
from bicycle_controller.control.riding import Riding
from bicycle_controller.evaluation.lqr_grid import GRID
from bicycle_controller.policy.policy import Policy, load_policy, write_atomically
from bicycle_controller.training.run_folder import origin
from bicycle_controller.training.teachers import COMMANDS, Seen, Teachers
from bicycle_sim.plants import registry
from bicycle_sim.plants.whipple.parameters import Bicycle, Motor, Parameters
from bicycle_sim.plants.whipple.plant import WhipplePlant

BICYCLES = (
    "benchmark", "browser", "browser-rider", "balance-assist", "balance-assist-rider",
    "steer-by-wire", "pista-rider", "rigid-rider", "yellow", "silver", "fisher", "crescendo",
)  # fmt: skip
SPEEDS = (1.5, 2.0, 3.0, 4.0, 6.0)
"""m/s."""
DELAYS = (0.025, 0.05, 0.075)
"""s."""
LIMIT, LAG = 7.0, 0.03
"""N m and s of the motor."""
BEFORE, AFTER = 160, 160
"""Control periods before and after the kick."""
MOST, BISECTIONS = 300.0, 8
"""deg/s, and halvings of it: 1.2 deg/s remain."""
LEAST = 3.0
"""deg/s that the best LQR must catch for a cell to count."""
LEAN, STEER = np.pi / 6, np.pi / 3
DESIGNS = np.linspace(0.75, 7.0, 11)

Answer = Callable[[Any, np.ndarray], np.ndarray]
"""Torques (N,) for a state and heading errors (N,)."""


def main() -> int:
    """Measure, print a table and write the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("policies", nargs="+", help="names or files")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    begun = time.process_time()
    cells = list(product(BICYCLES, DELAYS, SPEEDS))
    bicycles = Many(cells)
    grid = np.array([bicycles.largest(partial(bicycles.regulators, w)) for w in weights()])
    best = grid.max(axis=0)
    counts = best > LEAST
    result: dict[str, Any] = {
        "origin": origin(), "limit": LIMIT, "lag": LAG, "cells": cells, "best": best.tolist(),
        "policies": {},
    }  # fmt: skip
    for name in args.policies:
        policy = load_policy(name)
        caught = bicycles.largest(partial(bicycles.actor, policy))
        share = caught / np.maximum(best, 1e-9)
        result["policies"][name] = {"id": policy.policy_id, "caught": caught.tolist()}
        print(name)
        for delay in DELAYS:
            row = counts & np.array([cell[1] == delay for cell in cells])
            means = [
                f"{v:g} m/s {share[row & at].mean():.2f}/{share[row & at].min():.2f}"
                for v in SPEEDS
                for at in [np.array([cell[2] == v for cell in cells])]
            ]
            print(
                f"{1000 * delay:3.0f} ms: mean {share[row].mean():.3f},"
                f" worst {share[row].min():.2f},"
                f" cells at 0.9 or more {np.mean(share[row] >= 0.9):.1%};",
                ", ".join(means),
            )
        result["policies"][name]["share"] = np.where(counts, share, np.nan).tolist()
    result["cpu_s"] = time.process_time() - begun
    print(f"{int((~counts).sum())} cells do not count; {result['cpu_s']:.0f} s of processor time")
    if args.out is not None:
        text = json.dumps(result).replace("NaN", "null")
        write_atomically(args.out, text.encode() + b"\n")
    return 0


def weights() -> list[TeacherWeights]:
    """Return the grid's weights; its heading weights concern another heading loop."""
    kinds = {(w.lean, w.lean_rate, w.steer, w.steer_rate, w.torque) for w in GRID}
    return [TeacherWeights(*numbers) for numbers in sorted(kinds)]


def measured(rows: list[tuple[str, float]]) -> WhipplePlant:
    """Return measured bicycles, one for each name and delay in s, with the motor of all cells."""
    plants = [registry.named("whipple", name) for name, _ in rows]
    bicycles = [p.parameters.bicycle for p in plants if isinstance(p, WhipplePlant)]
    numbers = {
        item.name: np.array([float(getattr(b, item.name)) for b in bicycles])
        for item in fields(Bicycle)
    }
    count = len(rows)
    return WhipplePlant(
        Parameters(
            Bicycle(**numbers),
            name="measured",
            motor=Motor(limit=np.full(count, LIMIT), lag=np.full(count, LAG)),
            delay=np.array([delay for _, delay in rows]),
            substeps=5,
        )
    )


class Many:
    """All cells at once, four rides of each."""

    def __init__(self, cells: list[tuple[str, float, float]]) -> None:
        """Build the plant."""
        rows = [cell for cell in cells for _ in range(4)]
        self.plant = measured([(name, delay) for name, delay, _ in rows])
        self.speed = np.array([speed for *_, speed in rows])
        self.sign = np.tile([1.0, -1.0, 1.0, -1.0], len(cells))
        radius = np.maximum(5.0, self.speed**2 / (9.81 * np.tan(0.1)))
        self.yaw_rate = np.tile([0.0, 0.0, 1.0, 1.0], len(cells)) * self.speed / radius

    def largest(self, make: Callable[[], Answer]) -> np.ndarray:
        """Return the least of each cell's four largest kicks, deg/s."""
        count = len(self.speed)
        low, high = np.zeros(count), np.full(count, MOST)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            good = self.catches(make(), np.radians(middle) * self.sign)
            low, high = np.where(good, middle, low), np.where(good, high, middle)
        found: np.ndarray = low.reshape(-1, 4).min(axis=1)
        return found

    def catches(self, answer: Answer, kick: np.ndarray) -> np.ndarray:
        """Return whether each ride catches its kick."""
        zero = np.zeros(len(kick))
        state, wanted = self.plant.initial(zero, zero, zero, self.speed), zero
        good = np.ones(len(kick), dtype=bool)
        for period in range(BEFORE + AFTER):
            if period == BEFORE:
                state = self.plant.pushed(state, kick)
            torque = np.clip(answer(state, wrap_angle(state.heading - wanted)), -LIMIT, LIMIT)
            state = self.plant.step(state, torque, zero, zero)
            wanted = wanted + self.yaw_rate * self.plant.time_step
            good &= (np.abs(state.lean_angle) < LEAN) & (np.abs(state.steer_angle) < STEER)
        return good

    def regulators(self, weights: TeacherWeights) -> Answer:
        """Return each cell's own LQR."""
        limits = np.full(len(self.speed), LIMIT)
        teachers = Teachers(self.plant, weights, TurnConfig(), DESIGNS, limits)
        commands = np.zeros((len(limits), COMMANDS))

        def answer(state: Any, error: np.ndarray) -> np.ndarray:
            torque = teachers.act(Seen.of(state, error, commands))
            commands[:] = np.column_stack([torque, commands[:, :-1]])
            return torque

        return answer

    def actor(self, policy: Policy) -> Answer:
        """Return one actor for all cells."""
        riding = Riding(policy, len(self.speed), self.plant)

        def answer(state: Any, error: np.ndarray) -> np.ndarray:
            seen = np.column_stack(
                [
                    state.steer_angle, state.steer_rate, state.lean_angle, state.lean_rate,
                    state.lean_acceleration, error,
                ]
            )  # fmt: skip
            action = np.clip(riding.act(seen, state.speed), -LIMIT, LIMIT) * (1.0, 0.0, 0.0)
            riding.acted(seen, state.speed, action)
            return np.asarray(action[:, 0])

        return answer


if __name__ == "__main__":
    sys.exit(main())
