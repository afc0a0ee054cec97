"""Rides through the firmware's own program that lose their PC, their wire or their patience.

Every bicycle has a process of the simulated board with a serial line of its own, which sees the
bicycle by its sensors; the PC steers by the truth, every 30 ms, until it is killed. Writes
`docs/results/hardware/board.json`.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine

from bicycle_common.origin import made_by
from bicycle_controller.cli.sensing import BICYCLES
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.evaluation.link_loss import HOLD
from bicycle_controller.evaluation.sensing import FALL, Conditions
from bicycle_hardware.frames import Actuators, Arm, Mode, encode
from bicycle_hardware.serial_line import SerialLine
from bicycle_hardware.simulated_board import BoardInputs, BoardOutputs, SimulatedBoard, build
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Loads
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.suite import SensorSuite

OUT = Path(__file__).parents[2] / "docs" / "results" / "hardware" / "board.json"
TICK = 0.01
"""s of the board's loop."""
ANSWER = 3
"""Ticks between two commands."""
REST = 150
"""Ticks of standing, in which the board calibrates and hears commands."""
AFTER = 10.0
"""s that are ridden on."""
CONDITIONS = Conditions(
    motor_lag=0.03, torque_limit=7.0, friction=0.5, wind=1.0, speeds=(1.5, 5.0)
)
SHARE = 0.3
"""Share of the frames that a bad wire spoils."""


@dataclass
class Boards:
    """N boards and their lines."""

    count: int
    boards: list[SimulatedBoard] = field(init=False)
    lines: list[SerialLine] = field(init=False)
    inputs: list[BoardInputs] = field(init=False)
    outputs: list[BoardOutputs] = field(init=False)

    def __post_init__(self) -> None:
        program = build()
        self.boards = [SimulatedBoard(program) for _ in range(self.count)]
        self.lines = [SerialLine(board.path) for board in self.boards]
        self.inputs = [BoardInputs() for _ in self.boards]
        self.outputs = [BoardOutputs() for _ in self.boards]

    def tick(self, now_us: int) -> np.ndarray:
        """Return the torques (N,) after a tick of each."""
        for board, given in zip(self.boards, self.inputs, strict=True):
            board.begin_tick(now_us, given)
        self.outputs = [board.end_tick() for board in self.boards]
        return np.array([out.torque for out in self.outputs])

    def close(self) -> None:
        """End them all."""
        for line, board in zip(self.lines, self.boards, strict=True):
            line.close()
            board.close()


