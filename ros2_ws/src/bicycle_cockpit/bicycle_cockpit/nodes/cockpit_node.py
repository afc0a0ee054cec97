"""Cockpit as a ROS 2 node: it receives all topics, updates the pages, executes requests."""

from __future__ import annotations

import queue
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from bicycle_cockpit import ride_setup
from bicycle_cockpit.event_room import EventRoom
from bicycle_cockpit.listening import why_not
from bicycle_cockpit.nodes.other_bicycles import OtherBicycles, in_order
from bicycle_cockpit.nodes.recording import RecorderProcess
from bicycle_cockpit.nodes.ride_conditions import StartedRide
from bicycle_cockpit.nodes.shown_bicycle import NotOurs, ShownBicycle
from bicycle_cockpit.options import CockpitOptions
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.requests import Request, ShowBicycle
from bicycle_cockpit.server import Server
from bicycle_cockpit.trouble import Line
from bicycle_common.nodes.runner import UserError
from bicycle_sim.runtime.push import LARGEST_PUSH

NAME = "bicycle_cockpit"
FRAME_PERIOD = 0.04
"""Period of frames (s)."""
STATUS_PERIOD = 0.25
FLEET_FRAMES = 4
"""Frames between two of the other bicycles' places: a timer of their own would wake the node."""


class CockpitNode(Node):
    """Connects the topics with the pages.

    Attributes:
        shown: the bicycle that all pages show and steer.
    """

    def __init__(
        self,
        options: CockpitOptions,
        recording: RecorderProcess,
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
        self._options = options
        self._choices = PolicyCatalogue(options.models)
        self._recording, self._on_tick = recording, on_tick
        self._setups = ride_setup.choices()
        self._ride = ride
        self._told_setup: dict[str, Any] = {}
        self._room = EventRoom()
        self._inbox: queue.SimpleQueue[tuple[int, Request | None]] = queue.SimpleQueue()
        self.server = Server(
            options.access_policy,
            options.port,
            options.bags,
            on_request=lambda page, request: self._inbox.put((page, request)),
            on_join=lambda page: self._inbox.put((page, None)),
            log=self.get_logger().warning,
            choices=self._choices,
        )
        self._others = OtherBicycles(self)
        self.shown = self._made(options.namespace)
        self._is_chosen = options.ride or options.namespace != "/"
        self._choice: str | None = None
        self._first: set[str] = set()
        self._told_fleet: dict[str, Any] = {}
        self._frames = 0
        try:
            self.server.start()
        except OSError as error:
            address = options.access_policy.address
            raise UserError(why_not(error, address, options.port)) from None
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(FRAME_PERIOD, self._on_frame, clock=steady)
        self.create_timer(STATUS_PERIOD, self._on_status, clock=steady)

    def close(self) -> None:
        """Disconnect the pages."""
        self.server.stop()

    # The bicycle that is shown.

    def _made(self, namespace: str) -> ShownBicycle:
        """Return a bicycle to show, with nothing heard of it yet."""
        ours = self._ride.ours and namespace == self._options.namespace
        return ShownBicycle(
            namespace,
            self._choices,
            self._recording,
            self._ride if ours else NotOurs(),
            self._tell,
            self._newest,
            self._options.rules,
        )

    def _choose(self, namespace: str) -> None:
        """Show another bicycle to all pages."""
        before, self.shown = self.shown, self._made(namespace)
        if before.node.executor is not None:
            before.node.executor.remove_node(before.node)
        before.close()
        self._others.watch(namespace)
        self.server.begin_anew(self._hello(), [])

    def _look_at_choice(self) -> None:
        """Show the bicycle that a page has chosen, or the first one until a page steers.

        Bicycles are found in any order; one that was shown and is away may be started again.
        """
        wanted, self._choice = self._choice, None
        if wanted is not None:
            self._is_chosen = True
        elif not self._is_chosen and self._others.names:
            wanted = in_order(self._first.union(self._others.names))[0]
            self._first = {wanted}
        if wanted is not None and wanted != self.shown.namespace:
            self._choose(wanted)

    def _carry_out(self, request: Request, reply: Callable[[bool, str], None]) -> None:
        """Begin a request of a page."""
        if not isinstance(request, ShowBicycle):
            self._is_chosen |= bool(self._first)
            self.shown.asking.carry_out(request, reply)
        elif request.name in self._others.names:
            self._choice = request.name
            reply(True, f"{request.name} is shown and steered")
        else:
            reply(False, f"no bicycle {request.name!r} is heard")

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
                self._carry_out(request, self._replier(page, request.id))
        self._look_at_choice()
        if self.executor is not None and self.shown.node.executor is None:
            self.executor.add_node(self.shown.node)
        self.shown.asking.look()
        self.shown.hearing.look()
        rows = self.shown.live.frame()
        if rows is not None and self.server.pages:
            self.server.stream(rows)
        self._frames += 1
        if self._frames % FLEET_FRAMES == 0:
            self._tell_fleet()

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
            if self.shown.ride.ours:
                self.shown.trouble.told(line)
        self.shown.conditions.look()
        facts = self.shown.conditions.facts()
        if facts != self._told_setup:
            self._told_setup = facts
            self._newest({"type": "setup", **facts})
        left_out = self._room.left_out()
        if left_out:
            words = f"{left_out} more events came at once and are not listed"
            self.server.reliable(self.shown.live.event("info", words))
        live, controllers = self.shown.live, self.shown.controllers
        status = live.status(
            pages=self.server.pages,
            dropped_frames=self.server.dropped,
            controllers=controllers,
            recording=self._recording.state,
            misfit=self.shown.asking.suits.misfit(),
            trouble=self.shown.trouble.now(live.hears_simulator, controllers),
        )
        self.server.latest(status)

    def _tell_fleet(self) -> None:
        """Look for other bicycles, and send their places to the pages."""
        self._others.look(self.shown.namespace)
        if self.server.pages:
            told = self._others.message(self.shown.namespace)
            if told["others"] or told != self._told_fleet:
                self._told_fleet = told
                self._newest(told)

    def _welcome(self, page: int) -> None:
        self.server.greet(page, self._hello(), self.shown.live.history())

    def _hello(self) -> dict[str, Any]:
        """Return the first message to a page."""
        choices = {"controllers": self._choices.offered(), "largest_push": LARGEST_PUSH}
        choices["setups"] = {"ours": self.shown.ride.ours, **self._setups}
        choices["setup"] = self.shown.conditions.facts()
        return {**self.shown.live.hello(), **choices}

    def _replier(self, page: int, number: int) -> Callable[[bool, str], None]:
        def reply(ok: bool, text: str) -> None:
            answer = {"type": "answer", "id": number, "ok": ok, "message": text}
            self.server.reliable(answer, page)

        return reply

    def _tell(self, level: str, text: str, **more: Any) -> None:
        """Report an event to all pages, within its rate limit."""
        if self._room.take(str(more.get("kind", ""))):
            self.server.reliable(self.shown.live.event(level, text, **more))

    def _newest(self, data: dict[str, Any]) -> None:
        """Send all pages data that replace older data of the type; assign colours to riders."""
        self.server.colour([one["colour"] for one in data.get("riders", ())])
        self.server.latest(data)
