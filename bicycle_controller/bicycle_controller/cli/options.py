"""The options that several commands share: each is defined once, in name, type and result."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, Literal

from bicycle_controller.config.loading import Override
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant


def add_run_folder(parser: argparse.ArgumentParser, resumed_with: str, required: bool) -> None:
    """Declare `--out` and `--resume` of a run; `resumed_with` tells what a run goes on with."""
    add_out(parser, "the run's folder", required=required)
    text = f"go on with the run in DIR, {resumed_with}"
    parser.add_argument("--resume", action="store_true", help=text)


def add_out(
    parser: argparse.ArgumentParser,
    text: str,
    metavar: str = "DIR",
    default: Path | None = None,
    required: bool = False,
) -> None:
    """Declare `--out`, a path; `text` is its help."""
    parser.add_argument(
        "--out", type=Path, metavar=metavar, default=default, required=required, help=text
    )


def add_configuration(parser: argparse.ArgumentParser, presets: str, default: str) -> None:
    """Declare `--preset` and `--config`; `presets` names those to choose from."""
    add = parser.add_argument
    add("--preset", metavar="NAME", help=f"{presets} (default: {default})")
    add("--config", type=Path, metavar="FILE", help="a YAML file instead of a preset")


def add_seed(
    parser: argparse.ArgumentParser,
    of: str = "of everything that is random",
    default: int | None = None,
) -> None:
    """Declare `--seed`, a whole number; without a default the preset's holds."""
    shown = "the preset's" if default is None else "%(default)s"
    text = f"{of} (default: {shown})"
    parser.add_argument("--seed", type=whole_number, default=default, metavar="N", help=text)


def add_device(
    parser: argparse.ArgumentParser,
    text: str = "cpu or cuda (default: the preset's)",
    default: str | None = None,
) -> None:
    """Declare `--device`, a name that is checked where the device is taken."""
    parser.add_argument("--device", default=default, metavar="NAME", help=text)


def add_overrides(
    parser: argparse.ArgumentParser, example: str, what: str = "change one value, for instance"
) -> None:
    """Declare `--set`, which may be repeated, as `args.overrides`, a list of NAME=VALUE."""
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help=f"{what} {example}; may be repeated",
    )


def add_scenario(parser: argparse.ArgumentParser, text: str, required: bool = False) -> None:
    """Declare `--scenario`, a name that is checked where the scenario is taken."""
    parser.add_argument("--scenario", required=required, metavar="NAME", help=text)


def add_plant(
    parser: argparse.ArgumentParser, default: str, physics_default: str, which: str = ""
) -> None:
    """Declare `--plant`, `--bicycle` and `--physics`, which `named_plant` reads.

    Args:
        parser: gets them.
        default: what holds without `--plant`, in words.
        physics_default: what holds without `--physics`, in words.
        which: addition to the help of `--plant`.
    """
    text = f"choi, whipple or mujoco{which} (default: {default})"
    parser.add_argument("--plant", metavar="NAME", help=text)
    add_bicycle(parser, "of whipple or mujoco, see bicycle info")
    add_physics(parser, f"of the plant choi, faithful or corrected (default: {physics_default})")


def add_bicycle(parser: argparse.ArgumentParser, text: str, default: str | None = None) -> None:
    """Declare `--bicycle`, a name of the catalogue or a YAML file."""
    parser.add_argument("--bicycle", default=default, metavar="NAME|FILE", help=text)


def add_physics(parser: argparse.ArgumentParser, text: str) -> None:
    """Declare `--physics`, the paper's printed or its corrected equations."""
    parser.add_argument("--physics", metavar="MODE", help=text)


def add_parallel(parser: argparse.ArgumentParser, text: str, default: int | None = None) -> None:
    """Declare `--parallel` and `--ray-address`: how many runs at once, and where."""
    add = parser.add_argument
    add("--parallel", type=int, default=default, metavar="N", help=text)
    add("--ray-address", metavar="ADDRESS", help="HOST:PORT of a Ray cluster, or auto")


def add_json(parser: argparse.ArgumentParser, text: str = "print the result as JSON") -> None:
    """Declare `--json`."""
    parser.add_argument("--json", action="store_true", help=text)


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Declare `--quiet`; ask `shows_progress` for it."""
    parser.add_argument("--quiet", action="store_true", help="show no progress")


def shows_progress(args: argparse.Namespace) -> bool:
    """True to tell the progress on standard error."""
    return not args.quiet


def progress_of(args: argparse.Namespace) -> bool | Literal["lines"]:
    """Return how a run shows its progress: a bar in a terminal, lines elsewhere, or nothing."""
    if args.quiet:
        return False
    return True if sys.stderr.isatty() else "lines"


def changes(args: argparse.Namespace, **names: str) -> list[Override]:
    """Return the arguments' changes of a configuration: separate options, then `--set`.

    Args:
        args: the arguments.
        names: option by the field of the configuration that it sets, `field="option"`.
    """
    values = {field: getattr(args, option) for field, option in names.items()}
    given: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    return [given, *args.overrides]


def whole_number(text: str) -> int:
    """Parse a whole number; `2e5` is one too.

    Raises:
        argparse.ArgumentTypeError: when it is none.
    """
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if not number.is_integer():
        raise argparse.ArgumentTypeError(f"must be a whole number, not {text!r}")
    return int(number)


def named_plant(args: argparse.Namespace) -> Plant[Any] | None:
    """Return the plant that `--plant`, `--bicycle` and `--physics` name; None without them.

    Raises:
        ValueError: on an unknown name.
    """
    asked = {"plant": args.plant, "bicycle": args.bicycle, "physics": args.physics}
    given = {name: value for name, value in asked.items() if value is not None}
    return registry.named(**given) if given else None