class Ride:
    """N rides of one bicycle, each on a board."""

    def __init__(self, bicycle: str, count: int, seed: int) -> None:
        plant = CONDITIONS.applied(registry.named("whipple", bicycle))
        self.plant = plant.with_time_step(TICK, substeps=4)
        plain = replace(CONDITIONS, motor_lag=0.0, friction=0.0).applied(plant)
        self.pc = LqrController.named("lqr", plain, CONDITIONS.torque_limit)
        self.rng = np.random.default_rng([seed, 23])
        zero = np.zeros(count)
        self.speed = self.rng.uniform(*CONDITIONS.speeds, count)
        self.state = self.plant.initial(zero, zero, zero, self.speed)
        self.suite = SensorSuite(sensors.load("mpu6050"), self.plant, count, seed)
        self.boards = Boards(count)
        self.now_us = 1_000_000
        self.torque = self.gust = zero
        self.fell = np.full(count, np.inf)
        self.lean = np.zeros(count)
        self.ticks = 0
        self.waiting: list[tuple[int, int, bytes]] = []
        self.sequences = [0] * count

    def sense(self, readings: list[Any]) -> None:
        """Give readings to the boards."""
        for reading in readings:
            stamp = 1_000_000 + round(1e6 * reading.stamp)
            for index, given in enumerate(self.boards.inputs):
                if reading.lost[index]:
                    continue
                v = reading.values[index].tolist()
                if reading.sensor == "imu":
                    given.imu_us, given.gyro, given.force = stamp, tuple(v[:3]), tuple(v[3:])
                elif reading.sensor == "steer":
                    given.steer_us, given.steer = stamp, v[0]
                elif reading.sensor == "wheel":
                    given.wheel_us, given.wheel = stamp, v[0]

    def send(self, index: int, torque: float, drive: float = 0.0, fault: str = "") -> None:
        """Send a command over a wire that may be bad."""
        self.sequences[index] += 1
        command = Actuators(self.now_us & 0xFFFFFFFF, torque, drive, 100)
        frame = bytearray(encode(command, self.sequences[index]))
        if fault and self.rng.random() < SHARE:
            if fault == "bytes lost":
                del frame[self.rng.integers(len(frame))]
            elif fault == "bits flipped":
                frame[self.rng.integers(len(frame))] ^= 1 << int(self.rng.integers(8))
            elif fault == "delayed":
                late = int(self.rng.integers(5, 60))
                self.waiting.append((self.ticks + late, index, bytes(frame)))
                return
        os.write(self.boards.lines[index].file, bytes(frame))

    def begin(self) -> None:
        """Stand, calibrate, hear commands, arm."""
        for tick in range(REST):
            self.sense(self.suite.rest(self.state, TICK))
            self.now_us += round(1e6 * TICK)
            if tick % ANSWER == 0:
                for index in range(len(self.sequences)):
                    self.send(index, 1.0, 50.0)
            torque = self.boards.tick(self.now_us)
            if np.any(torque) or any(out.drive for out in self.boards.outputs):
                raise AssertionError("a motor moved before it was armed")
        for index, line in enumerate(self.boards.lines):
            line.send(Arm(1))
            self.send(index, 0.0)

    def steer(self, alive: np.ndarray, fault: str = "") -> np.ndarray:
        """Let the PC answer; return its torques (N,)."""
        s = self.state
        o = (s.steer_angle, s.steer_rate, s.lean_angle, s.lean_rate, s.lean_acceleration)
        seen = np.array([*o, s.heading]).T
        wanted = np.clip(self.pc.act(seen, s.speed)[:, 0], -7.0, 7.0)
        for index in np.flatnonzero(alive):
            self.send(int(index), float(wanted[index]), 20.0, fault)
        return wanted

    def loads(self) -> Loads:
        """Draw the next gusts."""
        keep, c = np.exp(-TICK), CONDITIONS
        fresh = c.wind * np.sqrt(1.0 - keep * keep)
        self.gust = keep * self.gust + fresh * self.rng.standard_normal(len(self.speed))
        force = 0.3 * np.hypot(self.gust, self.speed) * self.gust
        return Loads(lateral_force=force, force_height=1.0)

    def advance(self, torque: np.ndarray, loads: Loads) -> None:
        """Let the bicycles go on for a tick, and their boards."""
        zero = np.zeros(len(self.speed))
        limits = self.speed - 0.1, self.speed + 0.1
        trace = self.plant.trace(self.state, torque, zero, zero, limits, loads)
        self.sense(self.suite.advance(trace, TICK))
        self.state = trace[-1]
        self.now_us += round(1e6 * TICK)
        self.ticks += 1
        for one in [one for one in self.waiting if one[0] <= self.ticks]:
            os.write(self.boards.lines[one[1]].file, one[2])
        self.waiting = [one for one in self.waiting if one[0] > self.ticks]
        self.torque = self.boards.tick(self.now_us)
        upright = np.isinf(self.fell)
        self.fell[self.plant.fallen(self.state, FALL) & upright] = self.ticks
        self.lean = np.where(upright, np.maximum(self.lean, np.abs(self.state.lean_angle)), 9.0)


def killed(bicycle: str, count: int, seed: int) -> dict[str, Any]:
    """Kill the PC at a random moment, 2 to 6 s into each ride; beside it hold, then zero."""
    ride = Ride(bicycle, count, seed)
    ride.begin()
    killed_at = ride.rng.integers(round(2.0 / TICK), round(6.0 / TICK), count)
    other, held, other_fell = ride.state, np.zeros(count), np.full(count, np.inf)
    zero, limits = np.zeros(count), (ride.speed - 0.1, ride.speed + 0.1)
    for tick in range(int(killed_at.max()) + round(AFTER / TICK)):
        alive = tick < killed_at
        if tick % ANSWER == 0:
            held = np.where(alive, ride.steer(alive), held)
        loads = ride.loads()
        before, torque = ride.state, ride.torque
        ride.advance(torque, loads)
        base = type(before)
        mixed = {
            name: np.where(alive if a.ndim == 1 else alive[:, None], a, getattr(other, name))
            for name, a in vars(before).items()
        }
        hold = np.where((tick - killed_at) * TICK < HOLD, held, 0.0)
        other = ride.plant.step(
            base(**mixed), np.where(alive, torque, hold), zero, zero, limits, loads
        )
        other_fell[ride.plant.fallen(other, FALL) & np.isinf(other_fell)] = tick + 1
    modes = [out.mode for out in ride.boards.outputs]
    ride.boards.close()
    good = ride.fell > killed_at
    last = killed_at + round(AFTER / TICK)
    return {
        "bicycle": bicycle,
        "rides": int(good.sum()),
        "upright": int((ride.fell > last)[good].sum()),
        "upright, hold then zero": int((other_fell > last)[good].sum()),
        "in fallback at the end": int(sum(mode is Mode.FALLBACK for mode in modes)),
    }


