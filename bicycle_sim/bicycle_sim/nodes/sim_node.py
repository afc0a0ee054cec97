"""The simulator as a ROS 2 node: topics, services and timers around `bicycle_sim.runtime.loop`."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_sim.nodes.sim_node")

import math
import sys
import time
from typing import Any, ClassVar

from bicycle_msgs.msg import BicycleCommand, EpisodeInfo, LoopTiming
from bicycle_msgs.srv import Push, Reset
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import TimeReference
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from bicycle_common.conventions import mirror
from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.declare_parameters import declare, follow
from bicycle_common.nodes.realtime import Priority
from bicycle_common.nodes.runner import LOOP_EXECUTOR, UserError, run
from bicycle_common.nodes.topics import STATE_PERIOD, Topic, advertise, listen, serve
from bicycle_common.parameters import describe
from bicycle_common.types import InitialPose
from bicycle_sim import __version__
from bicycle_sim.nodes import robot_model, robot_urdf, sensor_messages, visualization
from bicycle_sim.nodes.exclusive import refuse_second_simulator
from bicycle_sim.nodes.sim_diagnostics import SimReport
from bicycle_sim.nodes.sim_settings import NAME, SimSettings
from bicycle_sim.runtime.loop import WITHOUT_COMMANDS, Loop, StepResult
from bicycle_sim.runtime.simulator import Simulator

SENSOR_TOPICS = (
    topics.IMU,
    topics.ENCODERS,
    topics.GNSS_FIX,
    topics.GNSS_VELOCITY,
    topics.SENSOR_TIME,
)

LAST_WORD = 0.5
"""Longest wait at the end for subscribers to receive the last state (s)."""


OUTPUTS = (
    topics.STATE,
    topics.ODOMETRY,
    topics.JOINT_STATES,
    topics.CLOCK,
    topics.TF,
    topics.TF_STATIC,
    topics.ROBOT_DESCRIPTION,
    topics.MARKERS,
    topics.DIAGNOSTICS,
    topics.COMMAND_ECHO,
    topics.TIMING,
    topics.PUSHED,
    topics.EPISODE,
)


class SimNode(Node):
    """One bicycle that applies `bicycle/command` and publishes its state and events."""

    settings_type: ClassVar[type[SimSettings]] = SimSettings
    outputs: ClassVar[tuple[Topic, ...]] = OUTPUTS
    """Topics that the node publishes; messages of others are dropped."""
    sensor_outputs: ClassVar[tuple[Topic, ...]] = SENSOR_TOPICS
    """The same where it has sensors."""
    obeys_topic: ClassVar[bool] = True
    """True if `bicycle/command` moves the bicycle."""

    def __init__(self) -> None:
        """Start the first episode.

        Raises:
            UserError: on a bad parameter, or if another simulator is running.
        """
        super().__init__(NAME)
        self._settings = declare(self, self.settings_type)
        follow(self, self._settings, self._change)
        self._loop = self._make_loop()
        plant = self._loop.simulator.plant
        self._geometry = plant.geometry
        self._sensors = self._settings.make_sensors()
        self._sensor_base = 0
        self._joints = visualization.Joints(self._geometry, plant.time_step)
        self._report = SimReport(self._who(), self._loop)
        self._last_state = self._last_markers = self._last_tf = self._fallen_at = -math.inf
        self._was_timed_out = self._was_silent = False
        refuse_second_simulator(self)
        self._publishers_by_name = advertise(
            self, *self.outputs, *(self.sensor_outputs if self._sensors is not None else ())
        )
        self._frames = robot_model.frames_of(self.get_namespace())
        self._describe()
        self._listen()
        self._start_timers()
        notice = Priority().take(self._settings.loop_priority())
        if notice:
            self.get_logger().info(notice)
        try:
            self._begin(self._settings.make_start(), self._settings.seed)
        except ValueError as error:
            raise UserError(f"{error}: choose another start_speed or scenario") from None

    def _change(self, settings: SimSettings) -> None:
        """Take settings that have changed while it runs."""
        self._settings = settings

    def _make_loop(self) -> Loop:
        """Create the bicycle and its schedule from the parameters."""
        settings = self._settings
        try:
            simulator = Simulator(
                settings.make_scenario(),
                settings.make_plant(),
                settings.seed,
                settings.make_sensors(),
            )
            settings.make_start()
            return Loop(simulator, settings.make_options())
        except ValueError as error:
            raise UserError(str(error)) from None

    def _describe(self) -> None:
        """Publish the constant facts: the model and the fixed transform."""
        label = f"bicycle {self._loop.simulator.plant.label}"
        mounts = robot_model.mounts_of(self._sensors)
        text = robot_urdf.urdf(self._geometry, label, self._frames, mounts)
        self._publish(topics.ROBOT_DESCRIPTION, String(data=text))
        self._publish(topics.TF_STATIC, robot_model.static_transforms(self._frames, 0, mounts))

    def _listen(self) -> None:
        if self.obeys_topic:
            listen(self, topics.COMMAND, self._on_command)
        listen(self, topics.INITIAL_POSE, self._on_initial_pose)
        serve(self, topics.RESET, self._on_reset)
        serve(self, topics.PAUSE, self._on_pause)
        serve(self, topics.STEP, self._on_step)
        serve(self, topics.PUSH, self._on_push)

    def _start_timers(self) -> None:
        """Start the timers, on a steady clock, which ignores adjustments of the system time."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        period = self._loop.pacer.period_ns * 1e-9
        self._pace = self.create_timer(period, self._on_due, clock=steady)
        self._pace.timer_period_ns = self._loop.pacer.period_ns
        if self._loop.lockstep:
            self._pace.cancel()
        self.create_timer(0.5 * STATE_PERIOD, self._on_idle, clock=steady)
        self.create_timer(self._settings.diagnostics_period, self._on_report, clock=steady)

    def close(self) -> None:
        """Wait until the last state is received."""
        publisher = self._publishers_by_name[topics.STATE.name]
        publisher.wait_for_all_acked(Duration(seconds=LAST_WORD))

    def _who(self) -> str:
        return str(self.get_fully_qualified_name()).lstrip("/")

    @property
    def _now(self) -> int:
        """Return the simulated time in ns since the node started; it continues over resets."""
        return self._loop.total_steps * round(self._loop.simulator.time_step * 1e9)

    def _publish(self, topic: Topic, message: Any) -> None:
        publisher = self._publishers_by_name.get(topic.name)
        if publisher is not None:
            publisher.publish(message)

    def _is_heard(self, topic: Topic) -> bool:
        """Return True if the topic has a subscriber: to build a message costs more than a step."""
        publisher = self._publishers_by_name.get(topic.name)
        return publisher is not None and int(publisher.get_subscription_count()) > 0

    def _on_command(self, message: BicycleCommand) -> None:
        was_waiting = self._loop.waiting
        warning, step = self._loop.receive(convert.to_command(message))
        if warning:
            self.get_logger().warning(
                f"command for step {message.step} from {message.controller!r} ignored: {warning}"
            )
        if was_waiting and not self._loop.waiting:
            self._pace_from_now()
            self.get_logger().info(
                f"episode {message.episode} rides under {message.controller!r} from step "
                f"{self._loop.validator.newest.step if self._loop.validator.newest else 0}"
            )
        self._after_step(step)

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = message.pose.pose
        try:
            convert.to_goal(message.header.frame_id, pose.position, math.inf)
            speed = self._settings.speed_or_default(self._settings.start_speed)
            self._begin(convert.to_start(pose, speed), None)
        except ValueError as error:
            self.get_logger().warning(f"initial pose ignored: {error}")

    def _on_reset(self, request: Reset.Request, response: Reset.Response) -> Reset.Response:
        try:
            speed = self._settings.speed_or_default(request.speed)
            start = None if request.random_start else convert.to_start(request.pose, speed)
            self._begin(start, None if request.seed < 0 else int(request.seed))
            response.success = True
            response.message = (
                f"episode {self._loop.snapshot.episode} waits for its first command, seed "
                f"{self._loop.simulator.seed}"
            )
        except ValueError as error:
            response.success, response.message = False, f"not reset: {error}"
        response.episode = int(self._loop.snapshot.episode)
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        step = self._loop.pause(bool(request.data))
        self._pace_from_now()
        response.success = True
        response.message = "paused" if request.data else "goes on"
        self.get_logger().info(f"{response.message} at step {self._loop.snapshot.step}")
        self._after_step(step)
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        step = self._loop.single_step()
        self._after_step(step)
        response.success = step is not None
        if step is not None:
            response.message = f"step {step.snapshot.step}: {step.applied.source.name}"
        elif self._loop.snapshot.fallen:
            response.message = "the bicycle lies: call bicycle/reset first"
        else:
            response.message = "not paused: call bicycle/pause with true first"
        return response

    def _on_push(self, request: Push.Request, response: Push.Response) -> Push.Response:
        response.step = int(self._loop.snapshot.step)
        try:
            self._loop.push(mirror("lean_rate", request.lean_rate))
            response.success = True
            side = "right" if request.lean_rate > 0 else "left"
            response.message = f"pushed to the {side} at step {response.step}"
        except ValueError as error:
            response.success, response.message = False, f"not pushed: {error}"
        return response

    def _on_due(self) -> None:
        self._after_step(self._loop.tick())
        if self._loop.timed_out and not self._was_timed_out:
            what = WITHOUT_COMMANDS[self._settings.on_timeout]
            self.get_logger().warning(
                f"no valid command for {self._settings.watchdog_timeout:g} s at step "
                f"{self._loop.snapshot.step}: {what} until the next one; is the controller "
                "running?"
            )
        elif self._was_timed_out and not self._loop.timed_out:
            self.get_logger().info(f"commands again at step {self._loop.snapshot.step}")
        self._was_timed_out = self._loop.timed_out

    def _on_idle(self) -> None:
        """Repeat the state while the bicycle rests, reset it after a fall, report silence."""
        now = time.monotonic()
        wait = self._settings.reset_after_fall
        if self._loop.snapshot.fallen and 0 < wait < now - self._fallen_at:
            self._begin(self._settings.make_start(), None)
        if now - self._last_state >= STATE_PERIOD:
            self._publish_state()
        silent = self._loop.lockstep and self._loop.riding and self._loop.validator.silence() > 1.0
        if silent and not self._was_silent:
            self.get_logger().warning(
                f"no answer to step {self._loop.snapshot.step} for 1 s, lock-step waits: is the "
                "controller running?"
            )
        self._was_silent = silent

    def _on_report(self) -> None:
        array = DiagnosticArray(status=self._statuses())
        array.header.stamp = self.get_clock().now().to_msg()
        self._publish(topics.DIAGNOSTICS, array)

    def _statuses(self) -> list[DiagnosticStatus]:
        return self._report.statuses(self.count_publishers(topics.STATE.name))

    def _pace_from_now(self) -> None:
        """Make the next step due one period from now."""
        if not self._loop.lockstep:
            self._pace.reset()

    def _begin(self, start: InitialPose | None, seed: int | None) -> None:
        """Start an episode; see `Loop.reset`, which may raise ValueError."""
        # The sensors' clock begins anew with each episode, a second after the last one's end.
        ended = self._loop.simulator.sensor_time
        self._loop.reset(start, seed)
        self._sensor_base += round((ended + 1.0) * 1e9)
        self._was_timed_out = False
        simulator, settings = self._loop.simulator, self._settings
        info = EpisodeInfo(
            header=convert.to_header(self._now),
            episode=int(self._loop.snapshot.episode),
            seed=int(simulator.seed),
            pace=settings.pace,
            physics=simulator.plant.to_json(),
            scenario=simulator.scenario.to_json(),
            version=__version__,
        )
        self._publish(topics.EPISODE, info)
        self._publish_state()
        self.get_logger().info(f"episode {info.episode} waits for its first command")

    def _after_step(self, step: StepResult | None) -> None:
        """Publish a step, the state first: the controller waits for it."""
        if step is None:
            return
        if step.push is not None:
            self._publish(topics.PUSHED, convert.from_push(step.push, self._now))
        self._joints.advance(step.snapshot)
        self._publish_state()
        pacer = self._loop.pacer
        timing = LoopTiming(
            header=convert.to_header(self._now),
            episode=int(step.snapshot.episode),
            step=int(step.snapshot.step),
            period=float(step.timing.period),
            lateness=float(step.timing.lateness),
            latency=float(step.latency),
            late_steps=int(pacer.late),
            dropped_steps=int(pacer.dropped),
        )
        self._publish(topics.TIMING, timing)
        self._report.add(step)
        if step.snapshot.fallen:
            self._fallen_at = time.monotonic()
            self.get_logger().warning(
                f"fell at step {step.snapshot.step} of episode {step.snapshot.episode}, leaning "
                f"{math.degrees(-step.snapshot.lean_angle):.0f} degrees"
            )

    def _publish_readings(self) -> None:
        """Publish the readings that have arrived, and the sensors' time."""
        if self._sensors is None:
            return
        simulator, snapshot = self._loop.simulator, self._loop.snapshot
        for reading in simulator.readings:
            for topic, message in sensor_messages.messages(
                reading, self._sensor_base, self._sensors, self._frames
            ):
                self._publish(topic, message)
        simulator.readings = []
        time_now = self._sensor_base + round(simulator.sensor_time * 1e9)
        self._publish(
            topics.SENSOR_TIME,
            TimeReference(
                header=convert.to_header(self._now),
                time_ref=convert.to_stamp(time_now),
                source=f"{snapshot.episode} {snapshot.step}",
            ),
        )

    def _publish_state(self) -> None:
        snapshot, now, clock = self._loop.snapshot, self._now, time.monotonic()
        if self._is_heard(topics.COMMAND_ECHO):  # before its state
            applied = self._loop.simulator.applied
            echo = convert.from_applied(applied, snapshot.episode, snapshot.step, now)
            self._publish(topics.COMMAND_ECHO, echo)
        self._loop.published()
        self._publish_readings()
        self._publish(topics.STATE, convert.from_snapshot(snapshot, now))
        self._last_state = clock
        if self._settings.publish_clock and self._is_heard(topics.CLOCK):
            self._publish(topics.CLOCK, ClockMessage(clock=convert.to_stamp(now)))
        if self._is_heard(topics.ODOMETRY):
            odometry = visualization.odometry(snapshot, now, self._frames, self._loop.riding)
            self._publish(topics.ODOMETRY, odometry)
        rate = self._settings.tf_rate
        due = rate > 0 and clock - self._last_tf >= 1.0 / rate
        if due and self._is_heard(topics.TF):
            self._last_tf = clock
            travel = self._joints.travel
            moved = robot_model.transforms(snapshot, now, self._geometry, self._frames, travel)
            self._publish(topics.TF, moved)
        if self._is_heard(topics.JOINT_STATES):
            self._publish(
                topics.JOINT_STATES, self._joints.message(snapshot, now, self._loop.riding)
            )
        rate = self._settings.marker_rate
        due = rate > 0 and clock - self._last_markers >= 1.0 / rate
        if due and self._is_heard(topics.MARKERS):
            self._last_markers = clock
            drawn = visualization.markers(snapshot, now, self._geometry, self._frames)
            self._publish(topics.MARKERS, drawn)


def main() -> None:
    """Run the simulator until SIGINT or SIGTERM."""
    usage = (
        "usage: bicycle_sim [--ros-args -p NAME:=VALUE ... --params-file FILE]\n\n"
        "Simulates one bicycle at 40 Hz. Parameters and their defaults:\n" + describe(SimSettings)
    )
    sys.exit(run(NAME, SimNode, usage, executor=LOOP_EXECUTOR))
