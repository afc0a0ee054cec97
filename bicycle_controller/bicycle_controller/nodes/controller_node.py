"""Controller as a ROS 2 node: states in, commands out; it takes goals and policies."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_controller.nodes.controller_node")

import os
import secrets
import sys
import threading
import time
from typing import Any

import numpy as np
from bicycle_msgs.msg import BicycleState as StateMessage
from bicycle_msgs.msg import CommandEcho, EpisodeInfo
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_msgs.msg import String

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.declare_parameters import declare, follow
from bicycle_common.nodes.diagnostics import OK, WARN, percentiles, status
from bicycle_common.nodes.realtime import Priority
from bicycle_common.nodes.runner import LOOP_EXECUTOR, UserError, run
from bicycle_common.nodes.topics import Topic, advertise, listen
from bicycle_common.parameters import describe
from bicycle_common.types import AppliedCommand, BicycleState
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.goals import GoalTracker
from bicycle_controller.control.guidance import Guidance
from bicycle_controller.control.guide import PathEnd
from bicycle_controller.control.keep_clear import UNHEARD
from bicycle_controller.nodes.action_desk import ActionDesk, Orders
from bicycle_controller.nodes.controller_settings import ControllerSettings
from bicycle_controller.nodes.echo_pairing import EchoPairing
from bicycle_controller.nodes.estimator import Estimator
from bicycle_controller.nodes.goal_desk import GoalDesk
from bicycle_controller.nodes.guiding import Guiding
from bicycle_controller.nodes.hand_over_marks import HandOverMarks
from bicycle_controller.nodes.messages import from_hand_over
from bicycle_controller.nodes.policy_loader import Making, PolicyLoader
from bicycle_controller.nodes.setup import NO_LIMITS, Setup, designed, limits_of
from bicycle_controller.policy.policy import PolicyError, load_controller
from bicycle_controller.policy.trained_for import UNLIKE, rides_any, unlike_training, warning
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.nodes.robot_model import frames_of
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.task.scenario import Scenario

NAME = "bicycle_controller"
SILENCE = 1.0
"""Longest time without a state before a warning (s); states come at least every 0.1 s."""
WARM_UP = 0.002
"""Time between the policy's warm-up and the next state, beyond the duration of an answer (s)."""


