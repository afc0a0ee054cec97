"""Ride from goal to goal for hours: does memory grow, does time drift, is a step lost?

Simulator, controller, recorder and, unless told otherwise, a cockpit with one open page run as
processes, in real time or in lock-step as fast as they go. Memory, open files and threads of each
are read again and again. At the end every step is looked up in the bag, and the last ones, as many
as wanted, are computed again from the recorded commands, to the bit.

    python tests/tools/soak.py [--hours 1] [--pace realtime] [--seed 1] [--out FILE]
    python tests/tools/soak.py --hours 24 --pace lockstep     hours of the bicycle's time

The bag, some 32 MB for an hour of the bicycle's time, lies in a temporary folder of --folder and
is deleted. Ctrl-C ends the ride early with what was found until then.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from bicycle_msgs.msg import BicycleState
from domains import claimed_domain
from node_process import NodeProcess
from probe import Probe, goal
from soak_figures import bag_figures, growth
from tqdm import tqdm

from bicycle_common.nodes.topics import (
    COMMAND,
    COMMAND_ECHO,
    EPISODE,
    GOAL_POSE,
    GOAL_STATUS,
    STATE,
    TIMING,
)
from bicycle_controller.training.run_folder import origin
from bicycle_sim.plants.choi.parameters import Constants

DT = Constants().time_step
SAMPLES = 200
"""Number of memory readings in a whole run."""
LOOK = 0.05
"""s between two looks at the bicycle in lock-step: to hear every state would slow it down."""
START = 60.0
"""s that a process may take to come up on a machine that has much else to do."""
ADDRESS = r"http://127\.0\.0\.1:\d+"
RIDE = (STATE, COMMAND, COMMAND_ECHO, EPISODE)
RECORDED = [f"/{topic.name}" for topic in (*RIDE, GOAL_STATUS, TIMING)]


class Soak:
    """A long ride and what is measured of it."""

    def __init__(
        self, domain: int, folder: Path, pace: str, seed: int = 1, cockpit: bool = True
    ) -> None:
        self.env = {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder / "log")}
        self.bag = folder / "bag"
        self.pace = pace
        self.chance = random.Random(seed)
        self.nodes: dict[str, NodeProcess] = {}
        self.probe = Probe(domain, COMMAND_ECHO)
        self.state: BicycleState | None = None
        self.before = 0
        self._asked = 0.0
        self.probe.node.create_subscription(STATE.type, STATE.name, self._on_state, 1)
        settings = ("reset_after_fall:=0.5", f"pace:={pace}", f"seed:={seed}")
        words = [word for setting in settings for word in ("-p", setting)]
        self._start("simulator", "bicycle_sim.nodes.sim_node", ["--ros-args", *words])
        self._start("controller", "bicycle_controller.nodes.controller_node")
        self._start("recorder", "bicycle_bag.nodes.recorder_node", self._recorder())
        if cockpit:
            self._start_cockpit()
        for name in (STATE.name, COMMAND.name, TIMING.name):
            self.nodes["recorder"].wait_for_line(f"recording /{name}", START)
        self.probe.publisher(GOAL_POSE)

    def _start(self, name: str, module: str, words: Sequence[str] = ()) -> None:
        self.nodes[name] = NodeProcess.start(module, words, self.env)

    def _recorder(self) -> list[str]:
        return ["--output", str(self.bag), "--max-bag-duration", "600", "--topics", *RECORDED]

    def _start_cockpit(self) -> None:
        self._start("cockpit", "bicycle_cockpit.nodes.cockpit", ["--no-ride", "--port", "0"])
        address = self.nodes["cockpit"].wait_for_line(ADDRESS, START)[0]
        page = [str(Path(__file__).parents[1] / "support" / "pages.py"), "read", address]
        self.nodes["page"] = NodeProcess([sys.executable, *page])
        self.nodes["page"].wait_for_line("open", START)

    def _on_state(self, state: BicycleState) -> None:
        if self.state is not None and state.episode != self.state.episode:
            self.before += self.state.step
        self.state = state

    @property
    def steps(self) -> int:
        """Steps ridden so far, but for the last ones of an episode that ended unseen."""
        return self.before + (self.state.step if self.state else 0)

    def _has_goal(self) -> bool:
        """Return True if the last step pursued a goal."""
        echoes = self.probe[COMMAND_ECHO]
        del echoes[:-1]
        return bool(echoes and echoes[-1].command.has_goal)

    def _ask(self) -> None:
        """Send the bicycle on when it has arrived; repeated until it has understood."""
        state, now = self.state, time.monotonic()
        if state is None or self._has_goal() or now - self._asked < 0.2:
            return
        self._asked = now
        x, y = (self.chance.uniform(-50.0, 50.0) for _ in "xy")
        self.probe.say(GOAL_POSE, goal(x, y))

    def ride(self, steps: int) -> list[dict[str, Any]]:
        """Ride for so many steps, or until Ctrl-C; what was sampled on the way."""
        samples: list[dict[str, Any]] = []
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
        try:
            with tqdm(total=steps, unit="step", mininterval=10.0) as bar:
                while self.steps < steps:
                    self._ask()
                    self.probe.executor.spin_once(timeout_sec=0.1)
                    if self.pace == "lockstep":
                        time.sleep(LOOK)
                    if self.steps >= len(samples) * steps / SAMPLES:
                        samples.append(self.sample())
                        bar.update(self.steps - bar.n)
        except KeyboardInterrupt:
            pass
        return [*samples, self.sample()]

    def sample(self) -> dict[str, Any]:
        """Resident memory, open files and threads of each process now."""
        gone = {name: node.output for name, node in self.nodes.items() if not node.running}
        assert not gone, f"ended on the way: {gone}"
        return {"step": self.steps, **{name: usage(node.pid) for name, node in self.nodes.items()}}

    def close(self) -> dict[str, int]:
        """End all; each one's exit status."""
        statuses = {name: node.stop(timeout=60.0) for name, node in reversed(self.nodes.items())}
        self.kill()
        return statuses

    def kill(self) -> None:
        """Leave nothing behind."""
        for node in self.nodes.values():
            node.kill()
        self.probe.close()


