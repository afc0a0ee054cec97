"""The cockpit as a ROS 2 node: hears everything, tells the pages, does what they ask."""

from __future__ import annotations

import os
import queue
from collections.abc import Callable
from typing import Any

from bicycle_msgs.msg import BicycleCommand, BicycleState, EpisodeInfo, GoalStatus, Push
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from bicycle_cockpit.bags import BagShelf
from bicycle_cockpit.choices import Choices
from bicycle_cockpit.live import Live
from bicycle_cockpit.nodes import reading
from bicycle_cockpit.nodes.asking import Asking
from bicycle_cockpit.nodes.recording import Recording
from bicycle_cockpit.options import Options
from bicycle_cockpit.requests import Request
from bicycle_cockpit.server import Server
from bicycle_controller.goals import Status
from bicycle_sim.nodes import convert, interfaces
from bicycle_sim.nodes.interfaces import listen
from bicycle_sim.nodes.runner import UserError
from bicycle_sim.push import LARGEST_PUSH

NAME = "bicycle_cockpit"
FRAME_PERIOD = 0.04
"""s between two frames."""
STATUS_PERIOD = 0.25
DEEP = 500
"""Changes of goals that are kept while the node is busy: a path makes many at once."""
LEVELS = {
    Status.REACHED: "good",
    Status.MISSED: "warn",
    Status.GIVEN_UP: "warn",
    Status.REJECTED: "bad",
    Status.FALLEN: "bad",
}


