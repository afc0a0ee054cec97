"""A bicycle whose sensors and motors hang on the simulated board, and a PC that may be killed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_controller.control.lqr import LqrController
from bicycle_hardware.frames import Actuators, Arm, DriverState, Message
from bicycle_hardware.serial_line import SerialLine
from bicycle_hardware.simulated_board import BoardInputs, BoardOutputs, SimulatedBoard
from bicycle_sim.plants import registry
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.suite import SensorSuite

TICK = 0.01
"""s of the board's period."""


@dataclass
class Rig:
    """One bicycle at rest on a stand, then rolling, 100 ticks a second."""

    program: Path
    bicycle: str = "browser-rider"
    board: SimulatedBoard = field(init=False)
    line: SerialLine = field(init=False)
    inputs: BoardInputs = field(default_factory=BoardInputs)
    outputs: BoardOutputs = field(default_factory=BoardOutputs)
    state: Any = None
    now_us: int = 1_000_000
    frozen: tuple[str, ...] = ()
    """Sensors whose readings no longer come."""
    heard: list[Message] = field(default_factory=list)
    driver: DriverState | None = None

    def __post_init__(self) -> None:
        self.board = SimulatedBoard(self.program)
        self.line = SerialLine(self.board.path)
        given = registry.named("whipple", self.bicycle)
        assert isinstance(given, WhipplePlant)
        self.plant = WhipplePlant(replace(given.parameters, time_step=TICK, substeps=4))
        self.controller = LqrController.named("lqr", given, 7.0)
        self.suite = SensorSuite(sensors.load("mpu6050"), self.plant, 1, 9)
        self.place(0.0)

    def place(self, speed: float) -> None:
        """Put the bicycle upright, rolling at `speed`, m/s."""
        zero = np.zeros(1)
        self.state = self.plant.initial(zero, zero, zero, np.array([speed]))
        self.suite.begin(self.state)
        self.rolling = speed > 0.0

    def tick(self, count: int = 1) -> BoardOutputs:
        """Let the board, and the bicycle if it rolls, go on."""
        for _ in range(count):
            torque = np.array([self.outputs.torque])
            zero = np.zeros(1)
            if self.rolling:
                trace = self.plant.trace(self.state, torque, zero, zero)
                readings = self.suite.advance(trace, TICK)
                self.state = trace[-1]
            else:
                readings = self.suite.rest(self.state, TICK)
            self.now_us += round(1e6 * TICK)
            for reading in readings:
                self._feel(reading.sensor, reading.values[0])
            self.outputs = self.board.tick(self.now_us, self.inputs)
            self.hear()
        return self.outputs

    def _feel(self, sensor: str, values: np.ndarray) -> None:
        if sensor in self.frozen:
            return
        i, v = self.inputs, values.tolist()
        if sensor == "imu":
            i.imu_us, i.gyro, i.force = self.now_us, tuple(v[:3]), tuple(v[3:])
        elif sensor == "steer":
            i.steer_us, i.steer = self.now_us, v[0]
        elif sensor == "wheel":
            i.wheel_us, i.wheel = self.now_us, v[0]

    def hear(self) -> None:
        """Take what the board has sent."""
        for message in self.line.receive():
            self.heard.append(message)
            if isinstance(message, DriverState):
                self.driver = message

    def command(
        self,
        torque: float = 0.0,
        drive: float = 0.0,
        valid_ms: int = 100,
        stamp: int | None = None,
    ) -> None:
        """Send a command, as the PC does: an answer to the state of now, or of an earlier time."""
        stamp = self.now_us if stamp is None else stamp
        self.line.send(Actuators(stamp & 0xFFFFFFFF, torque, drive, valid_ms))

    def steer(self) -> None:
        """Send the LQR's command for the true state."""
        self.command(self.answer())

    def answer(self) -> float:
        """Return the LQR's torque for the true state, N m."""
        s = self.state
        o = (
            s.steer_angle,
            s.steer_rate,
            s.lean_angle,
            s.lean_rate,
            s.lean_acceleration,
            s.heading,
        )
        return float(self.controller.act(np.array(o).T, s.speed)[0, 0])

    def arm(self) -> None:
        """Calibrate, let commands come for more than a second, and arm."""
        for _ in range(120):
            self.command()
            self.tick()
        self.line.send(Arm(1))
        self.command()
        self.tick()

    def ride(self, seconds: float, pc: bool = True) -> float:
        """Ride on, with or without the PC; return the largest lean, rad."""
        largest = 0.0
        for index in range(round(seconds / TICK)):
            if pc and index % 2 == 0:
                self.steer()
            self.tick()
            largest = max(largest, abs(float(self.state.lean_angle[0])))
        return largest

    def close(self) -> None:
        """End the board."""
        self.line.close()
        self.board.close()
