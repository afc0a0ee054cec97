"""Arguments and execution of `bicycle evaluate`."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bicycle_common.origin import made_by
from bicycle_common.progress import ProgressBar
from bicycle_common.validation import require
from bicycle_controller.cli import options
from bicycle_controller.config import loading
from bicycle_controller.control.followers import FOLLOWERS
from bicycle_controller.control.guidance import GuidanceConfig
from bicycle_controller.evaluation import arrivals, course_score, crossings, kicks
from bicycle_controller.evaluation import evaluate as scoring
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_controller.evaluation.table import as_text, comparison_as_text, kicks_as_text
from bicycle_controller.policy.devices import actor_on
from bicycle_controller.policy.policy import load_controller, write_atomically
from bicycle_controller.policy.policy_file import PolicyInfo
from bicycle_controller.policy.trained_for import held_back, unlike_training, warning
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.task.scenario import Scenario, named

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

DEFAULT_SCENARIO = "random-start-random-goal"
EPILOG = (
    """\
CONTROLLER is lqr (also lqr-displacement, lqr-pedal, lqr-displacement-pedal, lqr-20cm), the name
of a shipped policy, a policy file or the folder of a training run (its best); with --plant or
--bicycle it is lqr by default.
Starts, goals and start disturbances follow from the seed alone: every controller meets the same.

With --course or --arrivals, CONTROLLER is a follower: preview (an LQR that sees the path's
curvature ahead; the default) or stanley (the baseline). --course random rides one random road per
episode.

examples:
  bicycle evaluate fixed-speed --episodes 10000 --against lqr --json
  bicycle evaluate --plant whipple --bicycle browser-rider --kicks best
  bicycle evaluate --course all --bicycle browser-rider --picture courses.png

"""
    + (
        scoring.__doc__.partition("\n\n")[2]
        + """
With --kicks, or for a bicycle of --plant or --bicycle, `kicks` is a list with an entry for every
speed, and `kicks_best` one with the best LQR of a stated grid for that very bicycle (evaluation/
lqr_grid.py), with its weights and `share`, what CONTROLLER catches as a share of it:

"""
    )
    + kicks.__doc__.rpartition("every speed:\n\n")[2]
    + course_score.__doc__.partition("\n\n")[2]
    + "\n"
    + arrivals.__doc__.partition("\n\n")[2]
    + "\n"
    + crossings.__doc__.partition("\n\n")[2]
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle evaluate`."""
    add = parser.add_argument
    add("controller", metavar="CONTROLLER", nargs="?", help="what to score")
    text = (
        "score a path follower instead: all, a course's name, a YAML, CSV or GPX file, or random"
    )
    add("--course", metavar="NAME|FILE", help=text)
    text = "largest distance (m) and angle (degrees) from the course's start, for --episodes rides"
    add("--from", dest="start", nargs=2, type=float, metavar=("M", "DEG"), help=text)
    text = f"with --course, see by an estimator and sensors: {', '.join(sensors.names())}, a file"
    add("--sensors", metavar="PRESET|FILE", help=text)
    text = "score arrivals at N random poses in the direction asked for, instead"
    add("--arrivals", type=int, metavar="N", help=text)
    text = "score how pairs of bicycles keep clear of one another at N crossings, instead"
    add("--crossings", type=int, metavar="N", help=text)
    add("--picture", type=Path, metavar="FILE", help="with --course, draw the rides, PNG")
    add("--against", metavar="CONTROLLER", help="compare with this one on the same starts")
    options.add_scenario(parser, "a scenario (default: the one it was trained on)")
    what = "change one field of the scenario, as"
    options.add_overrides(parser, "max_steps=400", what)
    options.add_plant(parser, "as trained on", "as trained on")
    add(
        "--kicks",
        choices=("none", "own", "best"),
        help="the largest kick caught, and beside it the best LQR's (default: own with --plant or "
        "--bicycle, else none)",
    )
    add(
        "--kick-speeds",
        type=_speeds,
        default=kicks.SPEEDS,
        metavar="M_S[,M_S...]",
        help="speeds at which kicks are tried (default: 1.5, 2, 3, 4 and 6)",
    )
    text = "rides (default: 1000, with --course 1 each)"
    add("--episodes", type=int, default=None, metavar="N", help=text)
    options.add_seed(parser, "of the starts", default=0)
    options.add_device(parser, "cpu, or cuda for the policy's network", default="cpu")
    options.add_out(parser, "write the JSON there too", metavar="FILE")
    options.add_json(parser)
    options.add_quiet(parser)
    _add_disturbances(parser)


