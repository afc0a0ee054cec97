"""Value of the safety layer: rides under faulty policies, with and without it.

Every shipped actor is made to fail in every way of `faulty_policies.py`, from the same
random starts to the same random goals, in numpy and without ROS. Sound actors ride too: their
rides must come to the same with and without the layer, which must never take over. The last
part is the envelope's ground: the largest extrapolated lean by speed, over ordinary rides.

    python tests/benchmarks/bench_safety.py [--rides 300] [--ordinary 10000] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from faulty_policies import FAULTS, Outcome, ride
from machine import machine
from tqdm import tqdm

from bicycle_controller.control.lqr import fitting
from bicycle_controller.control.safety import Safety, envelope
from bicycle_controller.evaluation.evaluate import wilson
from bicycle_controller.policy.policy import load_controller
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import Region, Scenario, named
from bicycle_sim.task.task import BicycleTask

RESULTS = Path(__file__).parent / "results" / "safety.json"
SEED = 11
SHIPPED = {
    "fixed-speed": "random-start-random-goal",
    "small-displacement": "random-small-displacement",
    "learned-speed": "learned-speed",
}
"""Actors and the scenarios that they ride in."""
NEAR = Region((0.0, 0.0), (60.0, 60.0))
"""m, where faulty rides start and end: less than the paper's field, to be done sooner."""
SPEEDS, LEANS = (values.tolist() for values in envelope(ChoiPlant()))
"""m/s and rad, the limit that was measured."""
STEPS = 1500
"""37.5 s, within which a faulty ride must reach its goal."""


def summary(outcome: Outcome) -> dict[str, Any]:
    """Return rates with their 95 % intervals (Wilson), and what the layer did."""
    count = len(outcome.steps)
    result: dict[str, Any] = {}
    for name, mask in (("reach", outcome.reached), ("fall", outcome.fallen)):
        hits = int(mask.sum())
        result[f"{name}_rate"] = hits / count
        result[f"{name}_rate_interval"] = [round(end, 5) for end in wilson(hits, count)]
    result["median_steps"] = float(np.median(outcome.steps))
    result["hand_overs_per_ride"] = round(float(outcome.hand_overs.mean()), 3)
    result["share_by_fallback"] = round(float(outcome.by_fallback.sum() / outcome.steps.sum()), 4)
    result["commands_cut_in_their_change"] = int(outcome.limited.sum())
    return result


def faulty_rides(actor: str, scenario: Scenario, count: int, bar: tqdm) -> dict[str, Any]:
    """Every fault of one actor, with and without the layer."""
    policy, physics = load_controller(actor), ChoiPlant()
    fallback = fitting(scenario.action_limits, physics)
    result: dict[str, dict[str, Any]] = {}
    for name, fault in FAULTS.items():
        layer = Safety(count=count)
        guarded = ride(policy, fault, scenario, count, SEED, layer, fallback)
        bare = ride(policy, fault, scenario, count, SEED)
        result[name] = {"with": summary(guarded), "without": summary(bare)}
        if name == "sound":
            same = all(
                np.array_equal(getattr(guarded, item), getattr(bare, item))
                for item in ("reached", "fallen", "steps")
            )
            result[name]["same_rides"] = same
        bar.update()
    return result


def ordinary(actor: str, scenario: Scenario, count: int) -> dict[str, Any]:
    """Largest values over ordinary rides; those that fell are left out and counted."""
    policy, limits = load_controller(actor), scenario.action_limits
    task = BicycleTask(scenario, ChoiPlant(), count, np.random.default_rng(SEED))
    layer, seen, last = Safety(count=count), task.observation(), None
    names = ("lean", "lean_rate", "slowest", "fastest", "torque", "displacement", "pedal_force")
    peaks = {name: np.zeros(count) for name in names}
    share = np.zeros((len(SPEEDS), count))
    over = np.zeros(count, dtype=bool)
    fallen = np.zeros(count, dtype=bool)
    peaks["slowest"] += np.inf
    while not over.all():
        speed = task.state.speed
        action = np.clip(policy.act(seen, speed), -limits, limits)
        change = np.zeros_like(action) if last is None else np.abs(action - last)
        values = (np.abs(seen[:, 2]), np.abs(seen[:, 3]), -speed, speed, *change.T)
        for name, value in zip(names, values, strict=True):
            new = (
                np.minimum(peaks[name], speed)
                if name == "slowest"
                else np.maximum(peaks[name], value)
            )
            peaks[name] = np.where(over, peaks[name], new)
        extrapolated = layer.extrapolated_lean(seen, speed)
        nearest = np.abs(speed[:, None] - np.array(SPEEDS)).argmin(axis=1)
        for index in range(len(SPEEDS)):
            here = (nearest == index) & ~over
            share[index] = np.where(here, np.maximum(share[index], extrapolated), share[index])
        last = action
        result = task.step(action)
        seen = result.observation
        fallen |= result.fallen & ~over
        over |= result.terminated | result.truncated | result.fallen
    sound = ~fallen
    found: dict[str, Any] = {"rides": count, "fell": int(fallen.sum())}
    for name in names:
        extreme = np.min if name == "slowest" else np.max
        label = f"change_of_{name}" if name in names[4:] else name
        found[label] = round(float(extreme(peaks[name][sound])), 5)
    found["extrapolated_lean_by_nearest_speed"] = {
        f"{at:g}": round(float(row[sound].max()), 4)
        for at, row in zip(SPEEDS, share, strict=True)
        if row.any()
    }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rides", type=int, default=300)
    parser.add_argument("--ordinary", type=int, default=10_000)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    result: dict[str, Any] = {**origin(), "machine": machine(), "seed": SEED, "rides": args.rides}
    result["envelope"] = dict(zip(map(str, SPEEDS), LEANS, strict=True))
    result["faults"], result["ordinary"] = {}, {}
    with tqdm(total=len(SHIPPED) * (len(FAULTS) + 1), unit="part") as bar:
        for actor, name in SHIPPED.items():
            scenario = named(name)
            near = replace(scenario, start=NEAR, goal=NEAR, max_steps=STEPS)
            result["faults"][actor] = faulty_rides(actor, near, args.rides, bar)
            result["ordinary"][actor] = ordinary(actor, scenario, args.ordinary)
            bar.update()
            args.out.write_text(json.dumps(result, indent=2) + "\n")
    for actor, faults in result["faults"].items():
        for fault, found in faults.items():
            rates = [
                found[kind][rate]
                for kind in ("without", "with")
                for rate in ("reach_rate", "fall_rate")
            ]
            print(f"{actor:20} {fault:36} " + " ".join(f"{rate:7.3f}" for rate in rates))


if __name__ == "__main__":
    main()
