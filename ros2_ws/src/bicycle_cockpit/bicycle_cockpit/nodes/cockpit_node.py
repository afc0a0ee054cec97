"""Cockpit as a ROS 2 node: it receives all topics, updates the pages, executes requests."""

from __future__ import annotations

import os
import queue
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from bicycle_cockpit import ride_setup
from bicycle_cockpit.event_room import EventRoom
from bicycle_cockpit.nodes.hearing import Hearing
from bicycle_cockpit.nodes.recording import Recording
from bicycle_cockpit.nodes.request_handler import RequestHandler
from bicycle_cockpit.nodes.ride_conditions import RideConditions, StartedRide
from bicycle_cockpit.options import Options
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.requests import Request
from bicycle_cockpit.ride_state import RideState
from bicycle_cockpit.server import Server
from bicycle_cockpit.trouble import Line, Trouble
from bicycle_common.nodes import topics
from bicycle_common.nodes.runner import UserError
from bicycle_sim.runtime.push import LARGEST_PUSH

NAME = "bicycle_cockpit"
FRAME_PERIOD = 0.04
"""Period of frames (s)."""
STATUS_PERIOD = 0.25


class CockpitNode(Node):
    """Connects the topics with the pages."""

    def __init__(
        self,
        options: Options,
        recording: Recording,
        ride: StartedRide,
        on_tick: Callable[[], Line | None],
    ) -> None:
        """Start to serve.

        Args:
            options: see there.
            recording: the recorder that pages may start.
            ride: simulator and controller, which pages may set up anew.
            on_tick: called four times a second; a returned line is sent to the pages. It may raise
                UserError, which is sent too and ends the node.

        Raises:
            UserError: if the port is not available.
        """
        super().__init__(NAME)
        self.live = RideState()
        self._choices = PolicyCatalogue(options.models)
        self._recording, self._on_tick = recording, on_tick
        self._trouble = Trouble(options.ride)
        self._conditions = RideConditions(self, ride)
        self._asking = RequestHandler(
            self, self.live, self._choices, recording, ride, self._conditions
        )
        self._setups = {"ours": ride.ours, **ride_setup.choices()}
        self._told_setup = self._conditions.facts()
        self._room = EventRoom()
        self._inbox: queue.SimpleQueue[tuple[int, Request | None]] = queue.SimpleQueue()
        self.server = Server(
            options.door,
            options.port,
            options.bags,
            on_request=lambda page, request: self._inbox.put((page, request)),
            on_join=lambda page: self._inbox.put((page, None)),
            log=self.get_logger().warning,
        )
        self._hearing = Hearing(self, self.live, self._trouble, self._tell, self._newest)
        topics.listen(self, topics.EPISODE, lambda message: self._conditions.episode_began())
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

    def close(self) -> None:
        """Disconnect the pages."""
        self.server.stop()

    # Timers.

    def _on_frame(self) -> None:
        """Execute the pages' requests, and send new data."""
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
        self._hearing.look()
        rows = self.live.frame()
        if rows is not None and self.server.pages:
            self.server.stream(rows)

    def _on_status(self) -> None:
        try:
            line = self._on_tick()
        except UserError as error:
            self._tell("bad", f"the cockpit ends: {error}", kind="end")
            self.close()
            raise
        line = line or self._recording.look()
        if line is not None:
            self._tell(line.level, line.text, kind="process")
            self._trouble.told(line)
        self._conditions.look()
        facts = self._conditions.facts()
        if facts != self._told_setup:
            self._told_setup = facts
            self._newest({"type": "setup", **facts})
        left_out = self._room.left_out()
        if left_out:
            words = f"{left_out} more events came at once and are not listed"
            self.server.reliable(self.live.event("info", words))
        controllers = self.count_publishers(topics.COMMAND.name)
        status = self.live.status(
            pages=self.server.pages,
            dropped_frames=self.server.dropped,
            controllers=controllers,
            recording=self._recording.state,
            misfit=self._asking.suits.misfit(),
            trouble=self._trouble.now(self.live.hears_simulator, controllers),
        )
        self.server.latest(status)

    def _welcome(self, page: int) -> None:
        choices = {"controllers": self._choices.offered(), "largest_push": LARGEST_PUSH}
        choices["setups"] = self._setups
        choices["setup"] = self._conditions.facts()
        hello = {**self.live.hello(), **choices}
        self.server.greet(page, hello, self.live.history())

    def _replier(self, page: int, number: int) -> Callable[[bool, str], None]:
        def reply(ok: bool, text: str) -> None:
            answer = {"type": "answer", "id": number, "ok": ok, "message": text}
            self.server.reliable(answer, page)

        return reply

    def _tell(self, level: str, text: str, **more: Any) -> None:
        """Report an event to all pages, within its rate limit."""
        if self._room.take(str(more.get("kind", ""))):
            self.server.reliable(self.live.event(level, text, **more))

    def _newest(self, data: dict[str, Any]) -> None:
        """Send all pages data that replace older data of the type; assign colours to riders."""
        self.server.colour([one["colour"] for one in data.get("riders", ())])
        self.server.latest(data)