def _add_disturbances(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that disturb the bicycle, see `rollouts.Disturbance`."""
    add = parser.add_argument_group("disturbances").add_argument
    add("--roll-kick", type=float, metavar="RAD_S", help="jump of the lean rate, left or right")
    add("--kick-time", type=float, metavar="S", help="when that happens (default: 2)")
    add("--initial-tilt", type=float, metavar="RAD", help="start lean, standard deviation")
    add("--displacement-noise", type=float, metavar="M", help="uniform noise, half width")
    add(
        "--observation-noise",
        type=_numbers,
        metavar="SD[,SD...]",
        help="standard deviation for all six observations, or for each",
    )
    add("--action-delay", type=int, metavar="STEPS", help="steps that an action takes to arrive")
    add("--speed", type=float, metavar="M_S", help="start speed instead of the scenario's")


def _numbers(text: str) -> tuple[float, ...]:
    """Parse one number for all six observations, or six."""
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (1, 6):
        raise argparse.ArgumentTypeError(f"write 1 or 6 numbers with commas, not {text!r}")
    return values * 6 if len(values) == 1 else values


def _speeds(text: str) -> tuple[float, ...]:
    """Parse speeds above zero."""
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(0.0 < value < 100.0 for value in values):
        raise argparse.ArgumentTypeError(f"write speeds in m/s with commas, not {text!r}")
    return values


def run_command(args: argparse.Namespace) -> int:
    """Score the controllers, print the result, and write it on request.

    Returns:
        The exit status.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    if args.out is not None:
        # Fail before an hour of riding, not after it.
        args.out.parent.mkdir(parents=True, exist_ok=True)
    if args.course is not None:
        return _ride_courses(args)
    if args.arrivals is not None:
        return _score_arrivals(args)
    if args.crossings is not None:
        plant = options.named_plant(args) or registry.default()
        return _told(args, plant, crossings.score(plant, args.crossings, args.seed), crossings)
    if args.start is not None or args.picture is not None or args.sensors is not None:
        raise ValueError("--from, --picture and --sensors belong to --course")
    args.episodes = 1000 if args.episodes is None else args.episodes
    if args.controller is None:
        require(
            args.plant is not None or args.bicycle is not None,
            "name a CONTROLLER to score, such as fixed-speed, a --course or a --bicycle",
        )
        args.controller = "lqr"
    first = load_controller(args.controller)
    scenario, plant = _world(args, first)
    disturbance = _disturbance(args)
    names = [args.controller, *([args.against] if args.against else [])]
    riders = [
        actor_on(load_controller(name, plant, scenario.torque_limit), args.device)
        for name in names
    ]
    found = [
        scoring.evaluate(
            rider,
            scenario,
            plant,
            args.episodes,
            args.seed,
            disturbance,
            progress=options.shows_progress(args),
        )
        for rider in riders
    ]
    unlike = [_unlike(name, scenario, plant, disturbance) for name in names]
    result: dict[str, Any] = found[0].summary()
    result["unlike_training"] = unlike[0]
    text = as_text([item.summary() for item in found])
    caught = [_kicks(args, rider, scenario, plant) for rider in riders]
    result |= caught[0]
    text += kicks_as_text(names, caught)
    if args.against:
        result["against"] = {**found[1].summary(), "unlike_training": unlike[1], **caught[1]}
        result["comparison"] = scoring.compare(*found)
        text += "\n\n" + comparison_as_text(result["comparison"])
    written = json.dumps(result, indent=2)
    if args.out is not None:
        write_atomically(args.out, written.encode() + b"\n")
    print(written if args.json else text, flush=True)
    for item, differences in zip(found, unlike, strict=True):
        if differences:
            print(f"bicycle: warning: {warning(item.controller, differences)}", file=sys.stderr)
    return 0


def _kicks(
    args: argparse.Namespace, rider: Controller, scenario: Scenario, plant: Plant[Any]
) -> dict[str, Any]:
    """Return the largest kicks caught at each speed, and the best LQR's, as far as wanted."""
    asked = args.kicks or ("own" if args.plant or args.bicycle else "none")
    if asked == "none":
        return {}
    limits = scenario.action_limits
    shown = options.shows_progress(args)
    speeds = ProgressBar(args.kick_speeds, desc="kicks", unit="speed", shown=shown)
    own = [kicks.largest(rider, plant, speed, limits) for speed in speeds]
    result: dict[str, Any] = {"kicks": [item.summary() for item in own]}
    if asked == "best":
        # Imported here: it needs scipy.
        from bicycle_controller.evaluation.lqr_grid import best

        speeds = ProgressBar(args.kick_speeds, desc="the grid's kicks", unit="speed", shown=shown)
        rows = [best(plant, speed, limits) for speed in speeds]
        result["kicks_best"] = [
            {**row.summary(), "share": row.share(item)}
            for item, row in zip(own, rows, strict=True)
        ]
    return result


def _ride_courses(args: argparse.Namespace) -> int:
    """Score a follower on courses; return the exit status.

    Raises:
        ValueError: on a user's mistake.
    """
    given = {"--scenario": args.scenario, "--against": args.against}
    given |= {f"--{name.replace('_', '-')}": getattr(args, name) for name in vars(Disturbance())}
    del given["--speed"]
    wrong = [name for name, value in given.items() if value is not None]
    if wrong:
        raise ValueError(f"{wrong[0]} does not go with --course")
    plant = options.named_plant(args) or registry.default()
    scenario = named("learned-speed").with_motor(plant.torque_limit)
    scenario = loading.changed(scenario, args.overrides)
    limits = scenario.torque_limit, scenario.pedal_limit
    away, turned = args.start or (0.0, 0.0)
    if not (0.0 <= away <= 40.0 and 0.0 <= turned <= 180.0):
        raise ValueError(f"--from {away:g} {turned:g}: choose up to 40 m and 180 degrees")
    results, traces = course_score.score(
        args.controller or "preview",
        args.course,
        plant,
        1 if args.episodes is None else args.episodes,
        args.seed,
        args.speed,
        limits,
        (away, math.radians(turned)),
        None if args.sensors is None else sensors.load(args.sensors),
        options.shows_progress(args),
    )
    if args.picture is not None:
        args.picture.parent.mkdir(parents=True, exist_ok=True)
        title = f"{args.controller or 'preview'} on {plant.label}"
        course_score.draw(traces, title, args.picture)
    found = {
        **made_by(),
        "physics": json.loads(plant.to_json()),
        "torque_limit": limits[0],
        "pedal_limit": limits[1],
        "sensors": args.sensors or "none: the truth",
        "seed": args.seed,
        "courses": results,
    }
    written = json.dumps(found, indent=2)
    if args.out is not None:
        write_atomically(args.out, written.encode() + b"\n")
    print(written if args.json else course_score.as_text(results), flush=True)
    return 0


def _score_arrivals(args: argparse.Namespace) -> int:
    """Score arrivals at random poses; return the exit status.

    Raises:
        ValueError: on a user's mistake.
    """
    plant = options.named_plant(args) or registry.default()
    scenario = named(args.scenario or "learned-speed").with_motor(plant.torque_limit)
    scenario = loading.changed(scenario, args.overrides)
    config = GuidanceConfig(follower=args.controller or "preview")
    require(config.follower in FOLLOWERS, f"{config.follower!r} follows no path: name a follower")
    shown = options.shows_progress(args)
    result = arrivals.score(
        plant, scenario, args.arrivals, args.seed, config=config, progress=shown
    )
    result = {"scenario": scenario.name, "follower": config.follower, **result}
    return _told(args, plant, result, arrivals)


def _told(args: argparse.Namespace, plant: Plant[Any], result: dict[str, Any], kind: Any) -> int:
    """Write and print a result of the module `kind`; return the exit status."""
    found = {**made_by(), "physics": json.loads(plant.to_json()), **result}
    written = json.dumps(found, indent=2)
    if args.out is not None:
        write_atomically(args.out, written.encode() + b"\n")
    print(written if args.json else kind.as_text(result), flush=True)
    return 0


def _unlike(
    name: str, scenario: Scenario, plant: Plant[Any], disturbance: Disturbance
) -> list[str]:
    """Return the differences between the rides and the controller's training."""
    if disturbance.speed is not None:
        scenario = replace(scenario, start_speed=disturbance.speed, speed_limits=None)
    controller = load_controller(name, plant, scenario.torque_limit)
    unlike = unlike_training(controller, plant, scenario)
    return [*unlike, *held_back(controller, plant, scenario)]


def _world(args: argparse.Namespace, controller: Controller) -> tuple[Scenario, Plant[Any]]:
    """Return the requested scenario and plant, or those of the controller's training."""
    trained: PolicyInfo | None = getattr(controller, "info", None)
    if args.scenario is None and trained is not None:
        scenario = trained.scenario
    else:
        scenario = named(args.scenario or DEFAULT_SCENARIO)
    plant = options.named_plant(args) or (registry.default() if trained is None else trained.plant)
    scenario = scenario.with_motor(plant.torque_limit)
    return loading.changed(scenario, args.overrides).suited(plant.input_names), plant


def _disturbance(args: argparse.Namespace) -> Disturbance:
    """Return the disturbance that the arguments describe."""
    names = vars(Disturbance())
    given = {name: getattr(args, name) for name in names if getattr(args, name) is not None}
    return Disturbance(**given)
