"""The driver's part without ROS and without waiting: frames in, frames of commands out.

The microcontroller gives the beat: at the end of each control period it sends `Period`, the
driver counts it as a step, and whoever controls answers that step. An episode begins when the
microcontroller does, with a rest in which it is calibrated and no step is counted.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass
from typing import Protocol

from bicycle_common.types import AppliedCommand, Command, CommandSource
from bicycle_hardware.clock_offset import ClockOffset
from bicycle_hardware.frames import (
    Actuators,
    Arm,
    AskTime,
    DriverState,
    Imu,
    Message,
    Mode,
    Period,
    Steer,
    Stop,
    TimeIs,
    Wheel,
)

KEPT = 400
"""Steps and commands that are remembered."""
ASK_AGAIN = 0.25
"""s of silence after which the microcontroller is asked for its time, so that it is known."""


class Line(Protocol):
    """A sender of frames."""

    def send(self, message: Message) -> int:
        """Send a message; return its sequence."""


@dataclass(frozen=True)
class SensorReading:
    """One reading of a sensor."""

    sensor: str
    """imu, steer or wheel."""
    stamp: float
    """s of the sensors' clock."""
    values: tuple[float, ...]


@dataclass(frozen=True)
class ControlPeriod:
    """A control period that is over."""

    episode: int
    step: int
    """Number of the step, from 0 after the rest; negative within it."""
    time: float
    """s of the sensors' clock."""
    applied: AppliedCommand
    """Command that was in force during the step."""


Heard = SensorReading | ControlPeriod | DriverState


@dataclass(frozen=True)
class DriverConfig:
    """Settings of the driver.

    Raises:
        ValueError: on a number that makes no sense.
    """

    rest: float = 5.0
    """s of the beginning in which no step is counted."""
    period: float = 0.025
    """s of a control period."""
    valid_ms: int = 100
    """ms for which the microcontroller may obey a command."""
    gear: float = 0.2
    """N at the rim per N of pedal force."""
    pc_clock: bool = True
    """True to give stamps in the PC's clock, False in the microcontroller's own."""
    arms_itself: bool = False
    """True to arm as soon as the microcontroller has no reason to refuse."""

    def __post_init__(self) -> None:
        if not (0.0 <= self.rest < math.inf and 0.0 < self.period < math.inf):
            raise ValueError(f"rest {self.rest:g} s and period {self.period:g} s make no sense")