def bad_wire(bicycle: str, count: int, seed: int, fault: str) -> dict[str, Any]:
    """Ride 10 s over a wire that spoils SHARE of the commands."""
    ride = Ride(bicycle, count, seed)
    ride.begin()
    everybody = np.ones(count, dtype=bool)
    fallbacks = 0
    for tick in range(round(AFTER / TICK)):
        if tick % ANSWER == 0:
            ride.steer(everybody, fault)
        ride.advance(ride.torque, ride.loads())
        fallbacks += sum(out.mode is Mode.FALLBACK for out in ride.boards.outputs)
    ride.boards.close()
    return {
        "bicycle": bicycle,
        "fault": fault or "none",
        "rides": count,
        "falls": int(np.isfinite(ride.fell).sum()),
        "largest lean (deg)": round(float(np.degrees(np.max(ride.lean))), 1),
        "share of time in fallback": round(fallbacks / (count * AFTER / TICK), 4),
    }


def stopped(bicycle: str, count: int, seed: int) -> dict[str, Any]:
    """Press the button at a random moment; measure until the drive is off."""
    ride = Ride(bicycle, count, seed)
    ride.begin()
    pressed = ride.rng.integers(round(2.0 / TICK), round(4.0 / TICK), count)
    off = np.full(count, np.inf)
    driven = np.zeros(count, dtype=bool)
    everybody = np.ones(count, dtype=bool)
    for tick in range(round(9.0 / TICK)):
        if tick % ANSWER == 0:
            ride.steer(everybody)
        for index in np.flatnonzero(pressed == tick):
            driven[index] = ride.boards.outputs[index].drive != 0.0
            ride.boards.inputs[index].stopped = True
        ride.advance(ride.torque, ride.loads())
        drive = np.array([out.drive for out in ride.boards.outputs])
        off[(drive == 0.0) & (tick >= pressed) & np.isinf(off)] = tick + 1
        again = (drive != 0.0) & (off < tick + 1)
        off[again] = np.inf
    ride.boards.close()
    return {
        "bicycle": bicycle,
        "rides": count,
        "driven when pressed": int(driven.sum()),
        "longest time to zero drive (ms)": float(1e3 * TICK * np.max(off - pressed)),
        "falls within 5 s": int((ride.fell < pressed + 500).sum()),
    }


FAULTS = ("", "bytes lost", "bits flipped", "delayed")
PARTS = ("PC killed", "bad wire", "button")


def measured(part: str, names: list[str], count: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of one part as they come, `count` rides of each bicycle."""
    for n, name in enumerate(names):
        if part == "PC killed":
            yield killed(name, count, seed + 1 + n)
        elif part == "button":
            yield stopped(name, count, seed + 200 + n)
        else:
            for fault in FAULTS:
                yield bad_wire(name, count, seed + 100 + n, fault)


def main() -> None:
    """Measure, and write or add to what is written after each bicycle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rides", type=int, default=200, help="of each bicycle")
    parser.add_argument("--parts", nargs="+", default=PARTS, choices=PARTS)
    parser.add_argument("--bicycles", default=BICYCLES)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--add", action="store_true", help="to the file's rows")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    result: dict[str, Any] = {
        "made by": [],
        "conditions": {
            "motor lag (s)": 0.03,
            "friction (N m)": 0.5,
            "gusts (m/s)": 1.0,
            "speeds (m/s)": CONDITIONS.speeds,
            "sensors of the board": "mpu6050",
        },
    }
    if given.add and given.out.is_file():
        result = json.loads(given.out.read_text())
    result["made by"].append({**made_by(), "machine": machine("numpy")})
    given.out.parent.mkdir(parents=True, exist_ok=True)
    for part in given.parts:
        for row in measured(part, given.bicycles.split(","), given.rides, given.seed):
            result.setdefault(part, []).append(row)
            given.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
