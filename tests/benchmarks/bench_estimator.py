"""Processor time of one reading and of one estimate, for one bicycle, in percentiles.

python tests/benchmarks/bench_estimator.py
"""

from __future__ import annotations

import json
import time

import numpy as np

from bicycle_controller.estimation.kalman import Filter
from bicycle_controller.estimation.queue import Arrivals
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.suite import SensorSuite


def main() -> None:
    plant = registry.named("whipple", "browser-rider")
    given = sensors.load("mpu6050-rtk")
    suite, arrivals, result = SensorSuite(given, plant, 1, 0), Arrivals(), Filter(plant, given)
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
    found = {
        name: {
            "median_ms": round(1e3 * float(np.median(values)), 3),
            "p99_ms": round(1e3 * float(np.quantile(values, 0.99)), 3),
            "count": len(values),
        }
        for name, values in spent.items()
    }
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
