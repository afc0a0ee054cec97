"""Simulated bicycle whose sensors and motors are connected to a microcontroller only.

The microcontroller runs 200 times a second beside the bicycle: it gets the readings that have
arrived, and the bicycle gets the torque that it gives. Before a ride the bicycle stands, held
upright, until the microcontroller is armed; then it is pushed off.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from bicycle_common.types import BicycleState, Command, InitialPose
from bicycle_common.validation import require
from bicycle_hardware.frames import Mode
from bicycle_hardware.simulated_board import BoardHeard, BoardInputs, BoardOutputs, SimulatedBoard
from bicycle_sim.plants.base import Plant
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.sensors.suite import SensorSuite
from bicycle_sim.task.scenario import Scenario

TICK = 0.005
"""s of the microcontroller's loop."""
FIRST_US = 1_000_000
"""us of its clock at its first tick."""
NO_STAMP = 1
"""us that no period has."""
NEVER_ASKED = 2**32 - 1
KEPT_AGES = 2000
BATTERY = 24.0
"""V."""


class BoardSimulator(Simulator):
    """A simulator that steps under the outputs of a microcontroller, not under commands.

    Attributes:
        outputs: what the microcontroller last gave.
        stopped: True while the button for emergencies is pressed.
        held: True while the bicycle stands, before it is pushed off.
        ages: s by a real clock from the end of a period to the arrival of the command that
            answers it, at the microcontroller, of the last commands. The microcontroller's own
            clock is the sensors' and stands between two ticks.
    """

    def __init__(
        self,
        scenario: Scenario,
        plant: Plant[Any],
        seed: int,
        sensors: SensorSettings,
        board: SimulatedBoard,
    ) -> None:
        """Hang a bicycle on a microcontroller.

        Raises:
            ValueError: if the plant has one time step only, or its control period does not hold
                whole ticks.
        """
        self.board = board
        self.outputs = BoardOutputs()
        self.stopped = False
        self._period = plant.time_step
        self._ticks = round(plant.time_step / TICK)
        require(
            abs(self._ticks * TICK - plant.time_step) < 1e-9,
            f"the bicycle's time_step {plant.time_step:g} s must be a multiple of {TICK:g} s",
        )
        self._rests = math.ceil(sensors.rest / plant.time_step - 1e-9)
        self._gear = plant.pedal_gear
        self._worn = sensors
        self.ages: deque[float] = deque(maxlen=KEPT_AGES)
        quick = plant.with_time_step(TICK, max(1, round(plant.substeps / self._ticks)))
        super().__init__(scenario, quick, seed)

    @property
    def time_step(self) -> float:
        """s of a control period."""
        return self._period

    def _place(self, start: InitialPose, episode: int) -> BicycleState:
        """Put the bicycle at its start, with the microcontroller switched off and on."""
        snapshot = super()._place(start, episode)
        self._suite = SensorSuite(self._worn, self.plant, 1, max(self.seed, 0))
        self._under_way, self.readings = [], []
        self.board.restart()
        self.outputs, self._inputs = BoardOutputs(), BoardInputs(battery=BATTERY)
        self._number = -1
        self._asked = 0
        self.held = True
        return snapshot

    @property
    def _now_us(self) -> int:
        return FIRST_US + round(1e6 * self.sensor_time)

    @property
    def begun(self) -> bool:
        """True once the microcontroller made its first tick."""
        return self._number >= 0

    def is_awaited(self, milliseconds: int, lockstep: bool) -> bool:
        """Return True if the next period may begin.

        Nothing begins before somebody listens at the serial line. In lock-step each period of the
        rest waits until the last one's readings were read, and each later one for a command that
        answers the last one.

        Args:
            milliseconds: longest wait, in which the microcontroller listens.
            lockstep: False to wait for the first only.
        """
        ridden = self._number >= self._rests
        if not lockstep and self.begun:
            return True
        stamp = self._now_us if ridden else NO_STAMP
        asked = NEVER_ASKED if ridden else self._asked
        heard = self._listen(stamp, asked, milliseconds)
        return heard.stamp_us == stamp if ridden else heard.asked > self._asked

    def _listen(self, stamp: int, asked: int, milliseconds: int) -> BoardHeard:
        heard = self.board.wait(stamp, asked, milliseconds)
        self.ages.extend(1e-6 * age for age in heard.ages_us)
        return heard

    def step(self, command: Command | None, push: float = 0.0) -> BicycleState:
        """Let a control period pass; the first one is a single tick, with which the board begins.

        Args:
            command: not looked at: commands reach the microcontroller by its serial line.
            push: rad/s added to the lean rate before the step.
        """
        del command
        before = self.snapshot
        if push and not self.held:
            self._state = self.plant.pushed(self._state, push)
            assert self._suite is not None
            self._suite.begin(self._state)
        self.readings = []
        self._asked = self._listen(NO_STAMP, NEVER_ASKED, 0).asked
        if self._number < 0:
            self._feel([])
            self.outputs = self.board.tick(self._now_us, self._inputs)
        else:
            for _ in range(self._ticks):
                self._tick()
        self._number += 1
        armed = self.outputs.mode in (Mode.ARMED, Mode.RIDING)
        if self.held and self._number >= self._rests and armed:
            self.held = False
        counted = self._number > self._rests
        self.snapshot = self._observe(before.episode, before.step + int(counted))
        return self.snapshot

    def _tick(self) -> None:
        """One tick of the microcontroller."""
        suite = self._suite
        assert suite is not None
        if self.held:
            measured = suite.rest(self._state, TICK)
        else:
            torque = np.array([self.outputs.torque])
            pedal = np.array([self.outputs.drive / self._gear if self._gear > 0.0 else 0.0])
            if "pedal_force" not in self.plant.input_names:
                pedal = np.zeros(1)
            limits = self.scenario.speed_limits
            trace = self.plant.trace(self._state, torque, np.zeros(1), pedal, limits)
            self._state = trace[-1]
            measured = suite.advance(trace, TICK, torque)
        arrived = self.readings
        self._measure(measured)
        self._feel(self.readings)
        # Satellites are received by the PC itself.
        self.readings = [*arrived, *(one for one in self.readings if one.sensor == "gnss")]
        self.outputs = self.board.tick(self._now_us, self._inputs)

    def _feel(self, readings: list[Reading]) -> None:
        """Give the microcontroller the readings that have arrived."""
        inputs = self._inputs
        inputs.stopped = self.stopped
        for reading in sorted(readings, key=lambda one: one.stamp):
            values = [float(value) for value in reading.values[0]]
            stamp = FIRST_US + round(1e6 * reading.stamp)
            if reading.sensor == "imu":
                inputs.imu_us = stamp
                inputs.gyro = (values[0], values[1], values[2])
                inputs.force = (values[3], values[4], values[5])
            elif reading.sensor == "steer":
                inputs.steer_us, inputs.steer = stamp, values[0]
            elif reading.sensor == "wheel":
                inputs.wheel_us, inputs.wheel = stamp, values[0]
