"""The 40 Hz loop alone, and beside all else at once: trainer, recorder and four browsers.

Simulator and controller ride to a far goal in real time. In turns nothing else runs, or the
trainer learns live at full speed, a recorder records every topic, and a cockpit serves four
pages, one of which stalls (see bench_cockpit.py). Percentiles are over all steps of all turns
of a kind; `added_p99_ms` is the difference that the issue bounds by 1 ms. It says so beside the
load that others put on the machine. Two turns of each take some two and a half minutes.

    python tests/benchmarks/bench_loop.py [--turns 2] [--seconds 25] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import rclpy
from bench_cockpit import PORT, READERS
from loop_ear import Ear, node, percentiles, start, stop, trainer
from machine import machine

from bicycle_controller.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "loop.json"
PAGES = str(Path(__file__).parent / "bench_cockpit.py")
WARM_UP = 100
START = 12.0
"""s for everything to come up and for learning to begin before a turn counts."""


def loaded(ear: Ear, seconds: float, folder: Path) -> dict[str, Any]:
    """One turn beside everything."""
    beside: list[Any] = [
        trainer(folder / "run", WARM_UP),
        start("-m", "bicycle_bag.nodes.recorder_node", "--output", str(folder / "bag")),
        start("-m", "bicycle_cockpit.nodes.cockpit", "--no-ride", "--port", str(PORT)),
    ]
    try:
        beside[-1].stdout.readline()  # its address: it can be reached now
        beside += [start(PAGES, "--page", "read") for _ in range(READERS)]
        beside.append(start(PAGES, "--page", "stall"))
        ear.listen(START)
        ear.status = None
        found = ear.hear(seconds)
    finally:
        for process in reversed(beside):
            stop(process)
    found["updates_per_s"] = float(getattr(ear.status, "update_rate", 0.0))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    ear = Ear()
    nodes = [node("bicycle_sim.nodes.sim_node"), node("bicycle_controller.nodes.controller_node")]
    alone, beside = [], []
    try:
        ear.send_far_goal()
        ear.listen(4.0)
        for _ in range(args.turns):
            alone.append(ear.hear(args.seconds))
            with tempfile.TemporaryDirectory() as folder:
                beside.append(loaded(ear, args.seconds, Path(folder)))
    finally:
        for process in nodes:
            stop(process)
        rclpy.try_shutdown()
    result: dict[str, Any] = {**origin(), "machine": machine("torch", "aiohttp")}
    result["alone"] = percentiles(alone)
    result["trainer, recorder, four pages"] = percentiles(beside)
    result["trainer, recorder, four pages"]["updates_per_s"] = [
        round(found["updates_per_s"]) for found in beside
    ]
    result["added_p99_ms"] = {
        name: round(
            result["trainer, recorder, four pages"][f"{name}_p99_ms"]
            - result["alone"][f"{name}_p99_ms"],
            3,
        )
        for name in ("jitter", "lateness", "latency")
    }
    args.out.parent.mkdir(exist_ok=True)
    args.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
