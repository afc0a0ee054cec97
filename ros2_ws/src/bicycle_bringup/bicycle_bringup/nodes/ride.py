"""`ride.sh`: three processes, a series of goals, and the summary of the bag.

The ride owns its processes: it starts them, watches them, restarts a dead controller, and stops
them in an order that keeps the bag complete.
"""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_bringup.nodes.ride")

import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from bicycle_msgs.msg import GoalStatus, PathStatus

from bicycle_bag.errors import BagError
from bicycle_bringup.display import Display
from bicycle_bringup.ride_options import RideOptions, parse
from bicycle_common.node_commands import workspace
from bicycle_common.nodes.runner import start_tool
from bicycle_common.processes import ProcessGroup, SaveWait, Supervisor, registry_of
from bicycle_common.signals import StopRequest
from bicycle_controller.control.goals import Status
from bicycle_tools.nodes.ride_client import RECORDER, RideClient
from bicycle_tools.nodes.verify_estimates import verify_bag
from bicycle_tools.plan import Plan
from bicycle_tools.ride_report import report
from bicycle_tools.summary import RideSummary

DISCOVERY = 0.5
"""Time to discover nodes of this machine (s)."""
GHOSTS = 4.0
"""Time for nodes that are ending to disappear from the list of nodes (s)."""
READY_TIMEOUT = 30.0
"""Longest start of a node (s)."""
STALL = 20.0
"""Time without a step after which a ride is given up (s)."""
START = 90.0
"""The same before the first step (s): a controller designs for its bicycle for two seconds, of
which a busy machine makes many."""
ECHO = 2.0
"""Time for a controller to confirm a goal before it is sent again (s)."""
LIE_DOWN = 0.5
"""Time for which a fallen bicycle lies before the reset (s), so that the bag shows it."""
MATCHED = 2.0
"""Longest time for the simulator to hear of the recorder (s)."""
TOLD = 10.0
"""Longest wait for the controller's diagnostics (s), which come once a second."""
STOPPED_LAST = ("simulator", "driver", "controller", "recorder")
"""Processes in the order in which they are stopped."""


def longest_wait(step: int) -> float:
    """Return the time without a step (s) after which a ride is given up, after `step` steps."""
    return STALL if step > 0 else START


class RideError(Exception):
    """Why a ride cannot continue; its text is one line with the remedy."""


