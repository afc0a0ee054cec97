"""Executes the pages' requests: publishes goals, calls services, and answers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import singledispatchmethod
from typing import Any

from bicycle_msgs.action import FollowPath
from bicycle_msgs.srv import LoadPolicy
from bicycle_msgs.srv import Push as PushService
from bicycle_msgs.srv import Reset as ResetService
from rclpy.action import ActionClient
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from bicycle_cockpit import requests, ride_setup
from bicycle_cockpit.fit import Suits
from bicycle_cockpit.nodes.recording import RecorderProcess
from bicycle_cockpit.nodes.ride_conditions import RideConditions, StartedRide
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.rate_limiter import RateLimiter
from bicycle_cockpit.ride_setup import RideSetup
from bicycle_cockpit.ride_state import RideState
from bicycle_cockpit.riders import label
from bicycle_common.nodes import topics
from bicycle_common.nodes.goal_orders import GoalOrders
from bicycle_common.nodes.topics import Service
from bicycle_common.types import Point2D
from bicycle_controller.control import courses

PATIENCE = 10.0
"""Time limit of a service's answer (s)."""
RESEND, MOST_RESENT = 2.0, 5
"""Time after which a goal that no controller has taken is sent again (s), and how often.

A controller that has just started may not hear the topic yet.
"""
GOAL_RATE, GOAL_BURST = 4.0, 12.0
"""Rate and burst of goals from all pages together."""

Reply = Callable[[bool, str], None]
Words = Callable[[Any], str]
"""Text for the user about a service's answer."""


@dataclass
class _Call:
    """Pending service call."""

    future: Any
    since: float
    reply: Reply
    name: str
    words: Words


