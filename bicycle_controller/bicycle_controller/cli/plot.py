"""Arguments and execution of `bicycle plot`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from bicycle_common.validation import require
from bicycle_controller.cli import options
from bicycle_controller.training import learning_curves

EPILOG = """\
RUN is the folder of a run, or one that holds runs, such as a sweep's. Runs that differ by their
seed alone are one curve: the median, and the range of the seeds as a band; from six seeds on the
band is the interval that holds the true median with 95 % probability or a little more.

example:
  bicycle train --seed 1 --out runs/a1 && bicycle train --seed 2 --out runs/a2
  bicycle plot runs/a1 runs/a2 --out curves.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle plot`."""
    add = parser.add_argument
    add("runs", nargs="+", type=Path, metavar="RUN", help="folders of runs or sweeps")
    options.add_out(parser, "picture to write", "FILE", Path("curves.png"))
    add(
        "--of",
        default="reach_rate",
        metavar="NAME",
        help=f"one of {', '.join(learning_curves.VALUES)} (default: %(default)s)",
    )
    add(
        "--over",
        default="step",
        metavar="NAME",
        help=f"one of {', '.join(learning_curves.AXES)} (default: %(default)s)",
    )
    options.add_json(parser)


def run_command(args: argparse.Namespace) -> int:
    """Draw the curves and print the end of each.

    Returns:
        The exit status.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    for name, known in (("of", learning_curves.VALUES), ("over", learning_curves.AXES)):
        value = getattr(args, name)
        require(value in known, f"--{name} must be one of {', '.join(known)}, not {value!r}")
    curves = learning_curves.read(args.runs, args.of, args.over)
    from bicycle_controller.reproduce.curve_picture import draw

    draw(curves, args.of, args.over, args.out)
    summaries = [curve.summary() for curve in curves]
    if args.json:
        print(json.dumps({"file": str(args.out), "curves": summaries}, indent=2))
        return 0
    for row in summaries:
        print(
            f"{row['name']}: {row['seeds']} seed{'s' * (row['seeds'] > 1)}, {args.of} at the end "
            f"{row['last']:.3g} ({row['low']:.3g} to {row['high']:.3g}), best {row['best']:.3g}"
        )
    print(f"wrote {args.out}")
    return 0
