"""Driver of a real bicycle as a ROS 2 node: between the topics and its microcontroller."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_hardware.nodes.driver_node")

import math
import sys
import threading
import time
from collections import deque
from typing import Any

import numpy as np
from bicycle_msgs.msg import BicycleCommand, EpisodeInfo
from bicycle_msgs.msg import DriverState as DriverStateMessage
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import TimeReference
from std_srvs.srv import SetBool, Trigger

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.declare_parameters import declare
from bicycle_common.nodes.diagnostics import ERROR, OK, WARN, percentiles, status
from bicycle_common.nodes.realtime import Priority
from bicycle_common.nodes.runner import LOOP_EXECUTOR, UserError, run
from bicycle_common.nodes.topics import STATE_PERIOD, Topic, advertise, listen, serve
from bicycle_common.parameters import describe
from bicycle_hardware import frames
from bicycle_hardware.driver import ControlPeriod, Driver, Heard, SensorReading
from bicycle_hardware.frames import DriverState, Message, Mode
from bicycle_hardware.nodes.driver_settings import DriverSettings
from bicycle_hardware.serial_line import SPEEDS, SerialLine
from bicycle_sim import __version__
from bicycle_sim.nodes import sensor_messages
from bicycle_sim.nodes.robot_model import frames_of
from bicycle_sim.runtime.command_validator import CommandValidator
from bicycle_sim.sensors.reading import Reading

NAME = "bicycle_driver"
RETRY = 0.2
"""s between two tries to open the line."""
LISTEN = 0.05
"""Longest wait for bytes before the thread checks for the node's end (s)."""
ANSWER = 0.5
"""Longest wait for the microcontroller's answer to arming (s)."""
SILENCE = 0.5
"""Silence of the microcontroller from which on it is reported (s)."""
TURN = 0.0005
"""s for which one of the two threads keeps the other from running: a command that comes while
readings are published must not wait for Python's usual 5 ms."""
OLDEST = 8
"""Steps that a command may be late by."""


class Unplugged:
    """Stand-in for a missing serial line; sent messages are lost."""

    def send(self, message: Message) -> int:
        """Lose a message."""
        del message
        return -1


