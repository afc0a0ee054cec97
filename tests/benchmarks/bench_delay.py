"""Rides with simulator and controller on two hosts, by the network's delay and losses.

Two hosts with a network namespace each, joined by a cable in user space that delays and loses
(`link_relay.py`): simulator and recorder on one, controller and goals on the other, all by
their scripts in LAN mode and real time. For each state of the cable the same goals are ridden to
one after the other; a fallen bicycle is put back to the origin. Everything told is from the bag.

    python tests/benchmarks/bench_delay.py [--goals 5] [--seed 1] [--out FILE]
    python tests/benchmarks/bench_delay.py --plot        docs/images/delay.png from the results

Needs root. On a machine that others use too, `chrt -r 1` before it keeps them out of the figures.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine
from two_hosts import Cable, Host, command_ages, forbidden

from bicycle_bag.reader import BagReader
from bicycle_common.types import Point2D
from bicycle_controller.control.goals import Status
from bicycle_controller.training.run_folder import origin
from bicycle_tools.course import random_goals
from bicycle_tools.outcomes import outcomes
from bicycle_tools.ride_log import read_ride
from bicycle_tools.summary import summarise

ROOT = Path(__file__).resolve().parents[2]
RESULTS = Path(__file__).parent / "results" / "delay.json"
PICTURE = ROOT / "docs" / "images" / "delay.png"
WORKSPACE = ROOT / "ros2_ws"
DOMAIN = "47"
FIELD = 50.0
PATIENCE = 60
"""s that one goal may take."""
DELAYS = (0, 10, 20, 30, 40, 50, 60, 80, 100, 120)
JITTERS = (5, 10, 20)
LOSSES = (1, 2, 5, 10)
AT = 20
"""ms, the delay that jitter is added to."""


def points() -> list[dict[str, Any]]:
    """Return the states of the cable: one-way delay and its deviation in ms, loss in percent."""
    swept = [{"series": "delay", "delay": delay, "jitter": 0, "loss": 0} for delay in DELAYS]
    swept += [{"series": "jitter", "delay": AT, "jitter": jitter, "loss": 0} for jitter in JITTERS]
    return swept + [{"series": "loss", "delay": 0, "jitter": 0, "loss": loss} for loss in LOSSES]


def ride(point: dict[str, Any], policy: str, goals: list[Point2D], folder: Path) -> dict[str, Any]:
    """Ride to the goals over one cable; what the bag tells."""
    env = {"BICYCLE_NETWORK": "lan", "ROS_DOMAIN_ID": DOMAIN, "ROS_LOG_DIR": str(folder / "log")}
    left, right = Host("simulates", "10.78.0.1/24"), Host("controls", "10.78.0.2/24")
    cable = Cable(left, right)
    bag = folder / "bag"

    def start(host: Host, script: str, *words: object) -> Any:
        return host.start(WORKSPACE / script, *words, env=env)

    simulator = start(left, "sim.sh", "reset_after_fall:=1.0")
    recorder = start(left, "record.sh", "--output", bag)
    controller = start(right, "controller.sh", f"policy:={policy}")
    try:
        controller.wait_for_line("waits for a goal", 60.0)
        recorder.wait_for_line("recording /bicycle/goal_status", 60.0)
        cable.set(delay=point["delay"] / 1e3, jitter=point["jitter"] / 1e3)
        cable.set(loss=point["loss"] / 1e2)
        for x, y in goals:
            words = (f"{x:.2f}", f"{y:.2f}", "--wait", "--timeout", PATIENCE)
            with start(right, "goal.sh", *words) as goal_script:
                goal_script.wait(PATIENCE + 30.0)
        passed = cable.set()
        recorder.stop(signal.SIGINT, 15.0)
    finally:
        for process in (controller, recorder, simulator):
            process.kill()
        cable.close()
        left.close()
        right.close()
    return {**point, **ride_facts(bag), "cable": passed}


def ride_facts(bag: Path) -> dict[str, Any]:
    """Return the figures of one ride."""
    log = read_ride(bag)
    summary = summarise(log)
    reached = [goal.elapsed for goal in outcomes(log.statuses) if goal.status is Status.REACHED]
    p50, p99 = np.quantile(command_ages(BagReader(bag)), (0.5, 0.99)) * 1e3
    return {
        "goals": summary.goals,
        "reached": summary.reached,
        "falls": summary.falls,
        "time to goal, median (s)": round(float(np.median(reached)), 2) if reached else None,
        "steps": len(log.states["step"]),
        "watchdog steps": summary.loop.zero_steps,
        "watchdog events": summary.loop.watchdog_events,
        "held steps": summary.loop.held_steps,
        "dropped steps": summary.loop.dropped_steps,
        "command age p50 (ms)": round(float(p50), 1),
        "command age p99 (ms)": round(float(p99), 1),
        "path over straight line": round(summary.path_ratio, 4) if reached else None,
        "peak lean (deg)": round(float(np.degrees(summary.peak_lean)), 1),
    }


def draw(results: dict[str, Any], path: Path) -> None:
    """Plot goals reached, and where all were also time and command age, against the delay."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    from bicycle_controller.reproduce.style import STYLE

    colours = {"fixed-speed": "#0b8457", "lqr": "#7b8794"}
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 3, figsize=(9.6, 3.0), constrained_layout=True)
        for policy, rides in results["rides"].items():
            rows = [row for row in rides if row["series"] == "delay"]
            delay = [row["delay"] for row in rows]
            colour = colours.get(policy, "#3a5ba0")
            reached = [100.0 * row["reached"] / max(1, row["goals"]) for row in rows]
            panels[0].plot(delay, reached, "o-", color=colour, label=policy)
            rows = [row for row in rows if row["reached"] == row["goals"]]  # not the survivors'
            delay = [row["delay"] for row in rows]
            time = [row["time to goal, median (s)"] for row in rows]
            panels[1].plot(delay, time, "o-", color=colour, label=policy)
            for quantile, line in (("p50", "o-"), ("p99", "o:")):
                age = [row[f"command age {quantile} (ms)"] for row in rows]
                panels[2].plot(delay, age, line, color=colour, label=f"{policy}, {quantile}")
        panels[0].set(ylabel="goals reached (%)", ylim=(-4, 104))
        panels[1].set(ylabel="time to goal, median (s)", ylim=(0, None))
        panels[2].set(ylabel="age of the command (ms)", ylim=(0, None))
        for panel in panels:
            panel.set(xlabel="one-way delay (ms)")
            panel.legend(frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--goals", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--policies", nargs="+", default=["fixed-speed", "lqr"])
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--plot", action="store_true")
    given = parser.parse_args()
    if given.plot:
        draw(json.loads(given.out.read_text()), PICTURE)
        return
    if reason := forbidden():
        sys.exit(f"bench_delay.py: {reason}")
    goals = random_goals(given.goals, FIELD, (0.0, 0.0), np.random.default_rng(given.seed))
    results: dict[str, Any] = {
        "command": " ".join(["python", "tests/benchmarks/bench_delay.py", *sys.argv[1:]]),
        **origin(),
        "machine": machine("ros-jazzy-rclpy"),
        "goals": goals,
        "seed": given.seed,
        "rides": {policy: [] for policy in given.policies},
    }
    for policy in given.policies:
        for point in points():
            if policy != given.policies[0] and point["series"] != "delay":
                continue
            with tempfile.TemporaryDirectory() as folder:
                row = ride(point, policy, goals, Path(folder))
            row["load"] = round(os.getloadavg()[0], 2)
            results["rides"][policy].append(row)
            print(policy, json.dumps(row), flush=True)
            given.out.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
