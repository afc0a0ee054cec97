"""Arguments and execution of `bicycle sweep`."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from bicycle_common.validation import require
from bicycle_controller.cli import options
from bicycle_controller.training import sweep

MOST_SEEDS = 1000
EPILOG = """\
Every preset is trained on every scenario with every seed, each run in a process of its own on
this machine, or as tasks of a Ray cluster. A sweep that was stopped or killed goes on when the
same command is given again: runs that are done are skipped, others go on from their checkpoints
(on a cluster: if OUT is shared). A run that failed is done too; without its result.json it is
tried again.

example:
  bicycle sweep --out sweeps/a --presets fast,paper --seeds 5 --steps 500000
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle sweep`."""
    add = parser.add_argument
    options.add_out(parser, "the sweep's folder", required=True)
    add("--presets", default="fast", metavar="A,B", help="what to train (default: %(default)s)")
    add(
        "--scenarios",
        default="random-start-random-goal",
        metavar="A,B",
        help="what to train on (default: %(default)s)",
    )
    add("--seeds", type=int, default=5, metavar="N", help="runs of each (default: %(default)s)")
    options.add_seed(parser, "the first seed", default=1)
    add(
        "--steps",
        type=options.whole_number,
        metavar="N",
        help="environment steps of each run (default: the preset's)",
    )
    options.add_device(parser, "cpu, or cuda with one GPU a run")
    what = "change one value in all runs, for instance"
    options.add_overrides(parser, "ddpg.tau=0.01", what)
    add("--episodes", type=int, default=1000, metavar="N", help="rides of each final score")
    options.add_parallel(parser, "processors to use (default: all)")
    options.add_json(parser)
    options.add_quiet(parser)


def run_command(args: argparse.Namespace) -> int:
    """Run all unfinished jobs and print the results of all.

    Returns:
        The exit status: 1 if a run failed.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    require(1 <= args.seeds <= MOST_SEEDS, f"--seeds must be 1 to {MOST_SEEDS}, not {args.seeds}")
    require(args.episodes >= 1, f"--episodes must be at least 1, not {args.episodes}")
    require(args.parallel is None or args.parallel >= 1, "--parallel must be at least 1")
    jobs = sweep.plan(
        args.out,
        args.presets.split(","),
        args.scenarios.split(","),
        range(args.seed, args.seed + args.seeds),
        options.changes(args, steps="steps", device="device"),
    )
    progress = options.shows_progress(args)
    found = sweep.sweep(jobs, args.episodes, args.ray_address, args.parallel, progress)
    groups = sweep.groups(found)
    result = {"out": str(args.out), "groups": groups, "runs": found}
    for run in found:
        if run["status"] == "failed":
            name = f"{run['preset']} on {run['scenario']} with seed {run['seed']}"
            print(f"failed: {name}: {run['error']}", file=sys.stderr)
    print(json.dumps(result, indent=2) if args.json else _table(groups))
    return 1 if any(group["failed"] for group in groups) else 0


def _table(groups: list[dict[str, Any]]) -> str:
    """Return a table with a line for each preset on each scenario."""
    header = ["preset", "scenario", "runs", "failed", "reached: least", "median", "fell: most"]
    lines = [[*header, "time s", "cpu s"]]
    for group in groups:
        reach, fall = group["reach_rate"] or [None] * 3, group["fall_rate"] or [None] * 3
        cells = [group["preset"], group["scenario"], str(group["runs"]), str(group["failed"])]
        cells += [_cell(value, ".2%") for value in (reach[0], reach[1], fall[2])]
        lines.append([*cells, _cell(group["median_time_s"], ".1f"), _cell(group["cpu_s"], ".0f")])
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
