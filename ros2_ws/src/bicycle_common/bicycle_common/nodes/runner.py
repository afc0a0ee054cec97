"""Start, spin and end a node: clean on signals, one line for a user's mistake."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

try:
    from rclpy.experimental import EventsExecutor
except ImportError:
    EventsExecutor = None

from bicycle_common import yaml_text
from bicycle_common.nodes import dds_security
from bicycle_common.nodes.heartbeat import VARIABLE, Heartbeat
from bicycle_common.signals import on_signals

WAKE_PERIOD = 0.1
"""s: how soon a signal is noticed; the executor sleeps in C, where Python's handlers wait."""

LOOP_EXECUTOR: Callable[[], Executor] = EventsExecutor or SingleThreadedExecutor
"""For nodes of the control loop: a step takes less than half the usual one's processor time.

In Jazzy it knows no guard condition and no callback that is a coroutine, and it spins at full
speed when it is told to wait without a limit. A native Jazzy from before rclpy 7.1.4 has none.
"""


class UserError(Exception):
    """A mistake of the user; its text is one line with the remedy."""


class Closing(Protocol):
    """A node that has something to do while its topics still work."""

    def close(self) -> None:
        """Publish or save what is left."""


class _Stop:
    """Set by the first signal."""

    def __init__(self) -> None:
        self.asked = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


def run(
    name: str,
    make: Callable[[], Any],
    usage: str = "",
    args: Sequence[str] | None = None,
    executor: Callable[[], Executor] = SingleThreadedExecutor,
) -> int:
    """Run one node until a signal, on one thread.

    Args:
        name: of the program, in front of error lines.
        make: makes the node; it may raise UserError.
        usage: printed by `--help`.
        args: command line with the program's name; the process's own by default.
        executor: makes what calls the node's callbacks.

    Returns:
        The exit status: 0 after SIGINT, SIGTERM or `--help`, 2 for a user's mistake.
    """
    words = list(sys.argv if args is None else args)
    stop = _Stop()
    try:
        if not _understood(words, usage):
            return 0
        on_signals(stop)
        _spin(words, make, executor, stop)
    except UserError as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        return 2
    except ExternalShutdownException:
        pass
    finally:
        rclpy.try_shutdown()
    return 0


def start_ros(words: Sequence[str]) -> None:
    """Start rclpy without its signal handlers.

    Args:
        words: ROS arguments, with the program's name if there are any.

    Raises:
        UserError: on arguments or an environment that ROS does not take, and where DDS security is
            asked for that the middleware does not have.
    """
    refusal = dds_security.refusal()
    if refusal:
        raise UserError(refusal)
    try:
        rclpy.init(args=list(words), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        raise UserError(
            f"cannot start ROS ({_first_line(error)}): check --ros-args and the ROS_ variables"
        ) from None


def made_heartbeat() -> Heartbeat:
    """The node's heartbeat.

    Raises:
        UserError: its file cannot be written.
    """
    try:
        return Heartbeat()
    except OSError as error:
        raise UserError(
            f"cannot write {error.filename} ({error.strerror}): set {VARIABLE} to a file that can "
            "be, or unset it"
        ) from None


def start_tool(name: str, words: Sequence[str] = ()) -> None:
    """Start rclpy for a tool; ends the program with status 2 and one line if that cannot be.

    Args:
        name: in front of that line.
        words: ROS arguments, such as a namespace.
    """
    try:
        start_ros(words)
    except UserError as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        raise SystemExit(2) from None


def without_ros(words: Sequence[str]) -> list[str]:
    """The words of a command line, with the program's name, that are not ROS's, without it.

    Raises:
        UserError: ROS cannot read them.
    """
    _check_parameter_files(words)
    try:
        return list(remove_ros_args(list(words))[1:])
    except Exception as error:
        raise UserError(f"cannot read the ROS arguments: {_first_line(error)}") from None


def _check_parameter_files(words: Sequence[str]) -> None:
    """Refuse what rcl's own reader of YAML would take minutes and all memory for.

    Raises:
        UserError: a parameter file is beyond the bounds of `yaml_text`.
    """
    for option, file in pairwise(words):
        if option != "--params-file":
            continue
        try:
            yaml_text.check_bounds(yaml_text.read_text(Path(file)))
        except yaml_text.BoundsError as error:
            raise UserError(
                f"cannot read the parameter file {file}: {error}; write plain parameters"
            ) from None
        except (OSError, UnicodeDecodeError, yaml_text.YAMLError):
            pass  # rcl says so


def _understood(words: list[str], usage: str) -> bool:
    """Whether to go on: not after `--help`.

    Raises:
        UserError: on a word that belongs to nobody.
    """
    others = without_ros(words)
    if "--help" in others or "-h" in others:
        print(usage)
        return False
    if others:
        raise UserError(
            f"unknown argument {others[0]!r}; parameters go as --ros-args -p name:=value"
        )
    return True


def _spin(
    words: list[str],
    make: Callable[[], Any],
    make_executor: Callable[[], Executor],
    stop: _Stop,
) -> None:
    """Make the node and serve it until `stop` is asked for."""
    start_ros(words)
    heart = made_heartbeat()
    node = make()
    # What is there now stays: searching it for garbage would stop the loop for tens of ms.
    gc.collect()
    gc.freeze()
    executor = make_executor()
    executor.add_node(node)
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    node.create_timer(WAKE_PERIOD, heart.beat, clock=steady)
    try:
        while not stop.asked:
            executor.spin_once(timeout_sec=WAKE_PERIOD)
        node.close()
    finally:
        executor.shutdown()
        node.destroy_node()


def _first_line(error: Exception) -> str:
    """The first line of an exception's text."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]
