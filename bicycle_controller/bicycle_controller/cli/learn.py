"""Arguments and execution of `bicycle learn`."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bicycle_common.command_line import FAILED
from bicycle_common.signals import importing
from bicycle_common.validation import require
from bicycle_controller.cli import options, run_result
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.data import dataset
from bicycle_controller.data.dataset_report import as_text, report
from bicycle_sim.task.scenario import named

if TYPE_CHECKING:  # torch takes seconds, and --help and mistakes need none of it
    from bicycle_controller.training import offline

EPILOG = """\
A BAG is a folder that record.sh or ride.sh made, an .mcap file, or a folder of such.
The data are described before anything is learned; --report does no more than that.

examples:
  bicycle learn ros2_ws/runs/2026-01-01-1 --out runs/from-bags --seed 1
  bicycle learn bags/ --out runs/plain --preset offline-plain
  bicycle learn --resume --out runs/from-bags
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle learn`."""
    presets = ", ".join(name for name in loading.preset_names() if name.startswith("offline"))
    add = parser.add_argument
    add("bags", nargs="*", type=Path, metavar="BAG", help="bags, or folders of bags")
    options.add_run_folder(parser, "with its own bags", required=False)
    add("--report", action="store_true", help="only describe the data")
    options.add_configuration(parser, f"{presets}, or any other", "offline")
    options.add_scenario(parser, "what was ridden, for bags that do not say")
    add("--least", type=int, default=dataset.LEAST, metavar="N", help="refuse fewer transitions")
    options.add_seed(parser)
    options.add_device(parser)
    add(
        "--updates",
        type=options.whole_number,
        metavar="N",
        help="how many to make (default: the preset's)",
    )
    options.add_overrides(parser, "ddpg.bc_alpha=1")
    options.add_json(parser)
    options.add_quiet(parser)


def config_of(args: argparse.Namespace) -> RunConfig:
    """Return the configuration of a new run.

    Raises:
        ValueError: on an unknown name, a value out of range or an unreadable file.
    """
    overrides = options.changes(args, seed="seed", device="device", offline_updates="updates")
    if args.config is not None and args.preset is not None:
        raise ValueError("give --config or --preset, not both: a file may say 'extends: offline'")
    if args.config is not None:
        return loading.load(args.config, overrides)
    return loading.preset(args.preset or "offline", overrides)


def run_command(args: argparse.Namespace) -> int:
    """Describe the data and learn from them, or resume learning.

    Returns:
        The exit status: 0; 1 if no candidate was kept; or 128 + the number of the signal that
        interrupted it.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    progress = options.progress_of(args)
    if args.out is None and not args.report:
        raise ValueError("name the run's folder with --out DIR, or ask for a --report only")
    if args.resume:
        _refuse_with_resume(args)
        with importing():
            from bicycle_controller.training import offline
        return _told(offline.resume(args.out, progress), args, {})
    require(args.least >= 0, f"--least must be zero or more, not {args.least}")
    if not args.bags:
        raise ValueError("name a bag, or a folder of bags, to learn from")
    config = config_of(args)
    data = dataset.load(args.bags, named(args.scenario) if args.scenario else None)
    about = report(data) if len(data.transitions) else {}
    if about and not args.json:
        print(as_text(about), flush=True)
    for warning in dataset.check(data, args.least):
        print(f"bicycle learn: warning: {warning}", file=sys.stderr)
    if args.report:
        if args.json:
            print(json.dumps(about))
        return 0
    with importing():
        from bicycle_controller.training import offline
    return _told(offline.run(config, data, args.out, progress), args, about)


def _refuse_with_resume(args: argparse.Namespace) -> None:
    """Refuse options that contradict `--resume`: that run has its own bags and configuration."""
    names = ("bags", "preset", "config", "scenario", "seed", "device", "updates", "overrides")
    given = [name for name in names if getattr(args, name) not in (None, [])]
    if given:
        raise ValueError(f"a resumed run has its own {given[0]}: leave it out")


def _told(result: offline.Learned, args: argparse.Namespace, about: dict[str, Any]) -> int:
    """Print the result; return the exit status."""
    data = {"data": about} if about else {}
    line = json.dumps({"out": str(args.out), **asdict(result), **data})
    print(line if args.json else result_text(result, args.out))
    if result.refused:
        print(
            f"bicycle learn: warning: {result.refused} candidates were refused, because the mean"
            " Q of their actions was above 0 and no reward is: keep ddpg.bc_weight and"
            " ddpg.bound_values on",
            file=sys.stderr,
        )
    if result.signal:
        return 128 + result.signal
    return 0 if result.best is not None else FAILED


def result_text(result: offline.Learned, out: Path) -> str:
    """Return the result as a few lines."""
    work = f"{result.updates:,} updates from {result.transitions:,} transitions"
    return run_result.as_text(result, work, "bicycle learn", out)
