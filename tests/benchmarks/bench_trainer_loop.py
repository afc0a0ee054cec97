"""Does learning beside the ride disturb the 40 Hz loop?

Simulator and controller run as nodes in real time and ride to far goals. In turns the trainer
node learns live from them or is not there, and each turn's LoopTiming messages are kept: how
late the steps were and how long the answer to a state took. Percentiles are over all steps of
all turns of a kind. The load that others put on the machine is told beside them.

    python tests/benchmarks/bench_trainer_loop.py [--turns 3] [--seconds 30] [--out FILE]
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from machine import machine
from timing_probe import TimingProbe, options, percentiles, ride, save, stop, trainer

from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "trainer_loop.json"
START = 15.0
"""s for a trainer to import torch and to begin its updates, before its turn counts."""
WARM_UP = 100


def turn(probe: TimingProbe, seconds: float, folder: Path | None) -> dict[str, Any]:
    """Take one turn, with the trainer where it has a folder."""
    learning = None
    if folder is not None:
        learning = trainer(folder, WARM_UP)
        probe.listen(START)
    probe.status = None
    found = probe.hear(seconds)
    if learning is not None:
        stop(learning)
    return {**found, "updates_per_s": float(getattr(probe.status, "update_rate", 0.0))}


def summary(turns: list[dict[str, Any]]) -> dict[str, Any]:
    """Percentiles over all turns of a kind, ms, and how fast was learned."""
    updates = [round(found["updates_per_s"]) for found in turns]
    return {**percentiles(turns, ("lateness", "latency")), "updates_per_s": updates}


def main() -> None:
    args = options(__doc__, RESULTS, 30.0).parse_args()
    turns: dict[str, list[dict[str, Any]]] = {"alone": [], "learning": []}
    with ride("policy:=lqr") as probe, tempfile.TemporaryDirectory() as folder:
        for index in range(args.turns):
            turns["alone"].append(turn(probe, args.seconds, None))
            turns["learning"].append(turn(probe, args.seconds, Path(folder) / str(index)))
    result = {**origin(), "machine": machine()}
    result |= {kind: summary(found) for kind, found in turns.items()}
    save(args.out, result)


if __name__ == "__main__":
    main()