def usage(pid: int) -> dict[str, int]:
    """Return the resources that a process holds."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    status = dict(line.split(":", 1) for line in lines)
    return {
        "rss_kib": int(status["VmRSS"].split()[0]),
        "files": len(list(Path(f"/proc/{pid}/fd").iterdir())),
        "threads": int(status["Threads"]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0, help="of the bicycle's time")
    parser.add_argument("--pace", choices=("realtime", "lockstep"), default="realtime")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--verify",
        type=int,
        default=200_000,
        metavar="STEPS",
        help="compute so many of the last steps again, some 1,500 in a second (%(default)s)",
    )
    parser.add_argument("--without-cockpit", action="store_true")
    parser.add_argument("--folder", type=Path, help="where there is room for the bag")
    parser.add_argument("--out", type=Path, default=Path("soak.json"))
    args = parser.parse_args()
    about: dict[str, Any] = {**origin(), "seed": args.seed, "pace": args.pace}
    about["load_at_start"] = round(os.getloadavg()[0], 1)
    with ExitStack() as stack:
        domain = stack.enter_context(claimed_domain())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=args.folder)))
        soak = Soak(domain, folder, args.pace, args.seed, not args.without_cockpit)
        stack.callback(soak.kill)
        begun = time.monotonic()
        samples = soak.ride(round(args.hours * 3600.0 / DT))
        about["hours"] = round((time.monotonic() - begun) / 3600.0, 3)
        about["load_at_end"] = round(os.getloadavg()[0], 1)
        about["exit_statuses"] = soak.close()
        about["memory"] = {name: growth(samples, name) for name in soak.nodes}
        # What the bag says takes a day's ride a quarter of an hour: what is known is kept before.
        args.out.write_text(json.dumps({**about, "samples": samples}) + "\n")
        about |= bag_figures(soak.bag, args.verify)
        args.out.write_text(json.dumps({**about, "samples": samples}) + "\n")
    print(json.dumps(about, indent=2))


if __name__ == "__main__":
    main()
