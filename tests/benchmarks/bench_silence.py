"""Measure who is upright ten seconds after commands have stopped: `silence.json`.

Bicycles ride straight on under the LQR, with gyroscope noise and shoved at random, until the
commands stop: then the last one is held for a quarter of a second, as the simulator's watchdog
does, and a law takes over.
"""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine

from bicycle_common import steer_into_lean
from bicycle_controller.control.lqr import LqrController
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Motor
from bicycle_sim.plants.whipple.plant import WhipplePlant

OUT = Path(__file__).parent / "results" / "silence.json"
BICYCLES = ("browser-rider", "balance-assist", "steer-by-wire")
SPEEDS = (1.5, 2.0, 3.0, 4.0, 5.0)
LIMIT = 7.0
"""N m."""
RIDES = 200
SHOVES = 0.0873
"""rad/s, standard deviation of the lean rate after a second of shoves, 5 deg/s."""
NOISE = 0.01
"""rad/s, standard deviation of the gyroscope's noise."""
BEFORE, AFTER = 4.0, 10.0
"""s under the LQR, s without commands."""


def upright(
    bicycle: str, speed: float, held: float, gain: float, rides: int = RIDES, seed: int = 0
) -> tuple[float, float | None]:
    """Return the share of rides that is upright at the end, and the median time to a fall, s.

    Args:
        bicycle: a name.
        speed: m/s.
        held: s for which the last command is held.
        gain: of steering into the lean; 0 is no torque.
        rides: N.
        seed: of shoves and noise.
    """
    known = catalogue.load(bicycle).parameters
    plant = WhipplePlant(replace(known, motor=Motor(limit=LIMIT)))
    lqr, rng, dt = LqrController.named("lqr", plant), np.random.default_rng(seed), plant.time_step
    zero = np.zeros(rides)
    state = plant.initial(zero, zero, zero, np.full(rides, speed))
    shove = SHOVES * np.sqrt(dt)
    torque, fell = zero, np.full(rides, np.inf)
    begins, ends = round(BEFORE / dt), round((BEFORE + AFTER) / dt)
    for step in range(ends):
        if step < begins:
            state = plant.pushed(state, rng.normal(0.0, shove, rides))
        rate = state.lean_rate + rng.normal(0.0, NOISE, rides)
        if step < begins:
            seen = [state.steer_angle, state.steer_rate, state.lean_angle, rate]
            seen += [state.lean_acceleration, state.heading]
            torque = lqr.act(np.array(seen).T, state.speed)[:, 0]
        elif (step - begins) * dt >= held:
            torque = zero
            if gain > 0:
                torque = steer_into_lean.torque(rate, state.speed, LIMIT, gain)
        state = plant.step(state, torque, zero, zero)
        lies = plant.fallen(state, np.pi / 6)
        fell = np.where(lies & np.isinf(fell), (step + 1 - begins) * dt, fell)
    late = fell[np.isfinite(fell)]
    return float(np.isinf(fell).mean()), float(np.median(late)) if len(late) else None


LAWS = {
    "held 0.25 s, then zero": (0.25, 0.0),
    "held 0.25 s, then kappa 10": (0.25, 10.0),
    "held 0.25 s, then kappa 20": (0.25, 20.0),
    "held 0.1 s, then kappa 20": (0.1, 20.0),
    "kappa 20 at once": (0.0, 20.0),
}


def main() -> None:
    """Measure, print and write the table."""
    found: dict[str, Any] = {
        "machine": machine(),
        "command": shlex.join(["python", *sys.argv]),
        "rows": [],
    }
    for bicycle in BICYCLES:
        for name, (held, gain) in LAWS.items():
            cells = [upright(bicycle, speed, held, gain) for speed in SPEEDS]
            shown = [f"{100 * share:.0f} %" + (f" ({t:.1f} s)" if t else "") for share, t in cells]
            print(f"| {bicycle} | {name} | {' | '.join(shown)} |", flush=True)
            row = {"bicycle": bicycle, "law": name, "speeds": SPEEDS}
            row |= {
                "upright": [share for share, _ in cells],
                "fall_s": [late for _, late in cells],
            }
            found["rows"].append(row)
    OUT.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