class ControllerNode(LifecycleNode):
    """Answers every state of one bicycle with one command, while it is active."""

    def __init__(self) -> None:
        """Load the policy and wait for states.

        Raises:
            UserError: on a bad parameter or a policy that cannot be loaded.
        """
        super().__init__(NAME)
        self._settings = declare(self, ControllerSettings)
        self._making, self._priority = Making(), Priority()
        self._plant = registry.default()
        self._loop = self._make_loop()
        self._in_use = threading.Lock()
        self._simulator_limits = NO_LIMITS
        self._ridden: tuple[Plant[Any], Scenario] | None = None
        self._unlike = ""
        self._bad_states = 0
        self._heard = time.monotonic()
        self._active = False
        self._state_was_bad = False
        self._marks = HandOverMarks(frames_of(self.get_namespace()))
        self._echoes: EchoPairing[StateMessage, AppliedCommand | None] = EchoPairing()
        self._publishers_by_name = advertise(
            self,
            topics.COMMAND,
            topics.GOAL_STATUS,
            topics.ORDERED_GOALS,
            topics.ACTIVE_GOAL,
            topics.GOAL_MARKER,
            topics.HAND_OVER,
            topics.HAND_OVER_MARKERS,
            topics.DIAGNOSTICS,
            topics.FOLLOWED_PATH,
            topics.PATH_STATUS,
            topics.CONTROLLER_SETUP,
        )
        self._newest: tuple[BicycleState | None, float] = None, 0.0
        self._guidance, self._guiding = self._make_guidance()
        self._goals = GoalDesk(
            self,
            self._guidance,
            self._loop.tracker,
            self._in_use,
            self._publish,
            lambda: self._settings,
            lambda: self._active,
        )
        follow(self, self._settings, self._change)
        # Subscribe to episodes first, so a reset cancels only older goals.
        sensors = self._sensors()
        self._tell_setup(sensors)
        self._estimator = None
        if sensors is not None:
            self._estimator = Estimator(self, sensors, self._settings.start(), self._on_state)
        listen(self, topics.EPISODE, self._on_episode)
        listen(self, topics.COMMAND_ECHO, self._on_echo, depth=1)
        if self._estimator is None:
            listen(self, topics.STATE, self._on_state, depth=1)
        self._goals.listen()
        self._loader = PolicyLoader(self, lambda: self._loop.policy.policy_id, self._swap)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self._settings.diagnostics_period, self._on_report, clock=steady)
        self._warms_up = False
        self._warm_up = self.create_timer(SILENCE, self._on_warm_up, clock=steady)
        self._warm_up.cancel()
        if self._settings.managed:
            self.get_logger().info("waits to be configured and activated")
        else:
            self.trigger_configure()
            self.trigger_activate()
        # The desk's thread serves at once: made earlier, it would refuse an order as inactive.
        self._desk = ActionDesk(
            self,
            Orders(self._goals.ride, self._goals.follow, self._goals.cancel, lambda: self._newest),
        )
        self._guiding.on_report = self._desk.tell

    # The policy is loaded before the managed states begin, so that a bad one ends the process with
    # one line.

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Answer states and take orders from now on."""
        self._active = True
        self.get_logger().info(f"{self._loop.policy.policy_id} waits for a goal")
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Answer no state any more, which the simulator takes as silence."""
        self._rest()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Rest for good."""
        self._rest()
        return super().on_shutdown(state)

    def _rest(self) -> None:
        """End what is ridden, and answer no state."""
        with self._in_use:
            self._active = False
            self._guidance.stop("the controller is no longer active", PathEnd.CANCELLED)
            self._loop.tracker.cancel("the controller is no longer active")
        self._desk.end("the controller is no longer active")
        self.get_logger().info("answers no state until it is activated")

    def _make_loop(self) -> ControlLoop:
        settings = self._settings
        try:
            policy = load_controller(settings.policy)
        except PolicyError as error:
            raise UserError(str(error)) from None
        own = limits_of(policy)
        return ControlLoop(
            f"{self.get_fully_qualified_name()}.{os.getpid()}.{secrets.token_hex(2)}",
            policy,
            GoalTracker(settings.goal_radius or 1.0, settings.goal_timeout, settings.orbit_turns),
            own,
            settings.make_noise(),
            settings.make_fallback(own, self._plant),
            settings.take_over,
            settings.make_safety(self._plant),
            self._plant,
        )

    def _make_guidance(self) -> tuple[Guidance, Guiding]:
        try:
            config = self._settings.make_guidance()
            others = self._settings.names_to_keep_clear_of()
        except ValueError as error:
            raise UserError(str(error)) from None
        guidance = Guidance(self._loop, config)
        if (own := self.get_namespace().strip("/")) in others:
            raise UserError(f"parameter keep_clear holds {own!r}, this bicycle: name the others")
        guiding = Guiding(
            self,
            guidance,
            self._publish,
            self._in_use,
            lambda: self._active,
            lambda: self._newest[1],
            others,
        )
        return guidance, guiding

    def _tell_setup(self, sensors: SensorSettings | None) -> None:
        setup = Setup(self._loop.name, self._settings, sensors)
        self._publish(topics.CONTROLLER_SETUP, String(data=setup.to_json()))

    def _change(self, settings: ControllerSettings) -> None:
        """Take settings that have changed while it runs.

        Raises:
            ValueError: if they do not go together.
        """
        config = settings.make_guidance()
        with self._in_use:
            tracker, before = self._loop.tracker, self._settings
            self._settings = settings
            self._guidance.config = config
            tracker.timeout, tracker.turns = settings.goal_timeout, settings.orbit_turns
            if settings.goal_radius != before.goal_radius:
                own = self._ridden[1].goal_radius if self._ridden is not None else 1.0
                tracker.radius = settings.goal_radius or own
        self._tell_setup(self._sensors())

    def _sensors(self) -> SensorSettings | None:
        """Return the sensors whose estimates are answered; None where the truth is.

        Raises:
            UserError: when there are no such sensors.
        """
        try:
            return self._settings.make_sensors()
        except ValueError as error:
            raise UserError(str(error)) from None

    def close(self) -> None:
        """Stop serving actions and loading policies."""
        self._desk.close()
        self._loader.close()
        self._guiding.close()

    def _publish(self, topic: Topic, message: Any) -> None:
        self._publishers_by_name[topic.name].publish(message)

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text)

    def _on_echo(self, message: CommandEcho) -> None:
        """Keep the command that led to the next state, and answer a state that waited for it."""
        try:
            applied = convert.to_applied(message)
        except ValueError:  # such a state is answered as one without an echo
            applied = None
        waiting = self._echoes.add((message.episode, message.step), applied)
        if waiting is not None:
            self._answer(waiting)

    def _on_state(self, message: StateMessage) -> None:
        """Answer the newest state, once the command that led to it is known."""
        self._heard = time.monotonic()
        key = message.episode, message.step
        echoed = (
            not self._echoes.knows(key) and self.count_publishers(topics.COMMAND_ECHO.name) > 0
        )
        if not self._echoes.holds(key, message, echoed):
            self._answer(message)

    def _answer(self, message: StateMessage) -> None:
        """Answer a state."""
        self._take_fallback()
        snapshot = convert.to_snapshot(message)
        if not snapshot.is_finite:
            self._on_bad_state("it holds a number that is not finite")
            return
        self._state_was_bad = False
        stamp = message.header.stamp
        with self._in_use:
            self._newest = snapshot, stamp.sec + stamp.nanosec * 1e-9
            if not self._active:
                return
            self._guidance.poll(snapshot)
            applied = self._echoes.of((snapshot.episode, snapshot.step))
            answer = self._loop.answer(*self._newest, applied)
        if answer.command is not None:
            now = self.get_clock().now().to_msg()
            self._publish(topics.COMMAND, convert.from_command(answer.command, now))
        if answer.warning:
            self._warn(answer.warning)
        if answer.hand_over is not None:
            told = from_hand_over(answer.hand_over, stamp)
            self._publish(topics.HAND_OVER, told)
            place = snapshot.rear_x, snapshot.rear_y
            self._publish(topics.HAND_OVER_MARKERS, self._marks.add(told, place))
            self._warn(f"at step {snapshot.step} {answer.hand_over.message}")
        for event in map(self._goals.judge, answer.events):
            self._desk.tell(event)
            self._goals.report(event)
        with self._in_use:
            self._guiding.after_state(snapshot)
        if self._warms_up and answer.command is not None:
            self._warm_up.reset()

    def _on_warm_up(self) -> None:
        """Warm up for the next state, once."""
        self._warm_up.cancel()
        with self._in_use:
            self._loop.warm_up()

    def _on_bad_state(self, why: str) -> None:
        self._bad_states += 1
        if not self._state_was_bad:
            self._warn(f"state not answered: {why}; reset the simulator")
        self._state_was_bad = True

    def _on_episode(self, info: EpisodeInfo) -> None:
        """Adopt the simulator's limits and goal radius."""
        try:
            scenario, plant = to_setting(info)
        except (ValueError, TypeError) as error:
            self._warn(f"episode info ignored: {error}; are both of one version?")
            return
        if self._settings.goal_radius == 0:
            self._loop.tracker.radius = scenario.goal_radius
        self._publish(topics.HAND_OVER_MARKERS, self._marks.clear())
        with self._in_use:
            self._simulator_limits = scenario.action_limits
            self._ridden = plant, scenario
            if self._estimator is not None:
                self._estimator.ride(plant)
            self._loop.policy = self._designed(self._loop.policy)
            self._loop.plant = plant
            self._limit()
            self._guidance.ride(plant, self._simulator_limits)
            self._suit(plant)
            self._compare()
        wait = plant.time_step - WARM_UP
        self._warms_up = info.pace == "realtime" and 0.0 < wait < SILENCE
        if self._warms_up:
            self._warm_up.timer_period_ns = round(1e9 * wait)
        wanted = self._settings.realtime_priority if info.pace == "realtime" else 0
        told = self._priority.take(wanted)
        if told:
            self.get_logger().info(told)

    def _compare(self) -> None:
        """Warn if the policy rides another bicycle than it was trained on."""
        if self._ridden is None:
            return
        policy = self._loop.policy
        told = warning(policy.policy_id, unlike_training(policy, *self._ridden))
        if told and told != self._unlike:
            self._warn(told)
        self._unlike = told

    def _limit(self) -> None:
        """Limit the commands to what the simulator accepts."""
        policy = self._loop.policy
        own = limits_of(policy)
        self._loop.limits = np.minimum(own, self._simulator_limits)
        if self._ridden is not None and rides_any(policy, self._ridden[0]):
            return
        if (own[np.isfinite(own)] > self._simulator_limits[np.isfinite(own)]).any():
            self._warn(
                f"policy {policy.policy_id} may use {_shown(own)}, the simulator allows "
                f"{_shown(self._simulator_limits)}: its commands are cut; choose a scenario "
                "that suits it"
            )

    def _designed(self, policy: Controller) -> Controller:
        """Return the policy; an LQR for another kind of bicycle is designed for the ridden one."""
        if self._ridden is None:
            return policy
        try:
            return designed(policy, self._ridden[0])
        except (ValueError, ArithmeticError, TypeError) as error:
            self._warn(f"no LQR for this bicycle, the policy stays as it was: {error}")
            return policy

    def _suit(self, plant: Plant[Any]) -> None:
        """Adapt the fallback and the safety layer to the simulated bicycle."""
        settings, limits = self._settings, self._loop.limits
        if self._estimator is None:
            # Computing LQR gains takes longer than one step; do it in a thread.
            self._making.begin(lambda: settings.make_fallback(limits, plant))
        else:
            # It rests to be calibrated, and a verification expects this one from the first step.
            try:
                self._loop.fallback = settings.make_fallback(limits, plant)
            except (ValueError, ArithmeticError, TypeError) as error:
                self._warn(f"no LQR for this bicycle, the fallback stays as it was: {error}")
        if plant == self._plant:
            return
        try:
            self._loop.safety = settings.make_safety(plant)
            self._plant = plant
        except (ValueError, ArithmeticError, TypeError) as error:
            self._warn(f"the safety layer stays as it was, for this bicycle has none: {error}")

    def _take_fallback(self) -> None:
        """Use the fallback that has become ready."""
        for made in self._making.ready():
            if isinstance(made, Exception):
                self._warn(f"no LQR for this bicycle, the fallback stays as it was: {made}")
            else:
                self._loop.fallback = made

    def _swap(self, policy: Controller) -> str:
        """Use another policy from the next state on; called in another thread.

        Returns:
            A warning; empty if there is none.
        """
        policy = self._designed(policy)
        with self._in_use:
            self._loop.policy = policy
            self._limit()
            self._suit(self._plant)
            self._compare()
            return self._unlike

    def _on_report(self) -> None:
        array = DiagnosticArray(status=[self._status()])
        array.header.stamp = self.get_clock().now().to_msg()
        self._publish(topics.DIAGNOSTICS, array)

    def _status(self) -> DiagnosticStatus:
        loop = self._loop
        goal = loop.tracker.active
        text = f"rides to goal {goal.goal_id}" if goal else "waits for a goal"
        path = self._guidance.path
        if path is not None:
            text = f"follows path {path.path_id} {path.name}: {path.message}"
        silence = time.monotonic() - self._heard
        if silence > SILENCE:
            text = f"no state for {silence:.0f} s: is the simulator running on this domain?"
        if loop.driving:
            text = f"{loop.driving} drives, not {loop.policy.policy_id}"
        other = loop.standby.other
        if other:
            text = f"stands by: {other} drives this bicycle"
        unheard = ", ".join(self._guiding.unheard)
        if unheard:
            text = f"hears nothing of {unheard}, and cannot keep clear of it"
        if not self._active:
            text = "is not active: it answers no state"
        bad = self._state_was_bad or loop.failing or bool(loop.driving or other)
        bad = bad or not self._active or silence > SILENCE
        bad = bad or bool(self._unlike or unheard)
        name = f"{self.get_fully_qualified_name().lstrip('/')}: policy"
        values: dict[str, object] = {
            "policy": loop.policy.policy_id,
            "controller": loop.name,
            "answered": loop.answered,
            "missed steps": loop.missed,
            "answers by the fallback": loop.handed_over,
            **loop.safety_facts(),
            "bad states": self._bad_states,
            UNLIKE: self._unlike or "no",
            "goals waiting": loop.tracker.waiting,
            UNHEARD: unheard or "none",
            **percentiles(list(loop.times), "answer"),
            **percentiles(list(loop.policy_times), "policy"),
        }
        return status(name, WARN if bad else OK, text, values)


def _shown(limits: np.ndarray) -> str:
    torque, displacement, pedal = limits
    return f"T ±{torque:g} N m, d ±{displacement:g} m, F ±{pedal:g} N"


def main() -> None:
    """Run the controller until SIGINT or SIGTERM."""
    usage = (
        "usage: bicycle_controller [--ros-args -p NAME:=VALUE ... --params-file FILE]\n\n"
        "Balances the bicycle and rides it to goals. Parameters and their defaults:\n"
        + describe(ControllerSettings)
    )
    sys.exit(run(NAME, ControllerNode, usage, executor=LOOP_EXECUTOR))