class Ride:
    """One ride, from the first process to the last.

    Attributes:
        events: lines about what happened to processes.
        stop: set by SIGINT, SIGTERM or SIGHUP.
        begun: True once goals have been sent.
    """

    def __init__(self, options: RideOptions, rider: RideClient) -> None:
        self.events: list[str] = []
        self.stop = StopRequest().listen()
        self.begun = False
        self._options = options
        self._rider = rider
        commands = {name: options.command(name) for name in options.modules}
        # A unique name, because there may be other recorders, and killed ones.
        self._recorder = f"{RECORDER}_{os.getpid()}"
        commands["recorder"] += ["--ros-args", "-r", f"__node:={self._recorder}"]
        saves = {"recorder": str(options.folder / "bag")}
        self._crew = ProcessGroup(commands, options.folder, registry_of(workspace()), saves, True)
        self._supervisor = Supervisor(self._crew)
        self._plan = Plan(options.draw_goals())
        self._warned = 0
        self._last_step = (0, 0)
        self._stepped = time.monotonic()
        self._sent = math.inf
        self._fell: float | None = None
        # Draw one at a time if their number is unknown.
        self._batch = 1 if options.minutes else options.goals
        goals = 0 if options.minutes else 1 if options.course else options.goals
        self._display = Display(goals, 60.0 * options.minutes)

    def run(self) -> None:
        """Start everything and ride until the goals are decided or the time is over.

        Raises:
            RideError: if a process dies that cannot be replaced, or the bicycle stands still.
        """
        self._look_around()
        # A microcontroller begins when its driver listens: by then all else must be recorded.
        begun = [name for name in self._options.modules if name != "driver"]
        self._crew.start(*begun)
        self._wait("simulator", lambda: self._rider.state is not None)
        self._wait("controller", self._rider.controller_listens)
        self._wait("recorder", lambda: self._rider.recorder_listens(self._recorder))
        self._let_match()
        if self._options.bench:
            self._crew.start("driver")
        self._order()
        self.begun = True
        self._stepped = time.monotonic()
        while not (self.stop.requested or self._over()):
            self._rider.spin()
            self._check_processes()
            self._take_changes()
            self._take_warnings()
            self._check_bicycle()
            self._take_path()
            self._show()
        self._hear_out()

    def close(self) -> list[str]:
        """Stop the processes: the recorder last, so that it records the others' last messages.

        Returns:
            A line about each that did not end well.
        """
        self._display.close()
        save_wait = SaveWait(_tell, lambda: self.stop.interrupts)
        last = [name for name in STOPPED_LAST if name in self._options.modules]
        return self._crew.stop(*last, save_wait=save_wait)

    @property
    def recording(self) -> bool:
        """True if the recorder is still writing on its own."""
        return self._crew.left

    def all_reached(self, summary: RideSummary) -> bool:
        """Return True if all requested goals were reached.

        The ride counts the statuses that it received: the bag may lack one of a killed controller.
        """
        if self._options.course:
            path = self._rider.path
            return path is not None and path.status == PathStatus.FINISHED
        if self._options.minutes:
            return self._over() and summary.missed == summary.given_up == 0 < summary.reached
        return self._plan.finished and set(self._plan.results) == {Status.REACHED}

    def _over(self) -> bool:
        if self._options.course:
            path = self._rider.path
            return path is not None and path.status != PathStatus.ACTIVE
        if self._options.minutes:
            return self._rider.time >= 60.0 * self._options.minutes
        return self._plan.finished

    def _order(self) -> None:
        """Send the goals, or the course."""
        if not self._options.course:
            self._send()
            return
        options = self._options
        self._wait(
            "controller's action",
            lambda: self._rider.follow(options.course, options.laps, options.speed),
        )

    def _let_match(self) -> None:
        """Let the simulator find the recorder, too: wait for two more states, MATCHED s at most.

        Each process hears of the others on its own, so a bag could lack the first state.
        """
        until, enough = time.monotonic() + MATCHED, self._rider.states_heard + 2
        while self._rider.states_heard < enough and time.monotonic() < until:
            self._rider.spin()

    def _take_path(self) -> None:
        """Say how the course ended."""
        path = self._rider.path
        if self._options.course and path is not None and path.status != PathStatus.ACTIVE:
            self._display.say(f"course {self._options.course}: {path.message}")

    def _look_around(self) -> None:
        """Refuse to start if somebody else rides.

        Raises:
            RideError: if somebody does; nodes that are ending have some seconds to do so.
        """
        self._display.waiting("others to show themselves")
        began = time.monotonic()
        while not self.stop.requested:
            self._rider.spin()
            waited = time.monotonic() - began
            others = self._rider.others()
            if waited > DISCOVERY and not others:
                return
            if waited > GHOSTS:
                domain = os.environ.get("ROS_DOMAIN_ID", 0)
                raise RideError(
                    f"ROS_DOMAIN_ID={domain} is taken by {', '.join(others)}: stop.sh ends what "
                    "this workspace runs, or choose another ROS_DOMAIN_ID"
                )

    def _wait(self, name: str, ready: Callable[[], bool]) -> None:
        """Wait until a node is ready.

        Raises:
            RideError: if it is not ready in time, or ends.
        """
        self._display.waiting(f"the {name}")
        deadline = time.monotonic() + READY_TIMEOUT
        while not (ready() or self.stop.requested):
            self._rider.spin()
            for ended in self._crew.ended():
                last = self._crew.log_tail(ended.name)
                raise RideError(f"{ended} while starting: {last}")
            if time.monotonic() > deadline:
                last = self._crew.log_tail(name)
                raise RideError(f"{name} is not ready after {READY_TIMEOUT:g} s: {last}")

    def _send(self) -> None:
        """Send the next goals."""
        goals = self._plan.remaining[: self._batch]
        if goals:
            self._rider.send(goals)
            self._sent = time.monotonic()

    def _take_changes(self) -> None:
        """Process the goals' changes."""
        while self._rider.changes:
            change = self._rider.changes.popleft()
            position = (change.position.x, change.position.y)
            if not self._plan.finished and position == self._plan.remaining[0]:
                if change.status == GoalStatus.REJECTED:
                    self._note_once(f"the goals are sent again, for {change.message}")
                    continue
                # Once one is over, the next must be confirmed: a controller that took up a dead
                # one's goal knows no other, and another node's goal replaces all of them.
                pursued = change.status in (GoalStatus.QUEUED, GoalStatus.ACTIVE)
                self._sent = math.inf if pursued else time.monotonic()
            number = self._plan.take(position, Status(change.status))
            if number is None:
                continue
            self._supervisor.forgive()
            self._display.say(
                f"goal {number} at ({position[0]:.1f}, {position[1]:.1f}): {change.message}"
            )
            if self._batch == 1:
                self._send()
        if time.monotonic() - self._sent > ECHO:
            self._send()

    def _hear_out(self) -> None:
        """Wait for the controller's diagnostics: a short ride may end before the first."""
        deadline = time.monotonic() + TOLD
        while not self.stop.requested and not self._rider.policy_judged:
            if time.monotonic() > deadline:
                break
            self._rider.spin()
        self._take_warnings()

    def _take_warnings(self) -> None:
        """Keep the controller's warnings for the summary."""
        for line in self._rider.warnings[self._warned :]:
            self._warned += 1
            self._note(line)

    def _check_processes(self) -> None:
        """Restart a dead controller; any other death ends the ride.

        Raises:
            RideError: in that case.
        """
        while (ended := self._supervisor.death()) is not None:
            respawn = ended.name == "controller" and self._options.respawn
            if not (respawn and self._supervisor.retry(ended.name)):
                last = self._crew.log_tail(ended.name)
                raise RideError(f"{ended} at t = {self._rider.time:.1f} s: {last}")
            self._rider.controller_died()
            self._note(f"{ended} at t = {self._rider.time:.1f} s")
            while not self._supervisor.restarted():
                self._rider.spin()
                if self.stop.requested:
                    return
            self._wait("controller", self._rider.controller_listens)
            self._note(f"controller started again, ready at t = {self._rider.time:.1f} s")
            self._stepped = time.monotonic()
            self._rider.changes.clear()
            self._send()

    def _check_bicycle(self) -> None:
        """Reset a fallen bicycle, and detect one that stands still.

        Raises:
            RideError: if it stands still for long, or cannot be reset.
        """
        state, now = self._rider.state, time.monotonic()
        if state is None:
            return
        if (state.episode, state.step) != self._last_step:
            self._last_step = (state.episode, state.step)
            self._stepped = now
        if not state.fallen:
            self._fell = None
        elif self._fell is None:
            self._fell = now
            self._display.say(f"fell at t = {self._rider.time:.1f} s")
        elif now - self._fell > LIE_DOWN and not self._plan.finished:
            self._fell = None
            if not self._rider.reset():
                last = self._crew.log_tail("simulator")
                raise RideError(f"the simulator does not reset: {last}")
            self._send()
        longest = longest_wait(state.step)
        if now - self._stepped > longest:
            last = self._crew.log_tail("controller")
            raise RideError(f"no step for {longest:g} s: is the bicycle paused? {last}")

    def _show(self) -> None:
        """Update the progress bar."""
        done = self._rider.time if self._options.minutes else len(self._plan.results)
        if self._options.course:
            path = self._rider.path
            if path is not None and path.length:
                text = f"{path.along:.0f} of {path.length:.0f} m, {path.cross_track:+.2f} m beside"
                self._display.show(1, path.along / path.length, text)
            return
        self._display.show(self._plan.number, done, self._rider.progress_text())

    def _note_once(self, line: str) -> None:
        """Keep a line for the summary that it lacks."""
        if line not in self.events:
            self._note(line)

    def _note(self, line: str) -> None:
        """Keep a line for the summary."""
        self.events.append(line)
        self._display.say(line)


