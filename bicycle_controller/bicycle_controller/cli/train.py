"""`bicycle train`: its arguments and what it does with them."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation import beside_lqr
from bicycle_controller.training import online
from bicycle_controller.training.run_folder import RunFolder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle train`."""
    presets = ", ".join(loading.preset_names())
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="the run's folder")
    add("--resume", action="store_true", help="go on with the run in DIR from its checkpoint")
    add("--preset", metavar="NAME", help=f"one of {presets} (default: fast)")
    add("--config", type=Path, metavar="FILE", help="a YAML file instead of a preset")
    add("--scenario", metavar="NAME", help="where from and where to (default: the preset's)")
    add("--seed", metavar="N", help="of everything that is random (default: the preset's)")
    add("--device", metavar="NAME", help="cpu or cuda (default: the preset's)")
    add("--steps", metavar="N", help="environment steps over all bicycles")
    add(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change one value, for instance ddpg.tau=0.01; may be repeated",
    )
    add("--json", action="store_true", help="print the result as JSON")
    add("--quiet", action="store_true", help="draw no progress bar")


def overrides_of(args: argparse.Namespace) -> list[str]:
    """All `NAME=VALUE` changes that the arguments ask for."""
    named = ((name, getattr(args, name)) for name in ("scenario", "seed", "device", "steps"))
    return [*(f"{name}={value}" for name, value in named if value is not None), *args.overrides]


def config_of(args: argparse.Namespace) -> RunConfig:
    """The configuration of a new run.

    Raises:
        ValueError: on an unknown name, a value out of range or a file that cannot be read.
    """
    if args.config is not None and args.preset is not None:
        raise ValueError("give --config or --preset, not both: a file may say 'extends: fast'")
    if args.config is not None:
        return loading.load(args.config, overrides_of(args))
    return loading.preset(args.preset or "fast", overrides_of(args))


def run_command(args: argparse.Namespace) -> int:
    """Train, or go on training.

    Returns:
        The exit status: 0, or 128 + the number of the signal that interrupted it.

    Raises:
        ValueError: on a user's mistake, one line with the remedy.
    """
    progress = not args.quiet and sys.stderr.isatty()
    if args.resume:
        if args.config is not None or args.preset is not None:
            raise ValueError("a resumed run has its own config.yaml: leave out --config, --preset")
        result = online.resume(args.out, overrides_of(args), progress)
    else:
        result = online.run(config_of(args), args.out, progress)
    print(
        json.dumps({"out": str(args.out), **asdict(result)}) if args.json else told(result, args),
        flush=True,
    )
    if result.best is not None and result.status != "interrupted":
        config = loading.load(RunFolder(args.out).config)
        if worse := beside_lqr.warning(result.best, beside_lqr.lqr_score(config)):
            print(f"bicycle: warning: {worse}", file=sys.stderr)
    return 128 + result.signal if result.signal else 0


def told(result: online.Result, args: argparse.Namespace) -> str:
    """The result in a few lines."""
    made = f"{result.steps} steps and {result.updates} updates in {result.wall_s:.0f} s"
    lines = [f"{result.status} after {made} ({result.cpu_s:.0f} s of processor time)"]
    if result.best is not None:
        best = result.best
        time = "no goal" if best.median_time_s is None else f"median {best.median_time_s:.1f} s"
        lines.append(
            f"best policy: {args.out / 'best.safetensors'}: {best.reach_rate:.1%} reached,"
            f" {best.fall_rate:.1%} fell, {time}"
        )
    if result.status == "interrupted":
        lines.append(f"go on with: bicycle train --resume --out {args.out}")
    return "\n".join(lines)
