"""The 40 Hz loop alone, and beside all else at once: trainer, recorder and four browsers.

Simulator and controller ride to a far goal in real time. In turns nothing else runs, or the
trainer learns live at full speed, a recorder records every topic, and a cockpit serves four
pages, one of which stalls (see bench_cockpit.py). Percentiles are over all steps of all turns
of a kind; `added_p99_ms` is what all of that adds. The load of the machine stands beside it. Three
turns of each take some four minutes.

    python tests/benchmarks/bench_loop.py [--turns 3] [--seconds 25] [--priority N] [--out FILE]
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from bench_cockpit import ADDRESS, PAGES, PORT, READERS
from machine import machine
from timing_probe import TimingProbe, options, percentiles, ride, save, start, stop, trainer

from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "loop.json"
WARM_UP = 100
START = 12.0
"""s for everything to come up and for learning to begin before a turn counts."""


def loaded(probe: TimingProbe, seconds: float, folder: Path) -> dict[str, Any]:
    """Take one turn beside everything."""
    beside: list[Any] = [
        trainer(folder / "run", WARM_UP),
        start("-m", "bicycle_bag.nodes.recorder_node", "--output", str(folder / "bag")),
        start("-m", "bicycle_cockpit.nodes.cockpit", "--no-ride", "--port", str(PORT)),
    ]
    try:
        beside[-1].stdout.readline()  # its address: it can be reached now
        beside += [start(PAGES, "read", ADDRESS) for _ in range(READERS)]
        beside.append(start(PAGES, "stall", ADDRESS))
        probe.listen(START)
        probe.status = None
        found = probe.hear(seconds)
    finally:
        for process in reversed(beside):
            stop(process)
    found["updates_per_s"] = float(getattr(probe.status, "update_rate", 0.0))
    return found


def main() -> None:
    parser = options(__doc__, RESULTS, 25.0)
    parser.add_argument(
        "--priority", type=int, help="real-time priority; the nodes' own unless set"
    )
    args = parser.parse_args()
    alone, beside = [], []
    with ride(priority=args.priority) as probe:
        for _ in range(args.turns):
            alone.append(probe.hear(args.seconds))
            with tempfile.TemporaryDirectory() as folder:
                beside.append(loaded(probe, args.seconds, Path(folder)))
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
    save(args.out, result)


if __name__ == "__main__":
    main()
