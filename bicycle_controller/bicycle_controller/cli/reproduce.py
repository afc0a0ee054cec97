"""Arguments and execution of `bicycle reproduce`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from bicycle_common.validation import nearest, require
from bicycle_controller.cli import options
from bicycle_controller.reproduce import experiment as experiments
from bicycle_controller.reproduce.experiment import MODES, Experiment
from bicycle_controller.reproduce.results import write_results
from bicycle_controller.reproduce.runner import ReproduceOptions, redraw, reproduce

MOST = 1_000_000
"""Upper bound of episodes, seeds and parallel runs."""
EPILOG = """\
FIGURE is 9 to 16, robustness, or all; why-naf, why-ppo, why-displacement and why-speed look for
why a claim does not hold. Training runs are kept in OUT/runs: what was stopped, by Ctrl-C or
kill -9, goes on when the same command is given again; what is done is not done again, and a
longer --episodes lets it go on from where it ended. --only-seeds shares the runs of a figure out
to several machines: rows of runs that are not here stay in OUT. OUT/FIGURE/PHYSICS holds the raw
data (CSV), run.json with command, commit, seeds and times, summary.json and figure.png; RESULTS.md
is made from all of them.

examples:
  bicycle reproduce 11 --short
  bicycle reproduce 10 --episodes 500 --parallel 8
  bicycle reproduce all --no-train
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle reproduce`."""
    add = parser.add_argument
    add("figure", metavar="FIGURE", help="9 to 16, robustness, why-..., or all")
    options.add_out(parser, "default: %(default)s", default=Path("reproduction"))
    add("--results", type=Path, metavar="FILE", help="the page (default: OUT/RESULTS.md)")
    add("--short", action="store_true", help="a minute's version, to see that it works")
    add("--episodes", type=int, metavar="N", help="of each training run (default: the paper's)")
    add("--seeds", type=int, metavar="N", help="training runs of each kind (default: the paper's)")
    add("--only-seeds", metavar="A,B", help="train only the runs with these seeds, as 2,3")
    options.add_physics(parser, "faithful or corrected (default: both)")
    options.add_device(parser, "of training (default: cpu)", default="cpu")
    add("--arms", metavar="A,B", help="train only these, as authors,fast")
    add("--no-train", action="store_true", help="ride and draw what is trained already")
    add("--draw-only", action="store_true", help="draw again what is ridden already")
    options.add_parallel(parser, "runs at once (default: %(default)s)", default=1)
    options.add_json(parser, "print the summaries as JSON")
    options.add_quiet(parser)


def run_command(args: argparse.Namespace) -> int:
    """Run the requested experiments.

    Returns:
        The exit status: 0, or 128 + the number of the signal that interrupted training.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    chosen = experiments.find(args.figure)
    modes = _modes(args.physics)
    for name in ("episodes", "seeds", "parallel"):
        value = getattr(args, name)
        in_range = value is None or 1 <= value <= MOST
        require(in_range, f"--{name} must be 1 to {MOST:,}, not {value}")
    how = ReproduceOptions(
        out=args.out,
        short=args.short,
        arms=_arms(args.arms, chosen),
        only_seeds=_seeds(args.only_seeds),
        train=not args.no_train,
        address=args.ray_address,
        parallel=args.parallel,
        device=args.device,
        progress=options.shows_progress(args),
    )
    page = args.results or args.out / "RESULTS.md"
    if args.draw_only:
        drawn = [redraw(item, mode, args.out) for item in chosen for mode in modes]
        require(any(drawn), f"{args.out} holds no data of it yet: leave out --draw-only")
        write_results(args.out, page)
    else:
        for item in chosen:
            for mode in modes:
                length = experiments.lengthened(item, args.short, args.episodes, args.seeds)
                most = max(how.only_seeds, default=1)
                require(
                    most <= length.seeds,
                    f"{item.name} has {length.seeds} seeds, not {most}: give --seeds {most}, too",
                )
                signal = reproduce(item, mode, length, how)
                if signal:
                    print("stopped: the same command goes on from here", file=sys.stderr)
                    return 128 + signal
                write_results(args.out, page)
    _tell(chosen, modes, args, page)
    return 0


def _modes(asked: str | None) -> tuple[str, ...]:
    """Return the physics to run."""
    if asked is None:
        return MODES
    if asked not in MODES:
        raise ValueError(f"unknown physics {asked!r}{nearest(asked, MODES)}; known: {MODES}")
    return (asked,)


def _arms(asked: str | None, chosen: list[Experiment]) -> tuple[str, ...]:
    """Return the names of the arms to train; refuse unknown ones."""
    if asked is None:
        return ()
    known = list(dict.fromkeys(arm.name for item in chosen for arm in item.arms))
    for name in asked.split(","):
        require(name in known, f"unknown arm {name!r}{nearest(name, known)}; known: {known}")
    return tuple(asked.split(","))


def _seeds(asked: str | None) -> tuple[int, ...]:
    """Return the seeds to train; refuse what is no list of them."""
    if asked is None:
        return ()
    words = asked.split(",")
    good = all(word.isdecimal() and 1 <= int(word) <= MOST for word in words)
    require(good, f"--only-seeds takes seeds from 1 on, as 2,3, not {asked!r}")
    return tuple(dict.fromkeys(int(word) for word in words))


def _tell(
    chosen: list[Experiment], modes: tuple[str, ...], args: argparse.Namespace, page: Path
) -> None:
    """Print the paths of the results, or all numbers as JSON."""
    folders = [args.out / item.name / mode for item in chosen for mode in modes]
    folders = [folder for folder in folders if folder.exists()]
    if args.json:
        found = {str(path): json.loads((path / "summary.json").read_text()) for path in folders}
        print(json.dumps(found, indent=2))
        return
    for folder in folders:
        print(f"{folder}: figure.png, summary.json, CSVs")
    print(f"{page}: what they say")