class RequestHandler:
    """Turns requests into topics and service calls; belongs to the executor's thread.

    Args:
        node: to publish and call through.
        live: state of the ride.
        choices: controllers that can be chosen.
        recording: recorder that pages can start.
        ride: simulator and controller, which pages can set up anew.
        conditions: of that ride.
        tell: report an event to all pages, with its level and text.

    Attributes:
        suits: compatibility of the chosen controller with the bicycle.
    """

    def __init__(
        self,
        node: Node,
        live: RideState,
        choices: PolicyCatalogue,
        recording: RecorderProcess,
        ride: StartedRide,
        conditions: RideConditions,
        tell: Callable[[str, str], None],
    ) -> None:
        self._node, self._live, self._ride, self._tell = node, live, ride, tell
        self._conditions = conditions
        self._choices, self._recording = choices, recording
        self.suits = Suits(choices, live)
        self._goal_rate = RateLimiter(GOAL_RATE, GOAL_BURST)
        self._calls: list[_Call] = []
        self._sent: tuple[list[Point2D], float | None] = ([], None)
        self._resent, self._sent_at = 0, 0.0
        self._orders = GoalOrders(node)
        services = (
            topics.PUSH,
            topics.PAUSE,
            topics.STEP,
            topics.RESET,
            topics.LOAD_POLICY,
        )
        self._clients = {s.name: node.create_client(s.type, s.name) for s in services}
        self._course = ActionClient(node, FollowPath, topics.FOLLOW_PATH_ACTION.name)

    def carry_out(self, request: requests.Request, reply: Reply) -> None:
        """Begin a request; `reply` is called once, now or later, with the result."""
        self._do(request, reply)

    def close(self) -> None:
        """Leave the actions; the services' clients go with the node."""
        self._orders.close()
        self._course.destroy()
        for call in self._calls:
            call.reply(False, f"{call.name}: another bicycle was chosen before the answer came")
        self._calls.clear()

    def look(self) -> None:
        """Answer the calls that have ended or take too long."""
        now = time.monotonic()
        self._send_again(now)
        for call in list(self._calls):
            if call.future.done():
                self._calls.remove(call)
                error = call.future.exception()
                result = None if error else call.future.result()
                if result is None:
                    call.reply(False, f"{call.name} failed: {error}")
                elif call.name == topics.FOLLOW_PATH_ACTION.name:
                    call.reply(bool(result.accepted), call.words(result))
                else:
                    call.reply(bool(result.success), call.words(result))
            elif now - call.since > PATIENCE:
                self._calls.remove(call)
                call.future.cancel()
                call.reply(False, f"{call.name} has not answered for {PATIENCE:g} s")

    @singledispatchmethod
    def _do(self, request: Any, reply: Reply) -> None:
        reply(False, f"cannot do {type(request).__name__}")

    @_do.register
    def _(self, request: requests.SendGoal, reply: Reply) -> None:
        self._send([request.point], request.heading, reply)

    @_do.register
    def _(self, request: requests.AddWaypoints, reply: Reply) -> None:
        points = self._live.goals.with_more(request.points)
        if len(points) > requests.MOST_WAYPOINTS:
            reply(False, f"more than {requests.MOST_WAYPOINTS} waypoints: ride to some first")
            return
        self._send(points, None, reply)

    @_do.register
    def _(self, request: requests.ClearGoals, reply: Reply) -> None:
        self._send([], None, reply)

    def _send(self, points: list[Point2D], heading: float | None, reply: Reply) -> None:
        """Order points in place of all previous goals."""
        if not self._goal_rate.take():
            reply(False, "too many goals at once: wait a second")
            return
        if self._node.count_publishers(topics.COMMAND.name) == 0:
            reply(False, "no controller runs: start ros2_ws/controller.sh")
            return
        self._resent, self._sent = 0, (points, heading)
        self._order(points, heading)
        if not points:
            reply(True, "goals cleared")
            return
        (x, y), before = points[-1], len(points) - 1
        plural = "" if before == 1 else "s"
        many = f" by way of {before} point{plural}" if before else ""
        if heading is not None:
            many += f" to arrive at {math.degrees(heading):.0f}°"
        reply(True, f"goal ({x:.1f}, {y:.1f}) sent{many}{self._held_up()}")

    def _order(self, points: list[Point2D], heading: float | None) -> None:
        self._sent_at = time.monotonic()
        self._live.goals.send(points)
        self._orders.send(points, heading)

    def _send_again(self, now: float) -> None:
        """Send goals again that no controller has taken, while the bicycle waits for one."""
        if self._live.goals.is_taken or self._live.mode != "held":
            return
        if self._resent > MOST_RESENT or now - self._sent_at < RESEND or not self._sent[0]:
            return
        self._resent += 1
        if self._resent <= MOST_RESENT:
            self._order(*self._sent)
        else:
            x, y = self._sent[0][-1]
            self._tell(
                "warn",
                f"no controller has taken the goal ({x:.1f}, {y:.1f}), which was sent "
                f"{self._resent} times: see whether it runs, and send the goal again",
            )

    def _held_up(self) -> str:
        """Return why the bicycle does not ride to a goal at once, as the end of a line."""
        ways = []
        if self._live.mode == "fallen":
            ways.append("the bicycle lies, press Reset")
        if self._live.paused:
            ways.append("time is paused, press Go on")
        return f": {'; '.join(ways)}" if ways else ""

    @_do.register
    def _(self, request: requests.Push, reply: Reply) -> None:
        question = PushService.Request(lean_rate=request.lean_rate)
        side = "right" if request.lean_rate > 0 else "left"

        def words(answer: Any) -> str:
            if answer.success:
                wait = f" with the next step{self._held_up()}" if self._live.paused else ""
                return f"pushed to the {side}{wait}"
            if self._live.mode == "fallen":
                return "not pushed: the bicycle lies, press Reset"
            return str(answer.message)

        self._call(topics.PUSH, question, reply, words)

    @_do.register
    def _(self, request: requests.Pause, reply: Reply) -> None:
        def words(answer: Any) -> str:
            live = self._live
            if not answer.success:
                return str(answer.message)
            live.paused = request.paused
            if live.mode == "fallen":
                end = "paused; the bicycle lies, press Reset" if live.paused else "goes on"
                return end if live.paused else f"{end} after a Reset: the bicycle lies"
            live.mode = "paused" if request.paused else "held" if live.at_start else "riding"
            return "paused" if request.paused else "goes on"

        self._call(topics.PAUSE, SetBool.Request(data=request.paused), reply, words)

    @_do.register
    def _(self, request: requests.Step, reply: Reply) -> None:
        def words(answer: Any) -> str:
            if answer.success:
                return "one step made"
            if self._live.mode == "fallen":
                return "no step: the bicycle lies, press Reset"
            return "no step: press Pause first, Step is for a ride that is paused"

        self._call(topics.STEP, Trigger.Request(), reply, words)

    @_do.register
    def _(self, request: requests.Reset, reply: Reply) -> None:
        speed = self._conditions.setup.speed
        question = ResetService.Request(random_start=request.random, speed=speed, seed=-1)
        where = "at a random start" if request.random else "at the origin"
        # A goal that is sent while the bicycle lies is for the next episode.
        sent = self._live.mode == "fallen" and not self._live.goals.is_taken

        def words(answer: Any) -> str:
            if not answer.success:
                return str(answer.message)
            then = ": time is paused, press Go on" if self._live.paused else ""
            if sent:
                return f"the bicycle starts {where} to the goal sent while it lay{then}"
            return f"the bicycle waits {where} for a goal{then}"

        self._call(topics.RESET, question, reply, words)

    @_do.register
    def _(self, request: requests.SwitchController, reply: Reply) -> None:
        try:
            path = self._choices.path(request.name)
        except KeyError:
            reply(False, f"no controller {request.name!r} is offered: reload the page")
            return
        live = self._live

        def words(answer: Any) -> str:
            if not answer.success:
                return str(answer.message)
            policy = str(answer.policy)
            live.names[policy] = request.name
            live.who.put_in_charge(policy)
            why = self.suits.misfit()
            but = f", but it does not suit this ride: {why}" if why else ""
            return f"{label(request.name)} is in charge{but}"

        self._call(topics.LOAD_POLICY, LoadPolicy.Request(path=path), reply, words)

    @_do.register
    def _(self, request: requests.SetUp, reply: Reply) -> None:
        before, ride = self._conditions.setup, self._ride
        chosen = self._live.names.get(self._live.who.chosen, "")
        try:
            setup = before.changed(request.values)
            path = self._choices.path(request.controller) if request.controller else ""
        except KeyError:
            reply(False, f"no controller {request.controller!r} is offered: reload the page")
            return
        except ValueError as error:
            reply(False, str(error))
            return
        words = ride_setup.merged(ride.parameters, setup, before)
        if replace(setup, speed=before.speed) == before:
            ride.keep(words)
            if request.controller not in ("", chosen):
                self._do(requests.SwitchController(request.id, request.controller), reply)
            else:
                self._do(requests.Reset(request.id, random=False), reply)
            return
        if not ride.ours:
            type_ = ride_setup.command(setup, RideSetup())
            reply(False, f"the ride was not started here: end it with stop.sh and type {type_}")
        elif self._recording.state is not None:
            reply(False, "a bag is being recorded: stop the recording first")
        elif not ride.restart(ride_setup.with_policy(words, path)):
            reply(False, "the ride is being started anew already")
        else:
            reply(True, "simulator and controller start anew")

    @_do.register
    def _(self, request: requests.FollowCourse, reply: Reply) -> None:
        if request.name not in courses.names():
            reply(False, f"no course {request.name!r} is offered: reload the page")
        elif not self._course.server_is_ready():
            reply(False, "no controller runs: start ros2_ws/controller.sh")
        elif self._goal_rate.take():
            future = self._course.send_goal_async(FollowPath.Goal(course=request.name))
            name = topics.FOLLOW_PATH_ACTION.name

            def words(handle: Any) -> str:
                if handle.accepted:
                    return f"the course {request.name} is sent{self._held_up()}"
                return f"the course {request.name} was refused: see Events"

            self._calls.append(_Call(future, time.monotonic(), reply, name, words))
        else:
            reply(False, "too many goals at once: wait a second")

    @_do.register
    def _(self, request: requests.Record, reply: Reply) -> None:
        reply(*(self._recording.start() if request.on else self._recording.stop()))

    def _call(self, service: Service, question: Any, reply: Reply, words: Words) -> None:
        """Call a service, which must exist."""
        client = self._clients[service.name]
        if not client.service_is_ready():
            is_policy = service is topics.LOAD_POLICY
            who = "controller" if is_policy else "simulator"
            script = "controller.sh" if is_policy else "sim.sh"
            reply(False, f"no {who} runs: start ros2_ws/{script}")
            return
        future = client.call_async(question)
        self._calls.append(_Call(future, time.monotonic(), reply, service.name, words))
