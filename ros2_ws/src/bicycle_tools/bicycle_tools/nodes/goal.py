"""`goal.sh`: send one goal or a file of them, and follow their progress."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.goal")

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from tqdm import tqdm

from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes.runner import start_tool
from bicycle_common.signals import StopRequest
from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status
from bicycle_tools.course import read_waypoints
from bicycle_tools.nodes.calling import LYING, NOBODY, ToolError
from bicycle_tools.nodes.ride_client import RideClient
from bicycle_tools.plan import Plan

EXIT = {Status.REACHED: 0, Status.FALLEN: LYING, Status.MISSED: 4, Status.GIVEN_UP: 4}
"""Exit status of goal.sh for each end of a goal."""
SETTLE = 0.2
"""Time for older messages of the controller to arrive (s): they are kept for late subscribers."""
ACCEPT = 10.0
"""Longest wait for a controller to appear and to answer (s)."""
GRACE = 0.5
"""Time in which a removed goal may reappear (s): a repeated goal replaces itself."""
REPEAT = 2.0
"""Time without an answer after which the goals are sent again (s)."""
ABSENT = 10.0
"""Time without a state, or without a controller, after which the wait is given up (s); a restart
after a crash takes less."""
LYING_FOR = 1.0
"""Time for the controller to report the goal's end after a fall (s)."""
LIES = "the bicycle lies: reset.sh puts it up again"


class GoalClient:
    """Sends goals to the controller, and can wait for their end."""

    def __init__(
        self, rider: RideClient, goals: list[Point2D], timeout: float, yaw: float | None = None
    ) -> None:
        self.stop = StopRequest().listen()
        self._rider = rider
        self._plan, self._yaw = Plan(goals), yaw
        self._timeout = timeout
        self._taken_away = (math.inf, "")
        self._missing: dict[str, float] = {}

    def send(self) -> None:
        """Send the goals and wait until the controller has accepted them.

        Raises:
            ToolError: if there is no bicycle or no controller, the bicycle lies, or the
                controller does not answer or rejects the goals.
        """
        patience = min(self._timeout, ACCEPT)
        self._look(patience)
        self._spin_until(lambda: False, SETTLE)
        self._rider.changes.clear()
        deadline = time.monotonic() + patience
        while not self.stop.requested:
            self._rider.send(self._plan.goals, self._yaw)
            if self._spin_until(self._heard, min(REPEAT, deadline - time.monotonic())):
                if self._rider.state is not None and self._rider.state.fallen:
                    raise ToolError(LYING, f"{LIES}; the goal waits until then")
                return
            if time.monotonic() >= deadline:
                raise ToolError(
                    NOBODY, f"the controller did not answer within {patience:g} s: see its log"
                )
        raise ToolError(130, "interrupted; the goal may have been sent")

    def _look(self, patience: float) -> None:
        """Wait until a bicycle and a controller are present.

        Raises:
            ToolError: if they are not, or the bicycle lies.
        """
        rider = self._rider
        there = self._spin_until(
            lambda: rider.state is not None and (rider.state.fallen or rider.controller_listens()),
            patience,
        )
        if self.stop.requested:
            raise ToolError(130, "interrupted; no goal was sent")
        if rider.state is not None and rider.state.fallen:
            raise ToolError(LYING, f"{LIES}; no goal was sent")
        if there:
            return
        missing = [] if rider.state is not None else ["no simulator (start sim.sh)"]
        missing += [] if rider.controller_listens() else ["no controller (start controller.sh)"]
        raise ToolError(NOBODY, f"{' and '.join(missing)} within {patience:g} s")

    def wait(self) -> int:
        """Wait for the end of every goal with a progress bar.

        Returns:
            The exit status of the worst one.

        Raises:
            ToolError: if a goal takes too long, the bicycle lies, somebody else removes it,
                or simulator or controller are gone.
        """
        worst = 0
        with tqdm(total=len(self._plan.goals), disable=None, bar_format="{desc} {elapsed}") as bar:
            deadline = time.monotonic() + self._timeout
            while True:
                self._rider.spin()
                bar.set_description_str(f"goal {self._plan.number}: {self._progress()}")
                for status, text in self._ends():
                    tqdm.write(text)
                    worst = max(worst, EXIT[status])
                    deadline = time.monotonic() + self._timeout
                if self._plan.finished:
                    return worst
                if self.stop.requested:
                    raise ToolError(130, f"interrupted; {self._rider.condition()}")
                self._check()
                if time.monotonic() > deadline:
                    raise ToolError(
                        4, f"not reached within {self._timeout:g} s; {self._rider.condition()}"
                    )

    def _check(self) -> None:
        """Check that the wait still makes sense.

        Raises:
            ToolError: if it does not.
        """
        rider = self._rider
        fallen = rider.state is not None and rider.state.fallen
        if self._lasts("lying", fallen, LYING_FOR):
            raise ToolError(LYING, LIES)
        if self._lasts("simulator", rider.silence() > 1.0, ABSENT):
            raise ToolError(NOBODY, f"no state for {rider.silence():.0f} s: start sim.sh")
        if self._lasts("controller", not rider.controller_listens(), ABSENT):
            raise ToolError(NOBODY, f"no controller for {ABSENT:g} s: start controller.sh")

    def _lasts(self, what: str, holds: bool, seconds: float) -> bool:
        """Return True if a condition has held for so long."""
        now = time.monotonic()
        if not holds:
            self._missing.pop(what, None)
            return False
        return now - self._missing.setdefault(what, now) > seconds

    def _progress(self) -> str:
        return self._rider.progress_text()

    def _heard(self) -> bool:
        """Return True if the controller has answered the first goal.

        Raises:
            ToolError: if it rejected the goal.
        """
        for change in self._rider.changes:
            # The controller's last answers to others may still arrive: they are kept for late
            # subscribers.
            if (change.position.x, change.position.y) not in self._plan.goals:
                continue
            if change.status == Status.REJECTED:
                raise ToolError(2, f"goal rejected: {change.message}")
            return True
        return False

    def _ends(self) -> list[tuple[Status, str]]:
        """Return the goals that have ended since the last call.

        Raises:
            ToolError: if the goals were removed.
        """
        ends: list[tuple[Status, str]] = []
        while self._rider.changes:
            change = self._rider.changes.popleft()
            position = (change.position.x, change.position.y)
            status = Status(change.status)
            if self._plan.finished or position != self._plan.remaining[0]:
                continue
            self._taken_away = (math.inf, "")
            if status in (Status.REPLACED, Status.CANCELLED):
                text = f"goal {self._plan.number} {status.name.lower()}: {change.message}"
                self._taken_away = (time.monotonic() + GRACE, text)
            elif (number := self._plan.take(position, status)) is not None:
                name = f"goal {number} at ({position[0]:g}, {position[1]:g})"
                ends.append((status, f"{name}: {change.message}"))
            if status is Status.FALLEN:
                self._plan.goals = self._plan.goals[: len(self._plan.results)]
        if time.monotonic() > self._taken_away[0]:
            raise ToolError(4, self._taken_away[1])
        return ends

    def _spin_until(self, condition: Callable[[], bool], seconds: float) -> bool:
        deadline = time.monotonic() + seconds
        while not condition():
            if self.stop.requested or time.monotonic() > deadline:
                return False
            self._rider.spin()
        return True


def parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="goal.sh", add_help=False)
    add = parser.add_argument
    add("x", type=float, nargs="?")
    add("y", type=float, nargs="?")
    add("--file", type=Path)
    add("--yaw", type=float)
    add("--wait", action="store_true")
    add("--timeout", type=float)
    # A negative coordinate is a number, not an option: argparse knows that by itself.
    given, ros = parser.parse_with_ros(arguments)
    if given.timeout is None:
        given.timeout = 300.0 if given.wait else 10.0
    if not (math.isfinite(given.timeout) and given.timeout > 0):
        parser.error(f"--timeout is {given.timeout}: choose a positive number of seconds")
    if given.file is not None:
        if given.x is not None:
            parser.error("give X Y or --file, not both")
        if given.yaw is not None:
            parser.error("--yaw goes with X Y: a file has no directions of arrival")
        try:
            given.goals = read_waypoints(given.file)
        except ValueError as error:
            parser.error(str(error))
        return given, ros
    if given.y is None:
        parser.error("give X and Y in metres, or --file")
    if given.yaw is not None and not math.isfinite(given.yaw):
        parser.error(f"--yaw is {given.yaw}: give degrees")
    if not (math.isfinite(given.x) and math.isfinite(given.y)):
        parser.error(f"({given.x}, {given.y}) is not finite: give metres")
    given.goals = [(given.x, given.y)]
    return given, ros


def main() -> int:
    """Send the goals of the command line; return the exit status."""
    given, ros = parse(sys.argv[1:])
    start_tool("goal.sh", ros)
    rider = RideClient("bicycle_goal")
    yaw = None if given.yaw is None else math.radians(given.yaw)
    client = GoalClient(rider, given.goals, given.timeout, yaw)
    try:
        client.send()
        if given.wait:
            return client.wait()
        count = len(given.goals)
        print("accepted" if count == 1 else f"{count} goals accepted")
        return 0
    except ToolError as error:
        print(f"goal.sh: {error}", file=sys.stderr)
        return error.status
    finally:
        rider.close()
        rclpy.try_shutdown()
