"""Arguments and execution of `bicycle identify`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.cli import options
from bicycle_controller.identification import report
from bicycle_controller.identification.identify import identify
from bicycle_controller.identification.logs import Log, resampled
from bicycle_sim.plants.whipple import catalogue

EPILOG = """\
LOG is a CSV file (also .gz) or a bag. A CSV file has a header line; the order of its columns does
not matter. Needed: speed, lean_rate (or roll_rate), fork_angle (or steer_angle), command_fork (or
steer_torque); time, if there is no column of it, counts at --rate. SI units, or others in
brackets: 'lean_rate [deg/s]', 'speed [km/h]'. Lean and steering are positive to the same side.

The bicycle of --bicycle is what is known before: its numbers hold where the ride says nothing.

examples:
  bicycle identify ride-7.csv ride-14.csv ride-18.csv --bicycle steer-by-wire --out mine.yaml
  bicycle identify my-ride --bicycle docs/my-bicycle.yaml --json
  bicycle identify slow.csv fast.csv --held-out middle.csv --bicycle mine.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle identify`."""
    add = parser.add_argument
    add("logs", nargs="+", metavar="LOG", help="CSV files and bags that are fitted")
    text = "a bicycle that is alike: a name or a YAML file (default: %(default)s)"
    options.add_bicycle(parser, text, default="browser")
    add(
        "--trust",
        type=float,
        metavar="FACTOR",
        help="on the deviations of its numbers: 1 was measured, 4 is only alike (default: 1, "
        "without --bicycle 4)",
    )
    add(
        "--held-out",
        action="append",
        default=[],
        metavar="LOG",
        help="foretell this log, do not fit it; may be repeated",
    )
    add(
        "--rate",
        type=float,
        default=100.0,
        metavar="HZ",
        help="of CSV without time (default: %(default)g)",
    )
    add(
        "--steer-left",
        action="store_true",
        help="in CSV, steering and torque are positive to the other side than lean",
    )
    add("--speeds", default="", metavar="M_S,...", help="tell the modes at these speeds, too")
    add("--plot", type=Path, metavar="FILE", help="draw the weave over speed there (PNG, SVG)")
    options.add_out(parser, "write the bicycle there (YAML)", metavar="FILE")
    options.add_json(parser)


def run_command(args: argparse.Namespace) -> int:
    """Fit, print what was found, and write the bicycle on request.

    Returns:
        The exit status.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    require(1.0 <= args.rate <= 100_000.0, f"--rate must be 1 to 100000 Hz, not {args.rate:g}")
    trust = args.trust
    if trust is None:
        trust = 4.0 if args.bicycle == "browser" else 1.0
    require(0.01 <= trust <= 100.0, f"--trust must lie between 0.01 and 100, not {trust:g}")
    speeds = _speeds(args.speeds)
    prior = catalogue.load(args.bicycle).parameters
    for option, path in (("--out", args.out), ("--plot", args.plot)):
        require(
            path is None or path.parent.is_dir(),
            f"{option}: there is no folder {path.parent if path else ''}",
        )
    logs = [log for name in args.logs for log in _read(name, args)]
    held = [log for name in args.held_out for log in _read(name, args)]
    with np.errstate(all="ignore"):
        found = identify(logs, prior, trust, held or None, speeds)
    if args.out is not None:
        report.write(found, args.out)
    if args.plot is not None:
        from bicycle_controller.cli.weave_chart import draw

        draw(found, args.plot)
    print(json.dumps(report.as_data(found), indent=2) if args.json else report.as_text(found))
    if args.out is not None and not args.json:
        print(f"wrote {args.out}")
    return 0


def _speeds(text: str) -> tuple[float, ...]:
    try:
        speeds = tuple(float(word) for word in text.split(",") if word.strip())
    except ValueError:
        raise ValueError(f"--speeds must be numbers such as 2,3.5, not {text!r}") from None
    require(
        all(0.0 < v <= 30.0 for v in speeds), f"--speeds must lie above 0 and up to 30 m/s: {text}"
    )
    return speeds


def _read(name: str, args: argparse.Namespace) -> list[Log]:
    """Return the logs of a file or bag."""
    path = Path(name)
    require(path.exists(), f"there is no log {name}")
    if path.is_dir() or path.suffix == ".mcap":
        from bicycle_controller.identification import read_bag

        found = read_bag.read(path)
    else:
        from bicycle_controller.identification import read_csv

        found = read_csv.read(path, args.rate, args.steer_left)
    return [resampled(log) for log in found]
