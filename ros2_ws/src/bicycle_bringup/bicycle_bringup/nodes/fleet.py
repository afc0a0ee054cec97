"""`fleet.sh`: several bicycles in one domain, each with its namespace, ride routes that cross."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_bringup.nodes.fleet")

import argparse
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from bicycle_msgs.msg import BicycleState, LoopTiming
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool

from bicycle_bringup import fleet_report
from bicycle_bringup.fleet_report import FleetMember
from bicycle_bringup.fleet_routes import Route, routes
from bicycle_common.command_line import OneLineParser
from bicycle_common.node_commands import (
    checked_parameter,
    config_folder,
    node_command,
    workspace,
)
from bicycle_common.nodes import topics
from bicycle_common.nodes.topics import listen
from bicycle_common.processes import ProcessGroup, registry_of
from bicycle_common.signals import StopRequest
from bicycle_controller.control.keep_clear import UNHEARD
from bicycle_tools.nodes.commander import BicycleCommander, CommanderError

MOST = 20
"""Largest number of bicycles."""
READY = 90.0
"""Longest start of all nodes (s)."""
SUITED = ("simulator.scenario:=learned-speed", "controller.policy:=lqr-pedal")
"""Default parameters of a fleet."""
NODES = ("simulator", "controller")
"""Nodes of each bicycle."""


class FleetError(Exception):
    """Reason why a fleet cannot ride; one line with the remedy."""


class Watch:
    """Listens to one bicycle."""

    def __init__(self, route: Route, context: Context) -> None:
        self.route, self.rider = route, FleetMember(route.name)
        self.state: BicycleState | None = None
        self.counts = False
        self.node = Node("bicycle_fleet", namespace=f"/{route.name}", context=context)
        listen(self.node, topics.STATE, self._on_state)
        listen(self.node, topics.TIMING, self._on_timing)

    def _on_state(self, message: BicycleState, info: dict[str, int]) -> None:
        self.state = message
        if self.counts:
            place = message.rear_contact
            sent = 1e-9 * info["source_timestamp"]
            self.rider.track.append((sent, float(place.x), float(place.y)))

    def _on_timing(self, message: LoopTiming) -> None:
        rider = self.rider
        if self.counts:
            rider.lateness.append(float(message.lateness))
            rider.latency.append(float(message.latency))
            rider.late, rider.dropped = int(message.late_steps), int(message.dropped_steps)


class Fleet:
    """All bicycles of one ride, their processes and their orders."""

    def __init__(self, given: argparse.Namespace) -> None:
        """Prepare the processes."""
        self._given = given
        self.stop = StopRequest().listen()
        self._routes = routes(given.bicycles, given.seed, given.speed)
        self._folder: Path = given.output
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._watches = [Watch(route, self._context) for route in self._routes]
        for watch in self._watches:
            self._executor.add_node(watch.node)
        self._unheard: dict[str, str] = {}
        listen(self._watches[0].node, topics.DIAGNOSTICS, self._on_diagnostics)
        self._orders: dict[str, BicycleCommander] = {}
        self._crew = ProcessGroup(self._commands(), self._folder, registry_of(workspace()))

    def _commands(self) -> dict[str, list[str]]:
        names = [route.name for route in self._routes]
        found = {}
        for route in self._routes:
            others = ",".join(name for name in names if name != route.name)
            own = {
                "simulator": {
                    "start_x": f"{route.x:.4f}",
                    "start_y": f"{route.y:.4f}",
                    "start_yaw": f"{route.yaw:.6f}",
                    "start_speed": f"{self._given.speed:.3f}",
                    "publish_clock": "true" if route.name == names[0] else "false",
                    "marker_rate": "0.0",
                },
                "controller": {} if self._given.blind else {"keep_clear": others},
            }
            for node, settings in own.items():
                values = [f"{node}.{key}:={value}" for key, value in settings.items()]
                words = [*SUITED, *values, *self._given.parameters]
                command = node_command(node, config_folder(), words)
                found[f"{route.name}-{node}"] = [*command, "-r", f"__ns:=/{route.name}"]
        return found

    def ride(self) -> None:
        """Start all, order the routes and wait for their ends.

        Raises:
            FleetError: if a node does not start or ends, or an order is not taken.
        """
        folder = self._folder / "routes"
        folder.mkdir()
        files = [route.write(folder).resolve() for route in self._routes]
        self._crew.start()
        self._wait(lambda: all(watch.state is not None for watch in self._watches), "a state")
        # On a busy machine the nodes of one bicycle are ready long before those of another.
        self._pause(True)
        self._wait(self._hear_each_other, "each controller's word that it hears the others")
        for watch, file in zip(self._watches, files, strict=True):
            name = watch.route.name
            try:
                self._orders[name] = BicycleCommander(f"/{name}", self._context)
                self._orders[name].follow_course(str(file))
            except CommanderError as error:
                raise FleetError(f"{name}: {error}") from None
        self._pause(False)
        for watch in self._watches:
            watch.counts = True
        self._wait(self._over, "the end of all routes", math.inf)

    def _pause(self, paused: bool) -> None:
        """Pause all bicycles, or let them go on."""
        clients = [
            watch.node.create_client(topics.PAUSE.type, topics.PAUSE.name)
            for watch in self._watches
        ]
        self._wait(lambda: all(one.service_is_ready() for one in clients), topics.PAUSE.name)
        answers = [one.call_async(SetBool.Request(data=paused)) for one in clients]
        self._wait(lambda: all(one.done() for one in answers), topics.PAUSE.name)
        for watch, client in zip(self._watches, clients, strict=True):
            watch.node.destroy_client(client)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            namespace = status.name.partition("/")[0]
            for item in status.values:
                if item.key == UNHEARD:
                    self._unheard[namespace] = item.value

    def _hear_each_other(self) -> bool:
        """Return True if every controller hears all bicycles that it shall keep clear of."""
        words = [self._unheard.get(watch.route.name) for watch in self._watches]
        return all(word == "none" for word in words)

    def _over(self) -> bool:
        """Return True when every order has ended."""
        ended = [order.done for order in self._orders.values()]  # asks each
        return all(ended)

    def _wait(self, ready: Callable[[], bool], what: str, patience: float = READY) -> None:
        deadline = time.monotonic() + patience
        while not (ready() or self.stop.requested):
            for _ in range(4 * len(self._watches)):
                self._executor.spin_once(timeout_sec=0.0)
            self._executor.spin_once(timeout_sec=0.02)
            for ended in self._crew.ended():
                raise FleetError(f"{ended}: {self._crew.log_tail(ended.name)}")
            if time.monotonic() > deadline:
                raise FleetError(
                    f"{what} did not come within {patience:g} s: see {self._folder}/*.log"
                )

    def close(self) -> list[FleetMember]:
        """Stop all; return what each bicycle did."""
        for watch in self._watches:
            order = self._orders.get(watch.route.name)
            if order is not None and order.done:
                try:
                    outcome = order.wait(timeout=1.0)
                except CommanderError:
                    continue
                rider = watch.rider
                rider.outcome, rider.finished = outcome.message, outcome.reached
                rider.rms, rider.largest = outcome.result.rms, outcome.result.largest
        for order in self._orders.values():
            order.close()
        names = [route.name for route in self._routes]
        order_of = [f"{name}-{node}" for node in NODES for name in names]
        for line in self._crew.stop(*order_of):
            _tell(line)
        self._executor.shutdown()
        for watch in self._watches:
            watch.node.destroy_node()
        self._context.try_shutdown()
        return [watch.rider for watch in self._watches]


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="fleet.sh", add_help=False, allow_abbrev=False)
    add = parser.add_argument
    add("bicycles", type=int, nargs="?", default=10)
    add("--seed", type=int, default=0)
    add("--speed", type=float, default=3.0)
    add("--blind", action="store_true")
    add("--output", type=Path)
    known = [word for word in arguments if ":=" not in word]
    given = parser.parse_args(known)
    if not 1 <= given.bicycles <= MOST:
        parser.error(f"{given.bicycles} bicycles: choose 1 to {MOST}")
    if not 2.0 <= given.speed <= 5.0:
        parser.error(f"--speed is {given.speed:g}: choose 2 to 5 m/s")
    if given.seed < 0:
        parser.error(f"--seed is {given.seed}: choose zero or more")
    try:
        given.parameters = [checked_parameter(word) for word in arguments if ":=" in word]
    except ValueError as error:
        parser.error(str(error))
    if given.output is None:
        given.output = workspace() / "runs" / time.strftime("fleet-%Y-%m-%d-%H%M%S")
    try:
        given.output.mkdir(parents=True)
    except OSError as error:
        parser.error(f"cannot make {given.output}: {error.strerror}; choose another --output")
    return given


def main() -> int:
    """Ride with a fleet; return the exit status."""
    given = parse(sys.argv[1:])
    fleet = Fleet(given)
    failure = ""
    try:
        fleet.ride()
    except FleetError as error:
        failure = str(error)
    finally:
        riders = fleet.close()
    found = fleet_report.facts(riders)
    (given.output / "fleet.json").write_text(json.dumps(found, indent=2) + "\n")
    print(fleet_report.as_text(found))
    print(f"in {given.output}: fleet.json, routes, the nodes' logs")
    if failure:
        _tell(failure)
        return 1
    if fleet.stop.requested:
        return 130
    return 0 if found["finished"] == len(riders) else 4


def _tell(line: str) -> None:
    print(f"fleet.sh: {line}", file=sys.stderr, flush=True)
