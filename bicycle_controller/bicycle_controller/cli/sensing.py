"""Arguments and execution of `bicycle sensing`."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common.origin import made_by
from bicycle_common.progress import ProgressBar
from bicycle_common.validation import require
from bicycle_controller.cli import options
from bicycle_controller.control.lqr import TUNED, LqrController
from bicycle_controller.evaluation import link_loss, sensing
from bicycle_controller.evaluation.evaluate import wilson
from bicycle_controller.evaluation.sensing import Conditions, Outcome
from bicycle_controller.policy.policy import load_controller, write_atomically
from bicycle_controller.policy.trained_for import unlike_training, warning
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

BICYCLES = "browser-rider,balance-assist-rider,benchmark,balance-assist,steer-by-wire"
"""Measured bicycles, three with a rider and two without."""

EPILOG = """\
CONTROLLER is lqr, the name of a shipped policy, a policy file or the folder of a training run.
Each ride begins at rest, held upright, for as long as the sensors' preset says; then the
controller sees estimates only. An LQR is designed for the bicycle with its delay and motor.

example:
  bicycle sensing lqr --sensors mpu6050 --delay 0.05 --motor-lag 0.03 --friction 0.5 --wind 2
  bicycle sensing lqr --costs --bicycles browser-rider,steer-by-wire --episodes 500
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle sensing`."""
    options.add_quiet(parser)
    add = parser.add_argument
    base = Conditions()
    add("controller", metavar="CONTROLLER", help="what rides")
    add("--bicycles", default=BICYCLES, metavar="NAME[,NAME...]", help="see bicycle info")
    presets = ", ".join(sensors.names())
    add(
        "--sensors",
        default="mpu6050",
        metavar="PRESET|FILE",
        help=f"{presets}, a YAML file, or none for the truth (default: %(default)s)",
    )
    for name, unit, text in (
        ("delay", "S", "from a command to the motor"),
        ("motor-lag", "S", "time constant of the motor"),
        ("torque-limit", "N_M", "of the motor"),
        ("torque-step", "N_M", "one digit of the motor's torque"),
        ("friction", "N_M", "of the steering"),
        ("wind", "M_S", "gusts from the side, standard deviation"),
        ("duration", "S", "of a ride"),
    ):
        default = getattr(base, name.replace("-", "_"))
        shown = f"{text} (default: %(default)s)"
        add(f"--{name}", type=float, default=default, metavar=unit, help=shown)
    low, high = base.speeds
    add("--speeds", type=_pair, default=base.speeds, metavar="LOW,HIGH", help="m/s, drawn between "
        f"(default: {low:g},{high:g})")  # fmt: skip
    add("--episodes", type=int, default=200, metavar="N", help="rides of each bicycle "
        "(default: %(default)s)")  # fmt: skip
    add("--link-loss", action="store_true", help="stop the commands at a random moment instead, "
        "and tell who is upright 10 s later")  # fmt: skip
    add("--costs", action="store_true", help="ride with each imperfection alone, too")
    text = "friction that the estimator believes, each in turn (default: the bicycle's)"
    add("--model-friction", type=_numbers, default=[], metavar="N_M[,N_M...]", help=text)
    options.add_seed(parser, "of starts, gusts and sensors", default=0)
    options.add_out(parser, "write the JSON there too", metavar="FILE")
    options.add_json(parser)


def _pair(text: str) -> tuple[float, float]:
    try:
        low, high = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"write LOW,HIGH in m/s, not {text!r}") from None
    return low, high


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"write N_M[,N_M...], not {text!r}") from None


def run_command(args: argparse.Namespace) -> int:
    """Ride, print the table, and write it on request.

    Returns:
        The exit status.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    load_controller(args.controller)
    conditions = Conditions(
        sensors=None if args.sensors == "none" else sensors.load(args.sensors),
        delay=args.delay,
        motor_lag=args.motor_lag,
        torque_limit=args.torque_limit,
        torque_step=args.torque_step,
        friction=args.friction,
        wind=args.wind,
        speeds=args.speeds,
        duration=args.duration,
    )
    if args.model_friction:
        require(not args.link_loss, "--link-loss has no estimator: leave out --model-friction")
        require(not args.costs, "choose one of --costs and --model-friction")
        require(args.sensors != "none", "--model-friction needs --sensors: the truth has no model")
    names = args.bicycles.split(",")
    for name in names:
        registry.named(bicycle=name)
    if args.link_loss:
        known = f"--link-loss rides by an LQR: choose one of {', '.join(TUNED)}"
        require(args.controller in TUNED, known)
        require(not args.costs, "choose one of --costs and --link-loss")
        return _link_loss(args, names, conditions)
    unlike = {name: _unlike(args.controller, name, conditions) for name in names}
    found = _frictions(conditions, args.model_friction) or _cases(conditions, args.costs)
    cases = [(name, *case) for name in names for case in found]
    rows = [
        {
            "bicycle": name,
            "with": label,
            **_ride(args, name, ridden, believed).summary(),
            "unlike_training": unlike[name],
        }
        for name, label, ridden, believed in ProgressBar(
            cases, desc="sensing", unit="row", shown=options.shows_progress(args)
        )
    ]
    result = {
        **made_by(),
        "controller": args.controller,
        "seed": args.seed,
        "conditions": asdict(conditions),
        "rows": rows,
    }
    written = json.dumps(result, indent=2)
    if args.out is not None:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(args.out, written.encode() + b"\n")
    print(written if args.json else _table(rows), flush=True)
    for name, differences in unlike.items():
        if differences:
            told = warning(args.controller, [f"bicycle {name}", *differences])
            print(f"bicycle: warning: {told}", file=sys.stderr)
    return 0


def _unlike(controller: str, bicycle: str, conditions: Conditions) -> list[str]:
    """Return the differences between the rides of a bicycle and a policy's training."""
    plant = conditions.applied(registry.named(bicycle=bicycle))
    if controller in TUNED:  # designed for each
        return []
    return unlike_training(load_controller(controller, plant), plant)


def _link_loss(args: argparse.Namespace, names: list[str], conditions: Conditions) -> int:
    """Stop the commands and print the rides' outcome."""
    rows: list[dict[str, Any]] = []
    shown = options.shows_progress(args)
    for name in ProgressBar(names, desc="link loss", unit="bicycle", shown=shown):
        plant = replace(conditions, delay=0.0).applied(registry.named(bicycle=name))
        # Designed without the motor, so that it needs no memory.
        plain = replace(conditions, delay=0.0, motor_lag=0.0).applied(plant)
        who = LqrController.named(args.controller, plain, conditions.torque_limit)
        for law in link_loss.LAWS:
            found = link_loss.ride(who, plant, conditions, law, args.episodes, args.seed)
            falls = found.fall_time[~found.upright]
            rows.append(
                {
                    "bicycle": name,
                    "law": law,
                    "rides": len(found.upright),
                    "upright": int(found.upright.sum()),
                    "median_fall_s": round(float(np.median(falls)), 3) if len(falls) else None,
                }
            )
    result = {
        **made_by(),
        "controller": args.controller,
        "seed": args.seed,
        "conditions": {
            name: getattr(conditions, name)
            for name in ("motor_lag", "torque_limit", "torque_step", "friction", "wind", "speeds")
        },
        "rows": rows,
    }
    written = json.dumps(result, indent=2)
    if args.out is not None:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(args.out, written.encode() + b"\n")
    lines = [f"{'bicycle':22} {'after the last command':24} upright after 10 s"]
    for row in rows:
        share = 100.0 * row["upright"] / row["rides"]
        fall = row["median_fall_s"]
        end = "" if fall is None else f", falls after {fall:.1f} s (median)"
        lines.append(
            f"{row['bicycle']:22} {row['law']:24} {row['upright']} of {row['rides']} "
            f"({share:.1f} %){end}"
        )
    print(written if args.json else "\n".join(lines), flush=True)
    return 0


Case = tuple[str, Conditions, Conditions]
"""A name, conditions of the rides, and those that the estimator believes."""


def _frictions(all_of_it: Conditions, believed: list[float]) -> list[Case]:
    """Return everything, with each steering friction that the estimator may believe."""
    return [
        (f"model friction {value:g}", all_of_it, replace(all_of_it, friction=value))
        for value in believed
    ]


def _cases(all_of_it: Conditions, costs: bool) -> list[Case]:
    """Return named conditions: everything, and each imperfection alone if asked for."""
    if not costs:
        return [("everything", all_of_it, all_of_it)]
    alone = ("sensors", "delay", "motor_lag", "torque_step", "friction", "wind")
    none = replace(all_of_it, **{name: getattr(Conditions(), name) for name in alone})
    found = {
        "nothing": none,
        **{
            name.replace("_", " "): replace(none, **{name: getattr(all_of_it, name)})
            for name in alone
            if getattr(all_of_it, name)
        },
        "everything": all_of_it,
    }
    return [(label, ridden, ridden) for label, ridden in found.items()]


def _ride(
    args: argparse.Namespace, bicycle: str, conditions: Conditions, believed: Conditions
) -> Outcome:
    plant = conditions.applied(registry.named(bicycle=bicycle))
    controller: Controller
    if args.controller in TUNED:
        controller = LqrController.named(args.controller, plant, conditions.torque_limit)
    else:
        controller = load_controller(args.controller, plant)
    model = believed.applied(registry.named(bicycle=bicycle))
    return sensing.ride(controller, plant, conditions, args.episodes, args.seed, model)


def _table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as text."""
    head = f"{'bicycle':22} {'with':18} {'falls':>12} {'95 %':>14} {'roll error':>16} "
    lines = [head + f"{'heading':>8} {'torque':>7}"]
    for row in rows:
        falls, rides = int(row["falls"]), int(row["rides"])
        low, high = wilson(falls, rides)
        interval = f"{100 * low:.2f}-{100 * high:.2f} %"
        error = f"{row['roll_error_rms_deg']:.2f} / {row['roll_error_mean_deg']:.2f} deg"
        lines.append(
            f"{row['bicycle']:22} {row['with']:18} {falls:>5} of {rides:<6} {interval:>12} "
            f"{error:>16} {row['heading_rms_deg']:>6.1f} d {row['torque_rms']:>5.2f} N m"
        )
    return "\n".join([*lines, "roll error: root mean square / size of each ride's mean"])
