"""Start, spin and stop a node: clean exit on signals, one line for a user's mistake."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
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
from bicycle_common.nodes.log_lines import bound_log_lines
from bicycle_common.ros_names import wrong_rule
from bicycle_common.signals import StopRequest
from bicycle_common.validation import one_line

WAKE_PERIOD = 0.1
"""Longest delay until a signal is noticed (s): the executor sleeps in C code."""

LOOP_EXECUTOR: Callable[[], Executor] = EventsExecutor or SingleThreadedExecutor
"""Executor of the control loop's nodes; it uses less than half the default one's processor time.

In Jazzy it supports neither guard conditions nor coroutine callbacks, and it spins at full
speed when told to wait without a limit. Jazzy before rclpy 7.1.4 does not have it.
"""


class UserError(Exception):
    """A user's mistake; its text is one line with the remedy."""

    def __init__(self, text: str = "") -> None:
        super().__init__(one_line(text))


class Closing(Protocol):
    """Node that has work to do at shutdown, while its topics still work."""

    def close(self) -> None:
        """Publish or save the rest."""


def run(
    name: str,
    make: Callable[[], Any],
    usage: str = "",
    args: Sequence[str] | None = None,
    executor: Callable[[], Executor] = SingleThreadedExecutor,
) -> int:
    """Run one node until a signal, on one thread.

    Args:
        name: the program's name, printed in front of error lines.
        make: creates the node; it may raise UserError.
        usage: printed by `--help`.
        args: command line with the program's name; the process's own by default.
        executor: creates the executor that calls the node's callbacks.

    Returns:
        The exit status: 0 after SIGINT, SIGTERM or `--help`, 2 for a user's mistake.
    """
    words = list(sys.argv if args is None else args)
    stop = StopRequest()
    try:
        if not _understood(words, usage):
            return 0
        stop.listen()
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
        UserError: on arguments or an environment that ROS rejects, or if DDS security is
            requested but missing in the middleware.
    """
    refusal = dds_security.refusal()
    if refusal:
        raise UserError(refusal)
    _check_names(words)
    bound_log_lines()
    try:
        rclpy.init(args=list(words), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        raise UserError(
            f"cannot start ROS ({_first_line(error)}): check --ros-args and the ROS_ variables"
        ) from None


def made_heartbeat() -> Heartbeat:
    """Create the node's heartbeat.

    Raises:
        UserError: if its file cannot be written.
    """
    try:
        return Heartbeat()
    except OSError as error:
        raise UserError(
            f"cannot write {error.filename} ({error.strerror}): set {VARIABLE} to a file that can "
            "be, or unset it"
        ) from None


def start_tool(name: str, words: Sequence[str] = ()) -> None:
    """Start rclpy for a tool; on failure end the program with status 2 and one line.

    Args:
        name: printed in front of that line.
        words: ROS arguments, such as a namespace.
    """
    try:
        start_ros(words)
    except UserError as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        raise SystemExit(2) from None


def without_ros(words: Sequence[str]) -> list[str]:
    """Return the words of a command line (program name first) that are not ROS arguments.

    Raises:
        UserError: if ROS cannot parse them.
    """
    _check_parameter_files(words)
    _check_names(words)
    try:
        return list(remove_ros_args(list(words))[1:])
    except Exception as error:
        raise UserError(f"cannot read the ROS arguments: {_first_line(error)}") from None


def resolved_topic(node: Any, name: str) -> str:
    """Return a topic's full name.

    Raises:
        UserError: if ROS allows no such name.
    """
    return _resolved(node.resolve_topic_name, name, "topic")


def resolved_service(node: Any, name: str) -> str:
    """Return a service's full name.

    Raises:
        UserError: if ROS allows no such name.
    """
    return _resolved(node.resolve_service_name, name, "service")


def _resolved(resolve: Callable[[str], str], name: str, kind: str) -> str:
    try:
        return str(resolve(name))
    except Exception as error:  # rclpy has two classes for it
        words = _first_line(error).rpartition("failed to resolve name: ")[2].partition(", at ")[0]
        words = words.replace("topic name", "name")
        raise UserError(f"{name[:80]!r} is no name of a {kind}: {words}") from None


def _check_names(words: Sequence[str]) -> None:
    """Refuse a namespace or a node's name that ROS refuses.

    Raises:
        UserError: on one.
    """
    if wrong := wrong_rule(words):
        raise UserError(wrong)


def _check_parameter_files(words: Sequence[str]) -> None:
    """Refuse a parameter file on which rcl's YAML parser would spend minutes and all memory.

    Raises:
        UserError: if a parameter file exceeds the bounds of `yaml_text`.
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
            pass  # rcl reports it


def _understood(words: list[str], usage: str) -> bool:
    """Return True to continue, False after `--help`.

    Raises:
        UserError: on an unknown word.
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
    stop: StopRequest,
) -> None:
    """Create the node and spin it until `stop` is set."""
    start_ros(words)
    heart = made_heartbeat()
    node = make()
    # Freeze the start-up objects: a full collection would block the loop for tens of ms.
    gc.collect()
    gc.freeze()
    executor = make_executor()
    executor.add_node(node)
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    node.create_timer(WAKE_PERIOD, heart.beat, clock=steady)
    try:
        while not stop.requested:
            executor.spin_once(timeout_sec=WAKE_PERIOD)
        node.close()
    finally:
        executor.shutdown()
        node.destroy_node()


def _first_line(error: Exception) -> str:
    """Return the first line of an exception's text."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]
