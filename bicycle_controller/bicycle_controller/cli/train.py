"""Arguments and execution of `bicycle train`."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from bicycle_common.signals import importing
from bicycle_controller.cli import options, run_result
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation import beside_lqr
from bicycle_controller.training.run_folder import PATH_CONFIG, RunFolder
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import SCENARIOS

if TYPE_CHECKING:  # torch takes seconds, and --help and mistakes need none of it
    from bicycle_controller.evaluation.score import Score
    from bicycle_controller.training.path_following import RoadScore
    from bicycle_controller.training.session import Result

PATHS = "path-following"
"""Task of following paths."""

EPILOG = f"""\
scenarios: {", ".join(SCENARIOS)}
presets:
  fast                   from nothing, without a teacher
  quick                  the same with smaller critics, soonest at 99 % of the goals
  guided, guided-speed   from a classical controller's rides, as the shipped actors
  paper, authors         the paper's tables, and what its authors ran
  naf, ppo               the paper's baselines
  any-bicycle            one actor for any bicycle, from its classical controllers' rides
  offline, offline-plain from recorded rides alone, for 'bicycle learn'

example:
  bicycle train --preset fast --scenario learned-speed --seed 1 --out runs/mine
  bicycle plot runs/mine
  bicycle train path-following --seed 1 --out runs/follower
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle train`."""
    presets = f"one of {', '.join(loading.preset_names())}"
    options.add_run_folder(parser, "from its checkpoint", required=True)
    options.add_configuration(parser, presets, "fast")
    add = parser.add_argument
    add(
        "task",
        nargs="?",
        choices=("goals", PATHS),
        default="goals",
        metavar="TASK",
        help=f"goals, or {PATHS}: to follow random roads (default: goals)",
    )
    options.add_bicycle(parser, f"of {PATHS} (default: browser-rider)")
    options.add_scenario(parser, "where from and where to (default: the preset's)")
    options.add_seed(parser)
    options.add_device(parser)
    add(
        "--steps",
        type=options.whole_number,
        metavar="N",
        help="environment steps over all bicycles",
    )
    options.add_overrides(parser, "ddpg.tau=0.01")
    options.add_json(parser)
    options.add_quiet(parser)


def overrides_of(args: argparse.Namespace) -> list[loading.Override]:
    """Return all overrides that the arguments ask for."""
    own = ("scenario", "seed", "device", "steps")
    return options.changes(args, **{name: name for name in own})


def config_of(args: argparse.Namespace) -> RunConfig:
    """Return the configuration of a new run.

    Raises:
        ValueError: on an unknown name, a value out of range or an unreadable file.
    """
    if args.config is not None and args.preset is not None:
        raise ValueError("give --config or --preset, not both: a file may say 'extends: fast'")
    if args.config is not None:
        return loading.load(args.config, overrides_of(args))
    return loading.preset(args.preset or "fast", overrides_of(args))


def run_command(args: argparse.Namespace) -> int:
    """Train, or resume training.

    Returns:
        The exit status: 0, or 128 + the number of the signal that interrupted it.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    if args.task == PATHS:
        return _follow(args)
    if args.bicycle is not None:
        raise ValueError(f"--bicycle belongs to {PATHS}: goals take --set plant=...")
    progress = options.progress_of(args)
    if args.resume:
        _refuse_paths(args)
    config = None if args.resume else config_of(args)
    with importing():
        from bicycle_controller.training import imitation, online
    if config is None:
        if args.config is not None or args.preset is not None:
            raise ValueError("a resumed run has its own config.yaml: leave out --config, --preset")
        files = RunFolder(args.out)
        files.require()
        imitates = loading.load(files.config).imitation is not None
        resume = imitation.resume if imitates else online.resume
        result = resume(args.out, overrides_of(args), progress)
    else:
        run = online.run if config.imitation is None else imitation.run
        result = run(config, args.out, progress)
    print(
        json.dumps({"out": str(args.out), **asdict(result)})
        if args.json
        else result_text(result, args),
        flush=True,
    )
    if result.best is not None and result.status != "interrupted":
        config = loading.load(RunFolder(args.out).config)
        if worse := beside_lqr.warning(result.best, beside_lqr.lqr_score(config)):
            print(f"bicycle: warning: {worse}", file=sys.stderr)
    return 128 + result.signal if result.signal else 0


def _follow(args: argparse.Namespace) -> int:
    """Train a follower of paths.

    Returns:
        The exit status: 0, or 128 + the number of the signal that interrupted it.

    Raises:
        ValueError: on a user's mistake.
    """
    given = {
        "--preset": args.preset,
        "--config": args.config,
        "--scenario": args.scenario,
        "--device": args.device,
        "--set": args.overrides,
    }
    wrong = [name for name, value in given.items() if value]
    if wrong:
        raise ValueError(f"{wrong[0]} does not go with {PATHS}")
    asked = {"seed": args.seed, "steps": args.steps}
    changes: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
    if args.bicycle or not args.resume:
        changes["plant"] = registry.named(bicycle=args.bicycle or "browser-rider")
    progress = options.progress_of(args)
    with importing():
        from bicycle_controller.training import path_following
    if args.resume:
        result = path_following.resume(args.out, changes, progress)
    else:
        result = path_following.run(path_following.PathRun(**changes), args.out, progress)
    if args.json:
        file = args.out / path_following.NAME
        best = {"rms": None, "largest": None, "lost": None}
        scores = best if result.best is None else asdict(result.best)
        ended = {name: getattr(result, name) for name in ("status", "steps", "updates")}
        print(json.dumps({"out": str(args.out), "follower": str(file), **ended, **scores}))
    else:
        print(_follower_text(result, args))
    return 128 + result.signal if result.signal else 0


def _follower_text(result: Result[RoadScore], args: argparse.Namespace) -> str:
    """Return the result of a run of path following as a few lines."""
    from bicycle_controller.training import path_following

    file, best = args.out / path_following.NAME, result.best
    work = f"{result.steps} steps and {result.updates} updates"
    lines = [run_result.ended(result, work)]
    if best is None:
        lines.append(f"follower without a score: {file}")
    else:
        lines += [
            f"best follower: {file}: {best.rms:.3f} m rms and {best.largest:.2f} m at most off"
            f" {path_following.ROADS} random roads, {best.lost} lost",
            f"its courses: bicycle evaluate {file} --course all --bicycle"
            f" {args.bicycle or 'browser-rider'}",
        ]
    lines += run_result.how_to_go_on(result, f"bicycle train {PATHS}", args.out)
    return "\n".join(lines)


def _refuse_paths(args: argparse.Namespace) -> None:
    """Refuse to resume a run of the other task."""
    if RunFolder(args.out, PATH_CONFIG).config.exists():
        raise ValueError(f"{args.out} holds a run of {PATHS}: bicycle train {PATHS} --resume")


def result_text(result: Result[Score], args: argparse.Namespace) -> str:
    """Return the result as a few lines."""
    work = f"{result.steps} steps and {result.updates} updates"
    return run_result.as_text(result, work, "bicycle train", args.out)
