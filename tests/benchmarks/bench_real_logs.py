"""Run the estimator, open loop, on logs of a real bicycle: writes `real-logs.json`.

The logs are of a riderless steer-by-wire bicycle that balances itself on a treadmill
(mechmotum/sbw_bicycle_with_model_matching, MIT): roll gyro less its bias, steer encoder, speed as
a mean of 5 s, commanded torque, at 100 Hz. They have neither yaw gyro nor accelerometer, so the
filter runs on three of its five measurements. Beside it stands the lean that the bicycle's own
firmware estimated: a gyro's integral, drawn by 5 % towards the lean of a steady turn, its mean
taken away. Nobody measured the true lean.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine

from bicycle_common.origin import made_by
from bicycle_controller.estimation.kalman import Filter
from bicycle_sim.plants import registry
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import from_dict

OUT = Path(__file__).parents[2] / "docs" / "results" / "hardware" / "real-logs.json"
RATE = 100.0
SETTLING = 5.0
"""s after the start, and after each stop, that are not counted."""
SLOWEST = 1.2
"""m/s from which on it counts as riding."""
SENSORS: dict[str, Any] = {
    "rest": 0.0,
    "imu": {"gyro_bias": 0.01, "gyro_noise": 1e-3, "vibration": 0.0},
    "steer": {"counts": 8192, "offset": 0.02},
    "wheel": {"ticks": 0, "average": 0.2, "scale": 0.05},
}


def load(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a log."""
    with gzip.open(path, "rt") as file:
        names = file.readline().strip().split(",")
        values = np.loadtxt(file, delimiter=",")
    return dict(zip(names, values.T, strict=True))


def reading(sensor: str, time: float, *values: float) -> Reading:
    """Return a reading that came at once."""
    zero = np.zeros(1)
    return Reading(sensor, time, zero + time, np.zeros(1, dtype=bool), np.array([values]))


def estimated(log: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return lean and its standard deviation (n,), rad to the right, NaN where it stands."""
    plant = registry.named("whipple", "steer-by-wire")
    estimator = Filter(plant, from_dict(SENSORS))
    count = len(log["speed"])
    lean, spread = np.full(count, math.nan), np.full(count, math.nan)
    riding = False
    for row in range(count):
        time = (row + 1) / RATE
        if log["speed"][row] < SLOWEST:
            riding = False
            continue
        if not riding:
            riding = True
            estimator.restart(time - 1.0 / RATE)
        unknown = (math.nan,) * 5
        estimator.take(reading("imu", time, float(log["lean_rate"][row]), *unknown))
        steer, torque = -float(log["fork_angle"][row]), -float(log["command_fork"][row])
        estimator.take(reading("steer", time, steer, torque))
        estimator.take(reading("wheel", time, float(log["speed"][row])))
        now = estimator.estimate(time)
        lean[row] = -float(now.lean_angle[0])
        spread[row] = math.sqrt(float(now.covariance[0, 0, 0]))
    return lean, spread


def compared(log: dict[str, np.ndarray]) -> dict[str, float]:
    """Return how the two leans agree, degrees."""
    ours, spread = estimated(log)
    settled = np.zeros(len(ours), dtype=bool)
    wait = round(SETTLING * RATE)
    since = 0
    for row, value in enumerate(ours):
        since = since + 1 if math.isfinite(value) else 0
        settled[row] = since > wait
    a, b = np.degrees(ours[settled]), np.degrees(log["lean_angle"][settled])
    # Theirs has no mean: compare what lasts less than ten seconds.
    window = round(10.0 * RATE)
    kernel = np.ones(window) / window
    fast = [x - np.convolve(x, kernel, "same") for x in (a, b)]
    middle = slice(window, -window)
    x, y = fast[0][middle], fast[1][middle]
    gain = float(x @ y / (y @ y))
    return {
        "seconds": len(a) / RATE,
        "speed (m/s)": float(np.median(log["speed"][settled])),
        "lean, theirs, rms (deg)": float(np.sqrt(np.mean(b**2))),
        "difference, rms (deg)": float(np.sqrt(np.mean((a - b) ** 2))),
        "difference of the means (deg)": float(np.mean(a) - np.mean(b)),
        "within 10 s: difference, rms (deg)": float(np.sqrt(np.mean((x - y) ** 2))),
        "within 10 s: theirs, rms (deg)": float(np.sqrt(np.mean(y**2))),
        "within 10 s: correlation": float(np.corrcoef(x, y)[0, 1]),
        "within 10 s: ours per theirs": gain,
        "our own standard deviation, median (deg)": float(np.degrees(np.median(spread[settled]))),
    }


def main() -> None:
    """Compare and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", type=Path, nargs="+", help="sbw_whole_*.csv.gz")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    names = [path.name for path in given.logs]
    result = {
        **made_by(),
        "command": " ".join(["bench_real_logs.py", *names]),  # without their folder
        "machine": machine("numpy"),
        "logs": {path.name: compared(load(path)) for path in given.logs},
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
