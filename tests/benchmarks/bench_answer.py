"""Answer time of a shipped policy inside the controller, while it rides at 40 Hz.

`bench_policy_latency.py` asks it again and again, so that its weights stay in the processor's
cache; here it sleeps 25 ms between two states, as on a ride, and other processes come between.
Figures are the controller's own diagnostics: `policy` is the network alone, `answer` all from the
state to the command. In turns the shipped policy rides with nobody who listens to its
steps, and with one, as a recorder would; whether torch is in the controller's process is looked
up in its memory map.

    python tests/benchmarks/bench_answer.py [--turns 3] [--seconds 50] [--out FILE]
"""

from __future__ import annotations

import os
import statistics
from pathlib import Path
from typing import Any

from machine import machine
from timing_probe import options, ride, save

from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "answer.json"
KINDS = {"alone": False, "with a listener": True}
ENTRY = "bicycle_controller: policy"
CONTROLLER = "bicycle_controller.nodes.controller_node"


def controller_has_torch() -> bool:
    """Return True if the controller that this program started has torch loaded."""
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    (process,) = (
        Path("/proc", child)
        for child in children
        if CONTROLLER.encode() in Path("/proc", child, "cmdline").read_bytes()
    )
    return "libtorch" in (process / "maps").read_text()


def turn(listens: bool, seconds: float) -> dict[str, Any]:
    """Make one ride; percentiles in us of its last 50 s at most."""
    with ride(timing=listens) as probe:
        probe.listen(seconds)
        facts = probe.diagnostics[ENTRY]
        found: dict[str, Any] = {
            f"{what}_p{share}_us": round(1e3 * float(facts[f"{what} p{share} (ms)"]), 1)
            for what in ("policy", "answer")
            for share in (50, 99)
        }
        return found | {"answered": int(facts["answered"]), "torch": controller_has_torch()}


def main() -> None:
    parser = options(__doc__, RESULTS, 50.0)
    args = parser.parse_args()
    result: dict[str, Any] = {**origin(), "machine": machine("numpy", "ros-jazzy-rclpy")}
    turns: dict[str, list[dict[str, Any]]] = {kind: [] for kind in KINDS}
    for _ in range(args.turns):
        for kind, found in turns.items():
            found.append(turn(KINDS[kind], args.seconds))
    for kind, found in turns.items():
        medians = {
            key: statistics.median(one[key] for one in found)
            for key in found[0]
            if key.endswith("us")
        }
        result[kind] = {"median of turns": medians, "turns": found}
    save(args.out, result)


if __name__ == "__main__":
    main()