class Driver:
    """One microcontroller.

    Attributes:
        state: what it last said of itself; None before that.
        episode: from 1, counts its starts.
        stale: commands that were not sent, for their step is not known or was answered.
    """

    def __init__(self, line: Line, config: DriverConfig) -> None:
        """Begin before the first frame."""
        self.line = line
        self.config = config
        self.state: DriverState | None = None
        self.episode = 0
        self.stale = 0
        self._clock = ClockOffset()
        self._base = 0.0
        self._first = 0
        self._last: Period | None = None
        self._stamps: OrderedDict[int, int] = OrderedDict()
        self._sent: OrderedDict[int, Command] = OrderedDict()
        self._answered = -1
        self._asked = -math.inf
        self._heard = -math.inf

    @property
    def round_trip(self) -> float:
        """s of the last question for the time; NaN before the first answer."""
        return self._clock.round_trip

    @property
    def heard(self) -> float:
        """s of the PC's clock of the last frame; -inf before the first."""
        return self._heard

    @property
    def rest_periods(self) -> int:
        """Periods before step 0."""
        return math.ceil(self.config.rest / self.config.period - 1e-9)

    def reopened(self, line: Line) -> None:
        """Go on with another line, as after a cable was pulled out and put back."""
        self.line = line
        self._asked = -math.inf

    # Microcontroller to PC.

    def take(self, messages: list[Message], now: float) -> list[Heard]:
        """Take frames in the order in which they came.

        Args:
            messages: of the frames.
            now: s of the PC's clock.

        Returns:
            What is to be published, in order.
        """
        found: list[Heard] = []
        for message in messages:
            self._heard = now
            if isinstance(message, Imu):
                m = message
                gyro, force = (m.gyro_x, m.gyro_y, m.gyro_z), (m.force_x, m.force_y, m.force_z)
                found.append(SensorReading("imu", self._time(m.stamp_us), (*gyro, *force)))
            elif isinstance(message, Steer):
                values = (message.angle, message.torque)
                found.append(SensorReading("steer", self._time(message.stamp_us), values))
            elif isinstance(message, Wheel):
                found.append(
                    SensorReading("wheel", self._time(message.stamp_us), (message.speed,))
                )
            elif isinstance(message, DriverState):
                self.state = message
                self._arm_itself(message)
                found.append(message)
            elif isinstance(message, TimeIs):
                self._clock.answered(message.pc * 1e-9, now, message.stamp_us)
            elif isinstance(message, Period):
                found.append(self._step(message, now))
        return found

    def _time(self, stamp_us: int) -> float:
        if self.config.pc_clock:
            return self._clock.to_pc(stamp_us)
        return self._base + self._clock.unwrapped(stamp_us)

    def _step(self, period: Period, now: float) -> ControlPeriod:
        """Count a control period as a step."""
        if self._last is None or period.number <= self._last.number:
            self._begin(period)
        self._last = period
        step = period.number - self._first - self.rest_periods
        self._clock.follow(period.stamp_us, step <= 0)
        self._stamps[step] = period.stamp_us
        while len(self._stamps) > KEPT:
            self._stamps.popitem(last=False)
        self.ask(now)
        return ControlPeriod(
            self.episode, step, self._time(period.stamp_us), self._applied(period, step)
        )

    def _begin(self, period: Period) -> None:
        """Begin an episode: this microcontroller has begun."""
        if self._last is not None:  # its clock began anew; the sensors' clock goes on
            self._base += self._clock.unwrapped(self._last.stamp_us)
            self._clock = ClockOffset()
        self.episode += 1
        self._first = period.number
        self._stamps.clear()
        self._sent.clear()
        self._answered = -1

    def _applied(self, period: Period, step: int) -> AppliedCommand:
        command = self._sent.get(period.sequence)
        if step <= 0 or period.mode in (Mode.DISARMED, Mode.ARMED):
            return AppliedCommand()  # nothing has moved it yet
        if period.mode != Mode.RIDING or command is None:
            return AppliedCommand(CommandSource.ZERO)
        fresh = command.step == step - 1
        return AppliedCommand(CommandSource.FRESH if fresh else CommandSource.HELD, command)

    def again(self) -> ControlPeriod | None:
        """Return the last step once more; None before the first, and within the rest."""
        if self._last is None:
            return None
        step = self._last.number - self._first - self.rest_periods
        if step < 0:
            return None
        applied = self._applied(self._last, step)
        return ControlPeriod(self.episode, step, self._time(self._last.stamp_us), applied)

    # PC to microcontroller.

    def ask(self, now: float) -> None:
        """Ask the microcontroller for its time, at s of the PC's clock."""
        self._asked = now
        self.line.send(AskTime(round(now * 1e9)))

    def idle(self, now: float) -> None:
        """Ask the microcontroller again if it is silent."""
        if now - max(self._asked, self._heard) > ASK_AGAIN:
            self.ask(now)

    def command(self, command: Command) -> bool:
        """Send a valid command; return False if its step is not known or was answered.

        Nothing is repeated on anybody's behalf: who no longer sends is no longer obeyed.
        """
        stamp = self._stamps.get(command.step)
        if command.episode != self.episode or stamp is None or command.step <= self._answered:
            self.stale += 1
            return False
        drive = self.config.gear * command.pedal_force
        sequence = self.line.send(Actuators(stamp, command.torque, drive, self.config.valid_ms))
        self._answered = command.step
        self._sent[sequence] = command
        while len(self._sent) > KEPT:
            self._sent.popitem(last=False)
        return True

    def arm(self, wanted: bool) -> None:
        """Arm or disarm; the next state tells whether it does."""
        self.line.send(Arm(int(wanted)))

    def stop(self) -> None:
        """Stop the drive at once; the steering keeps the bicycle upright."""
        self.line.send(Stop())

    def _arm_itself(self, state: DriverState) -> None:
        if self.config.arms_itself and state.mode == Mode.DISARMED and state.reasons == 0:
            self.arm(True)
