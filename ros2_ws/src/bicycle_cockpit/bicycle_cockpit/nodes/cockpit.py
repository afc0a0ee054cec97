"""`cockpit.sh`: simulator and controller as child processes, the cockpit's node in this one."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_cockpit.nodes.cockpit")

import os
import sys
import threading
import time
from pathlib import Path

from bicycle_cockpit.nodes.cockpit_node import NAME, CockpitNode
from bicycle_cockpit.nodes.recording import RecorderProcess
from bicycle_cockpit.options import NAMESPACE, RIDE, CockpitOptions, parse
from bicycle_cockpit.trouble import Line
from bicycle_common.node_commands import config_folder, node_command, workspace
from bicycle_common.nodes.runner import UserError, run
from bicycle_common.processes import ProcessGroup, SaveWait, Supervisor, registry_of
from bicycle_common.signals import StopRequest

MISUSED = 2
"""Exit status of a process that was started with invalid settings."""
READY = 20.0
"""Time after which the address is printed although the bicycle is not ready (s)."""
NICENESS = 5
"""Niceness of the web server, below simulator and controller."""


class StartedRide:
    """Processes that the cockpit started, and their state."""

    def __init__(self, options: CockpitOptions, logs: Path) -> None:
        """Start the processes, if they are requested."""
        self._logs = logs
        self._words = options.parameters
        self._namespace = options.namespace
        self._good: tuple[str, ...] | None = None
        """Parameters to return to if a page's parameters do not run."""
        self._ending: threading.Thread | None = None
        self._crew: ProcessGroup | None = None
        if options.ride:
            self._begin(self._words)

    @property
    def ours(self) -> bool:
        """True if the cockpit started simulator and controller."""
        return self._crew is not None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the `NODE.name:=value` of the ride that goes on or is about to begin."""
        return self._words

    def _begin(self, words: tuple[str, ...]) -> None:
        rule = ["-r", f"{NAMESPACE}{self._namespace}"] if self._namespace != "/" else []
        commands = {name: [*node_command(name, config_folder(), words), *rule] for name in RIDE}
        crew = ProcessGroup(commands, self._logs, registry_of(workspace()), early=True)
        self._crew, self._words = crew, words
        self._supervisor = Supervisor(crew)
        crew.start()

    def restart(self, words: tuple[str, ...]) -> bool:
        """Begin to start the ride again with other parameters; False while it is ending."""
        crew = self._crew
        if crew is None or self._ending is not None:
            return False
        self._good, self._words = self._words, words
        # The loop goes on meanwhile.
        self._ending = threading.Thread(target=crew.stop, args=RIDE, daemon=True, name="ending")
        self._ending.start()
        return True

    def keep(self, words: tuple[str, ...]) -> None:
        """Use other parameters from the next start on."""
        self._words = words

    def look(self) -> Line | None:
        """Restart dead processes; return a line if something happened.

        Raises:
            UserError: if a process cannot run as it was started, or has died too often.
        """
        crew = self._crew
        if crew is None:
            return None
        if self._ending is not None:
            if self._ending.is_alive():
                return None
            self._ending = None
            self._begin(self._words)
            return Line("info", "simulator and controller were started anew")
        if (name := self._supervisor.restarted()) is not None:
            return Line("info", f"{name} started again", name)
        ended = self._supervisor.death()
        if ended is None:
            return None
        words = f"{ended}: {crew.log_tail(ended.name)}"
        if ended.status == MISUSED and self._good is not None:
            self.restart(self._good)
            self._good = None
            last = crew.log_tail(ended.name).partition(" (log: ")[0]
            return Line("bad", f"this ride cannot be set up, the one before comes back: {last}")
        if ended.status == MISUSED or not self._supervisor.retry(ended.name):
            raise UserError(words)
        # A killed process has left no message.
        death = str(ended) if ended.status < 0 else f"{ended}, {crew.log_tail(ended.name)}"
        return Line("bad", words, ended.name, death)

    def close(self) -> list[str]:
        """Stop the processes, the simulator first: it would complain without the controller.

        Returns:
            A line about each that did not end well.
        """
        if self._ending is not None:
            self._ending.join()
        return [] if self._crew is None else self._crew.stop(*RIDE)


class Announced:
    """Prints the address once, when the bicycle can be ridden."""

    def __init__(self, ride: StartedRide, options: CockpitOptions) -> None:
        self._ride, self._options = ride, options
        self._begun = time.monotonic()
        self._told = False
        self.node: CockpitNode | None = None

    def tick(self) -> Line | None:
        """Check the processes; see `Ride.look`."""
        node = self.node
        if node is not None and not self._told:
            ready = node.shown.live.hears_simulator and node.shown.controllers > 0
            if ready or not self._options.ride or time.monotonic() - self._begun > READY:
                self._told = True
                address = self._options.url(node.server.port)
                print(f"cockpit: {address}    (Ctrl-C ends it)", flush=True)
        return self._ride.look()


def main() -> int:
    """Run the cockpit until SIGINT or SIGTERM; return the exit status."""
    options = parse(sys.argv[1:], workspace())
    logs = workspace() / "log" / "cockpit" / os.environ.get("ROS_DOMAIN_ID", "0")
    try:
        logs.mkdir(parents=True, exist_ok=True)
        for old in logs.glob("*.log"):
            old.unlink()
        ride = StartedRide(options, logs)
    except (OSError, ValueError) as error:
        print(f"cockpit.sh: {error}", file=sys.stderr)
        return 2
    os.nice(NICENESS)
    announced = Announced(ride, options)
    recording = RecorderProcess(options.bags, logs)

    def make() -> CockpitNode:
        announced.node = CockpitNode(options, recording, ride, announced.tick)
        return announced.node

    try:
        status = run("cockpit.sh", make, args=[NAME, *options.ros])
    finally:
        failures = _end(ride, recording)
    return status or bool(failures)


def _end(ride: StartedRide, recording: RecorderProcess) -> list[str]:
    """Stop the processes, the recorder last, so that it records the others' last messages.

    Returns:
        A line, already reported, about each process that did not end well.
    """
    stop = StopRequest().listen()
    failures = ride.close()
    recording.close(SaveWait(_tell, lambda: stop.interrupts))
    failures += recording.failures
    for failure in failures:
        _tell(failure)
    return failures


def _tell(line: str) -> None:
    print(f"cockpit.sh: {line}", file=sys.stderr, flush=True)