class DriverNode(Node):
    """One bicycle's microcontroller: readings out, valid commands in."""

    def __init__(self) -> None:
        """Begin to look for the line.

        Raises:
            UserError: on a bad parameter.
        """
        super().__init__(NAME)
        self._settings = settings = declare(self, DriverSettings)
        if settings.baud not in SPEEDS:
            known = ", ".join(map(str, SPEEDS))
            raise UserError(f"parameter baud is {settings.baud}: choose one of {known}")
        try:
            self._plant = settings.make_plant()
            self._scenario = settings.make_scenario()
            self._sensors = settings.make_sensors()
            self._driver = Driver(Unplugged(), settings.make_config(self._plant))
        except ValueError as error:
            raise UserError(str(error)) from None
        self._gate = CommandValidator(self._scenario.action_limits, max_age=OLDEST)
        self._lock = threading.Lock()
        self._answer = threading.Condition(self._lock)
        self._answers = 0
        self._line: SerialLine | None = None
        self._why_not = "not opened yet"
        self._stepped = time.monotonic()
        self._step: ControlPeriod | None = None
        self._arrived: dict[int, float] = {}
        self._latencies: deque[float] = deque(maxlen=2000)
        self._steps = 0
        self._counted = time.monotonic(), 0
        self._was_silent, self._was_mode = False, -1
        self._frames = frames_of(self.get_namespace())
        self._publishers_by_name = advertise(
            self,
            topics.IMU,
            topics.ENCODERS,
            topics.SENSOR_TIME,
            topics.COMMAND_ECHO,
            topics.EPISODE,
            topics.DRIVER_STATE,
            topics.DIAGNOSTICS,
        )
        listen(self, topics.COMMAND, self._on_command)
        serve(self, topics.ARM, self._on_arm)
        serve(self, topics.ESTOP, self._on_estop)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.5 * STATE_PERIOD, self._on_idle, clock=steady)
        self.create_timer(settings.diagnostics_period, self._on_report, clock=steady)
        wanted = settings.realtime_priority if settings.pace == "realtime" else 0
        notice = Priority().take(wanted)
        if notice:
            self.get_logger().info(notice)
        self._closing = threading.Event()
        self._reader = threading.Thread(target=self._read, name="serial line", daemon=True)
        self._reader.start()
        self.get_logger().info(f"waits for a microcontroller at {settings.port}")

    def close(self) -> None:
        """Stop reading. The microcontroller is left to its own law: it notices by itself."""
        self._closing.set()
        self._reader.join(5.0)
        if self._line is not None:
            self._line.close()

    def _publish(self, topic: Topic, message: Any) -> None:
        self._publishers_by_name[topic.name].publish(message)

    def _read(self) -> None:
        while not self._closing.is_set():
            line = self._line
            if line is None:
                self._open()
                continue
            try:
                messages = line.receive(LISTEN)
            except OSError as error:
                self._lost(str(error.strerror or error))
                continue
            with self._lock:
                now = time.monotonic()
                for heard in self._driver.take(messages, self._now()):
                    self._tell(heard, now)
                self._driver.idle(self._now())

    def _now(self) -> float:
        """Return s of the clock in which readings are stamped."""
        return self.get_clock().now().nanoseconds * 1e-9

    def _open(self) -> None:
        try:
            line = SerialLine(self._settings.port, self._settings.baud)
        except (OSError, ValueError) as error:
            self._why_not = str(error)
            self._closing.wait(RETRY)
            return
        with self._lock:
            self._line, self._stepped = line, time.monotonic()
            self._driver.reopened(line)
        self.get_logger().info(f"listens at {self._settings.port}")

    def _lost(self, why: str) -> None:
        with self._lock:
            if self._line is not None:
                self._line.close()
            self._line, self._why_not = None, why
            self._driver.reopened(Unplugged())
        self.get_logger().error(
            f"the serial line {self._settings.port} is gone ({why}): is the cable in? It is "
            "opened again as soon as it is there"
        )

    def _tell(self, heard: Heard, now: float) -> None:
        """Publish the microcontroller's messages."""
        if isinstance(heard, SensorReading):
            self._publish_reading(heard)
        elif isinstance(heard, DriverState):
            self._publish_state(heard)
            self._answers += 1
            self._answer.notify_all()
        else:
            self._begin(heard)
            self._step, self._stepped = heard, now
            self._steps += 1
            if heard.step >= 0:
                self._arrived[heard.step] = now
                self._arrived.pop(heard.step - 100, None)
                self._publish_step(heard)

    def _begin(self, heard: ControlPeriod) -> None:
        """Publish an episode's settings at its first step."""
        if self._step is not None and heard.episode == self._step.episode:
            return
        self._gate.begin(heard.episode)
        self._arrived.clear()
        info = EpisodeInfo(
            header=self._header(heard.time),
            episode=int(heard.episode),
            seed=0,
            pace=self._settings.pace,
            physics=self._plant.to_json(),
            scenario=self._scenario.to_json(),
            version=__version__,
        )
        self._publish(topics.EPISODE, info)
        self.get_logger().info(
            f"episode {heard.episode}: the microcontroller has begun; let the bicycle rest for "
            f"{self._sensors.rest:g} s"
        )

    def _publish_reading(self, measured: SensorReading) -> None:
        reading = Reading(
            measured.sensor,
            measured.stamp,
            np.array([measured.stamp]),
            np.zeros(1, dtype=bool),
            np.array([measured.values]),
        )
        for topic, message in sensor_messages.messages(reading, 0, self._sensors, self._frames):
            self._publish(topic, message)

    def _publish_step(self, heard: ControlPeriod) -> None:
        """Publish the command that led to a step, then its time: who controls answers that."""
        nanoseconds = round(heard.time * 1e9)
        echo = convert.from_applied(heard.applied, heard.episode, heard.step, nanoseconds)
        self._publish(topics.COMMAND_ECHO, echo)
        self._publish(
            topics.SENSOR_TIME,
            TimeReference(
                header=self._header(heard.time),
                time_ref=convert.to_stamp(nanoseconds),
                source=f"{heard.episode} {heard.step}",
            ),
        )

    def _publish_state(self, state: DriverState) -> None:
        line = self._line
        splitter = line.splitter if line is not None else None
        age = math.nan if state.age_ms == 65535 else 1e-3 * state.age_ms
        now = self._step.time if self._step is not None else 0.0
        message = DriverStateMessage(
            header=self._header(now),
            mode=int(state.mode),
            reasons=int(state.reasons),
            refusal=frames.words(state.reasons),
            torque=float(state.torque),
            drive=float(state.drive),
            battery=float(state.battery),
            sequence=int(state.sequence),
            command_age=age,
            bad_frames=int(state.bad_frames),
            bad_frames_here=int(splitter.bad if splitter else 0),
            missing_frames=int(splitter.missing if splitter else 0),
            round_trip=float(self._driver.round_trip),
        )
        self._publish(topics.DRIVER_STATE, message)
        if state.mode != self._was_mode:
            self._was_mode = state.mode
            self.get_logger().info(f"the microcontroller is {Mode(state.mode).name.lower()}")

    def _header(self, seconds: float) -> Any:
        return convert.to_header(round(seconds * 1e9))

    def _on_command(self, message: BicycleCommand) -> None:
        command = convert.to_command(message)
        with self._lock:
            step = self._step.step if self._step is not None else -1
            decision = self._gate.decide(command, max(step, 0))
            if decision.accepted and self._driver.command(command):
                came = self._arrived.get(command.step)
                if came is not None:
                    self._latencies.append(time.monotonic() - came)
        if decision.warning:
            self.get_logger().warning(
                f"command for step {message.step} from {message.controller!r} ignored: "
                f"{decision.warning}"
            )

    def _on_arm(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        wanted = bool(request.data)
        state = self._ask(lambda: self._driver.arm(wanted))
        if state is None:
            response.success, response.message = False, f"not done: {self._silence()}"
        elif not wanted:
            response.success = state.mode == Mode.DISARMED
            response.message = "disarmed: the motors are off"
        else:
            response.success = state.mode in (Mode.ARMED, Mode.RIDING, Mode.FALLBACK)
            mode = Mode(state.mode).name.lower()
            why = frames.words(state.reasons) or f"it is in mode {mode}: disarm it first"
            response.message = "armed" if response.success else f"not armed: {why}"
        self.get_logger().info(response.message)
        return response

    def _on_estop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        state = self._ask(self._driver.stop)
        response.success = state is not None and state.mode in (Mode.ESTOP, Mode.DISARMED)
        response.message = (
            "the drive is off; the steering keeps it upright until bicycle/arm disarms it"
            if response.success
            else f"NOT STOPPED ({self._silence()}): press the button"
        )
        self.get_logger().warning(response.message)
        return response

    def _ask(self, send: Any) -> DriverState | None:
        """Send a message, and return the state that the microcontroller answers with, or None."""
        with self._answer:
            if self._line is None:
                return None
            before = self._answers
            send()
            # A state may have been under way: the second is surely an answer.
            self._answer.wait_for(lambda: self._answers >= before + 2, ANSWER / 2)
            return self._driver.state if self._answers > before else None

    def _silence(self) -> str:
        if self._line is None:
            return f"no serial line {self._settings.port}: {self._why_not}"
        return "the microcontroller does not answer"

    def _on_idle(self) -> None:
        """Publish a simulated board's step again while it waits; say when a board is silent."""
        with self._lock:
            silent = time.monotonic() - self._stepped
            if self._settings.pace == "lockstep" and silent > STATE_PERIOD:
                again = self._driver.again()
                if again is not None:
                    self._publish_step(again)
            lost = self._line is not None and silent > SILENCE
        is_silent = lost and self._settings.pace == "realtime"
        if is_silent and not self._was_silent:
            self.get_logger().warning(
                f"no frame from {self._settings.port}: is it the microcontroller's, and does its "
                "firmware run?"
            )
        self._was_silent = is_silent

    def _on_report(self) -> None:
        with self._lock:
            array = DiagnosticArray(status=[self._line_status(), self._board_status()])
        array.header.stamp = self.get_clock().now().to_msg()
        self._publish(topics.DIAGNOSTICS, array)

    def _line_status(self) -> DiagnosticStatus:
        now = time.monotonic()
        (since, counted), self._counted = self._counted, (now, self._steps)
        level, text = OK, "frames come"
        if self._line is None:
            level, text = ERROR, f"no serial line {self._settings.port}: {self._why_not}"
        elif now - self._stepped > SILENCE and self._settings.pace == "realtime":
            level, text = ERROR, "no frames: does the microcontroller's firmware run?"
        splitter = self._line.splitter if self._line is not None else None
        values: dict[str, object] = {
            "port": self._settings.port,
            "rate (Hz)": (self._steps - counted) / max(now - since, 1e-3),
            "damaged frames": splitter.bad if splitter else 0,
            "missing frames": splitter.missing if splitter else 0,
            "round trip (ms)": 1e3 * self._driver.round_trip,
            **percentiles(list(self._latencies), "period to command"),
        }
        return status(f"{self._who()}: line", level, text, values)

    def _board_status(self) -> DiagnosticStatus:
        state = self._driver.state
        if state is None:
            return status(f"{self._who()}: board", WARN, "no state yet", {})
        mode = Mode(state.mode).name.lower()
        level, text = OK, mode
        if mode in ("fallback", "estop"):
            level = WARN
        if state.mode == Mode.DISARMED and state.reasons:
            text = f"disarmed: {frames.words(state.reasons)}"
        values: dict[str, object] = {
            "mode": mode,
            "reasons": int(state.reasons),
            "battery (V)": float(state.battery),
            "torque (N m)": float(state.torque),
            "drive (N)": float(state.drive),
            "command age (ms)": int(state.age_ms),
            "damaged frames there": int(state.bad_frames),
            "commands accepted": self._gate.accepted,
            "commands too late": self._driver.stale,
            **{reason.value: count for reason, count in self._gate.rejected.items()},
        }
        return status(f"{self._who()}: board", level, text, values)

    def _who(self) -> str:
        return str(self.get_fully_qualified_name()).lstrip("/")


def main() -> None:
    """Run the driver until SIGINT or SIGTERM."""
    usage = (
        "usage: bicycle_driver [--ros-args -p NAME:=VALUE ... --params-file FILE]\n\n"
        "Drives a bicycle's microcontroller. Parameters and their defaults:\n"
        + describe(DriverSettings)
    )
    sys.setswitchinterval(TURN)
    sys.exit(run(NAME, DriverNode, usage, executor=LOOP_EXECUTOR))
