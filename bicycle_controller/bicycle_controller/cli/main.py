"""Command `bicycle`: everything that needs no ROS.

Each subcommand is a module of this folder with `add_arguments(parser)` and `run_command(args)`,
which returns the exit status. It is imported on demand, so that `bicycle --help` is fast and
riding does not need the packages of training.
"""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_controller.cli.main")

import argparse
import os
import sys
from types import ModuleType

from bicycle_common.command_line import FAILED, INTERRUPTED, USAGE_ERROR, OneLineParser
from bicycle_common.signals import importing
from bicycle_common.validation import nearest
from bicycle_controller import __version__

COMMANDS = {
    "train": "learn to ride, or go on learning",
    "evaluate": "ride a controller from many starts and score it",
    "sensing": "ride by what sensors say, and tell what each imperfection costs",
    "learn": "learn to ride from recorded rides",
    "sweep": "train many presets on many scenarios with many seeds",
    "plot": "draw learning curves of runs and sweeps",
    "reproduce": "run the paper's experiments and draw its figures",
    "export": "write a policy as ONNX with its card, or a run or bag as CSV",
    "import": "turn a stable-baselines3 or torch actor into a policy",
    "identify": "find a bicycle's parameters from logs of its rides",
    "info": "tell a bicycle's geometry, critical speeds and eigenvalues",
}


def overview() -> OneLineParser:
    """Return the parser of `bicycle` without a subcommand."""
    lines = [f"  {name:10} {text}" for name, text in COMMANDS.items()]
    parser = OneLineParser(
        prog="bicycle",
        usage="bicycle COMMAND [OPTIONS]",
        description="Train, score and export controllers of the simulated bicycle.",
        epilog="commands:\n" + "\n".join(lines) + "\n\nbicycle COMMAND --help tells more.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=__version__)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a subcommand.

    Args:
        argv: the words after `bicycle`; those of this process by default.

    Returns:
        The exit status: 2 for a user's mistake, 1 on failure, 130 after Ctrl-C.
    """
    arguments = sys.argv[1:] if argv is None else argv
    name = arguments[0] if arguments else "--help"
    try:
        if name.startswith("-"):
            overview().parse_with_hint([name])
        if name not in COMMANDS:
            overview().error(f"unknown command {name!r}{nearest(name, COMMANDS)}")
        return _run(name, arguments[1:])
    except SystemExit as leaving:  # --help, --version and mistakes found by argparse
        return leaving.code if isinstance(leaving.code, int) else 0
    except KeyboardInterrupt:
        print(f"bicycle {name}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        raise  # the reader of the output has left: `run_module` knows what to do
    except ModuleNotFoundError as error:
        remedy = f"run 'ros2_ws/setup.sh --with train', or 'pip install {error.name}'"
        return _report(name, f"needs {error.name}, which is not installed: {remedy}", error)
    except (ValueError, OSError) as error:
        return _report(name, str(error), error)
    except RuntimeError as error:
        _report(name, str(error), error)
        return FAILED


def _module(name: str) -> ModuleType:
    """Import the module of one of `COMMANDS`."""
    if name == "train":
        from bicycle_controller.cli import train

        return train
    if name == "evaluate":
        from bicycle_controller.cli import evaluate

        return evaluate
    if name == "sensing":
        from bicycle_controller.cli import sensing

        return sensing
    if name == "learn":
        from bicycle_controller.cli import learn

        return learn
    if name == "sweep":
        from bicycle_controller.cli import sweep

        return sweep
    if name == "reproduce":
        from bicycle_controller.cli import reproduce

        return reproduce
    if name == "export":
        from bicycle_controller.cli import export

        return export
    if name == "plot":
        from bicycle_controller.cli import plot

        return plot
    if name == "identify":
        from bicycle_controller.cli import identify

        return identify
    if name == "import":
        from bicycle_controller.cli import import_policy

        return import_policy
    from bicycle_controller.cli import info

    return info


def _run(name: str, arguments: list[str]) -> int:
    """Run the command of that name."""
    with importing():
        module = _module(name)
    parser = OneLineParser(
        prog=f"bicycle {name}",
        description=f"{COMMANDS[name].capitalize()}.",
        epilog=getattr(module, "EPILOG", None),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.helper = parser.prog
    module.add_arguments(parser)
    status: int = module.run_command(parser.parse_with_hint(arguments))
    sys.stdout.flush()
    return status


def _report(name: str, message: str, error: Exception) -> int:
    """Print one line for a mistake; the full traceback with BICYCLE_TRACEBACK=1."""
    if os.environ.get("BICYCLE_TRACEBACK") == "1":
        raise error
    print(f"bicycle {name}: {' '.join(message.split())}", file=sys.stderr)
    return USAGE_ERROR