def ride(options: RideOptions) -> int:
    """Ride and sum up; return the exit status."""
    start_tool("ride.sh")
    rider = RideClient("bicycle_ride")
    one = Ride(options, rider)
    failures = []
    try:
        one.run()
    except RideError as error:
        failures.append(str(error))
    finally:
        failures += one.close()
        rider.close()
        rclpy.try_shutdown()
    for failure in failures:
        one.events.append(failure)
        _tell(failure)
    return _sum_up(options, one, failed=bool(failures))


def _verified(bag: Path) -> bool:
    """Print the verdict on the bag's estimates and commands; return True if all are the same."""
    try:
        verdict = verify_bag(bag)
    except BagError as error:
        _tell(str(error))
        return False
    print(f"  {verdict}")
    return verdict.same


def _tell(line: str) -> None:
    """Print one line for the user, beside the summary."""
    print(f"ride.sh: {line}", file=sys.stderr, flush=True)


def _sum_up(options: RideOptions, one: Ride, failed: bool) -> int:
    """Print the summary of the bag; return the exit status."""
    if one.recording:
        print(f"ride.sh: for the summary: report.sh {options.folder} when it has ended")
        return 130
    if failed and not one.begun:
        return 1
    if one.stop.requested and not (options.folder / "bag").exists():
        _tell("ended before anything was recorded")
        return 130
    try:
        summary, text = report(options.folder / "bag", options.folder, one.events)
    except BagError as error:
        print(f"ride.sh: {error}", file=sys.stderr)
        return 130 if one.stop.requested else 1
    print(f"\n{text}\n\n  {options.folder}: bag, ride.png, summary.json, logs")
    if failed or (options.bench and not _verified(options.folder / "bag")):
        return 1
    if one.stop.requested:
        return 130
    if summary.falls:
        return 3
    return 0 if one.all_reached(summary) else 4


def main() -> None:
    """Ride according to the command line."""
    sys.exit(ride(parse(sys.argv[1:], workspace())))
