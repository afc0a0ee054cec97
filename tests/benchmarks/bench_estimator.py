"""Processor time of one reading and of one estimate, for one bicycle, in percentiles.

    python tests/benchmarks/bench_estimator.py

Writes `docs/results/hardware/estimator.json`.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from machine import machine

from bicycle_common.origin import made_by
from bicycle_controller.estimation.kalman import Filter
from bicycle_controller.estimation.queue import Arrivals
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.suite import SensorSuite

OUT = Path(__file__).parents[2] / "docs" / "results" / "hardware" / "estimator.json"
BICYCLE, SENSORS = "browser-rider", "mpu6050-rtk"


def measured(compiled: bool) -> dict[str, list[float]]:
    """Return the processor times, s, of 20 s of riding, by what was computed."""
    plant = registry.named("whipple", BICYCLE)
    given = sensors.load(SENSORS)
    suite, arrivals = SensorSuite(given, plant, 1, 0), Arrivals()
    result = Filter(plant, given, compiled=compiled)
    zero = np.zeros(1)
    state = plant.initial(zero, zero, zero, np.array([6.0]))
    arrivals.add(suite.rest(state))
    spent: dict[str, list[float]] = {"estimate": []}
    for _ in range(800):
        for reading, mask in arrivals.due(suite.time):
            begun = time.thread_time()
            result.take(reading, mask)
            spent.setdefault(reading.sensor, []).append(time.thread_time() - begun)
        begun = time.thread_time()
        result.estimate(suite.time)
        spent["estimate"].append(time.thread_time() - begun)
        trace = plant.trace(state, zero, zero, zero)
        arrivals.add(suite.advance(trace, plant.time_step))
        state = trace[-1]
    return spent


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--numpy", action="store_true", help="the estimator without a compiler")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    result = {
        **made_by(),
        "machine": machine("numpy"),
        "bicycle": BICYCLE,
        "sensors": SENSORS,
        "processor_time": {
            name: {
                "median_ms": round(1e3 * float(np.median(values)), 3),
                "p99_ms": round(1e3 * float(np.quantile(values, 0.99)), 3),
                "count": len(values),
            }
            for name, values in measured(not given.numpy).items()
        },
    }
    given.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