class CockpitNode(Node):
    """Between the topics and the pages."""

    def __init__(
        self, options: Options, recording: Recording, on_tick: Callable[[], str] = str
    ) -> None:
        """Begin to serve.

        Args:
            options: see there.
            recording: the recorder that pages may start.
            on_tick: called four times a second; a line that it returns is told to the pages.

        Raises:
            UserError: when the port cannot be had.
        """
        super().__init__(NAME)
        self.live = Live()
        self._command: BicycleCommand | None = None
        self._choices = Choices(options.models)
        self._recording, self._on_tick = recording, on_tick
        self._asking = Asking(self, self.live, self._choices, recording)
        self._inbox: queue.SimpleQueue[tuple[int, Request | None]] = queue.SimpleQueue()
        self._fallen = False
        self._listen()
        self.server = Server(
            options.door,
            options.port,
            BagShelf(options.bags),
            on_request=lambda page, request: self._inbox.put((page, request)),
            on_join=lambda page: self._inbox.put((page, None)),
            log=self.get_logger().warning,
        )
        try:
            self.server.start()
        except OSError as error:
            raise UserError(
                f"cannot listen on {options.door.address} port {options.port}: "
                f"{os.strerror(error.errno or 0)}; choose another with --port N"
            ) from None
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(FRAME_PERIOD, self._on_frame, clock=steady)
        self.create_timer(STATUS_PERIOD, self._on_status, clock=steady)

    def _listen(self) -> None:
        listen(self, interfaces.STATE, self._on_state)
        listen(self, interfaces.COMMAND, self._on_command)
        listen(self, interfaces.TIMING, self._on_timing)
        listen(self, interfaces.EPISODE, self._on_episode)
        listen(self, interfaces.DIAGNOSTICS, self._on_diagnostics)
        listen(self, interfaces.PUSHED, self._on_pushed)
        listen(self, interfaces.TRAINER, self._on_trainer)
        for topic in (interfaces.GOAL_POSE, interfaces.GOAL_PATH):
            listen(self, topic, lambda message: self.live.goals.sent(reading.points_of(message)))
        topic = interfaces.GOAL_STATUS
        wanted = topic.subscribe
        profile = QoSProfile(
            depth=DEEP, reliability=wanted.reliability, durability=wanted.durability
        )
        self.create_subscription(topic.type, topic.name, self._on_goal_status, profile)

    def close(self) -> None:
        """Say good-bye to the pages."""
        self.server.stop()

    # What the topics bring.

    def _on_state(self, state: BicycleState) -> None:
        fell = state.fallen and not self._fallen
        self._fallen = state.fallen
        if state.fallen:
            self.live.mode = "fallen"
        elif self.live.mode == "fallen":
            self.live.mode = "held"
        if self.live.due() or fell:
            moved = self.live.add(reading.to_sample(state, self._command, self.live.weights))
            if moved and state.step > 0 and self.live.mode == "held":
                self.live.mode = "riding"
        if fell:
            self._tell("bad", "the bicycle fell: reset it", kind="fell")

    def _on_command(self, command: BicycleCommand) -> None:
        self._command = command
        if command.policy != self.live.policy:
            self.live.policy = command.policy
            self._tell("info", f"{command.policy} rides", kind="policy", name=command.policy)

    def _on_timing(self, timing: Any) -> None:
        self.live.loop.add(timing)

    def _on_episode(self, info: EpisodeInfo) -> None:
        try:
            scenario, physics = convert.to_setting(info)
        except (ValueError, TypeError) as error:
            self.get_logger().warning(f"episode info ignored: {error}; are both of one version?")
            return
        self.live.weights = scenario.reward
        constants = physics.constants
        self.live.facts = {
            "episode": int(info.episode),
            "seed": int(info.seed),
            "pace": info.pace,
            "scenario": scenario.name,
            "goal_radius": scenario.goal_radius,
            "fall_angle": scenario.fall_angle,
            "limits": [float(limit) for limit in scenario.action_limits],
            "wheelbase": constants.wheelbase,
            "time_step": constants.time_step,
            "steer_stop": constants.steer_stop,
        }
        self.server.newest({"type": "facts", **self.live.facts})
        self._tell("info", f"episode {info.episode} begins, seed {info.seed}", kind="reset")

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        word = reading.simulator_word(array)
        if word is not None:
            self.live.mode, self.live.commands_text = word

    def _on_goal_status(self, change: GoalStatus) -> None:
        position = (float(change.position.x), float(change.position.y))
        self.live.goals.changed(change.status, position, int(change.remaining))
        status = Status(change.status)
        if status in (Status.QUEUED, Status.REPLACED):
            return
        name = status.name.lower()
        text = f"goal ({position[0]:.1f}, {position[1]:.1f}) {name.replace('_', ' ')}"
        text += f": {change.message}" if change.message else ""
        place = {"x": position[0], "y": position[1]} if position[0] == position[0] else {}
        self._tell(LEVELS.get(status, "info"), text, kind=name, **place)

    def _on_pushed(self, push: Push) -> None:
        side = "right" if push.lean_rate > 0 else "left"
        text = f"pushed to the {side}, {abs(push.lean_rate):.2f} rad/s"
        self._tell("info", text, kind="push")

    def _on_trainer(self, status: Any) -> None:
        facts = reading.trainer_facts(status)
        self.live.trained(facts)
        self.server.newest(facts)

    # What time brings.

    def _on_frame(self) -> None:
        """Do what the pages asked for, and send what is new."""
        while True:
            try:
                page, request = self._inbox.get_nowait()
            except queue.Empty:
                break
            if request is None:
                self._welcome(page)
            else:
                self._asking.carry_out(request, self._replier(page, request.id))
        self._asking.look()
        frame = self.live.frame()
        if frame is not None and self.server.pages:
            self.server.frame(frame)

    def _on_status(self) -> None:
        line = self._on_tick() or self._recording.look()
        if line:
            self._tell("info", line, kind="process")
        status = self.live.status(
            pages=self.server.pages,
            dropped_frames=self.server.dropped,
            controllers=self.count_publishers(interfaces.COMMAND.name),
            recording=self._recording.name,
        )
        self.server.newest(status)

    def _welcome(self, page: int) -> None:
        hello = self.live.hello()
        choices = {"controllers": self._choices.offered(), "largest_push": LARGEST_PUSH}
        self.server.letter({**hello, **choices}, page)

    def _replier(self, page: int, number: int) -> Callable[[bool, str], None]:
        def reply(ok: bool, text: str) -> None:
            answer = {"type": "answer", "id": number, "ok": ok, "message": text}
            self.server.letter(answer, page)

        return reply

    def _tell(self, level: str, text: str, **more: Any) -> None:
        """Tell all pages that something happened."""
        self.server.letter(self.live.event(level, text, **more))
