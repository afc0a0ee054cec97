"""A single service call by a tool."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bicycle_common.nodes.runner import start_tool
from bicycle_common.nodes.topics import Service
from bicycle_common.signals import StopRequest

PATIENCE = 10.0
"""Time for a service to appear, and again for its answer (s)."""
SLICE = 0.05
LYING = 3
"""Exit status of a tool if the bicycle lies, or falls."""
NOBODY = 4
"""Exit status of a tool if nobody offers its service."""


class ToolError(Exception):
    """Failure of a tool; the text is one line with the remedy.

    Args:
        status: exit status.
        text: the line.
    """

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


class Caller:
    """Hidden node that calls services."""

    def __init__(self, name: str) -> None:
        self.stop = StopRequest().listen()
        self.node: Node = rclpy.create_node(
            name, start_parameter_services=False, enable_rosout=False
        )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def spin_until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until a condition holds or the time is over; return True if it held.

        Raises:
            ToolError: on a signal.
        """
        deadline = time.monotonic() + seconds
        while not condition():
            if self.stop.requested:
                raise ToolError(130, "interrupted")
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=SLICE)
        return True

    def call(self, service: Service, request: Any, patience: float, remedy: str) -> Any:
        """Call a service and return its answer.

        Args:
            service: its name and type.
            request: of that type.
            patience: s to wait for the service, and again for its answer.
            remedy: advice if nobody offers it.

        Raises:
            ToolError: if nobody offers it or answers, and on a signal.
        """
        client = self.node.create_client(service.type, service.name)
        name = client.service_name
        if not self.spin_until(client.service_is_ready, patience):
            raise ToolError(NOBODY, f"nobody offers {name} within {patience:g} s: {remedy}")
        future = client.call_async(request)
        if not self.spin_until(future.done, patience):
            raise ToolError(NOBODY, f"no answer of {name} within {patience:g} s: {remedy}")
        return future.result()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()


def run_tool(name: str, ros: Sequence[str], act: Callable[[Caller], int]) -> int:
    """Run a tool that calls services.

    Args:
        name: of the script, in front of error lines.
        ros: ROS arguments.
        act: does the work; returns the exit status.

    Returns:
        The exit status.
    """
    start_tool(name, ros)
    caller = Caller(f"_bicycle_{name.partition('.')[0]}")
    try:
        return act(caller)
    except ToolError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.status
    finally:
        caller.close()
        rclpy.try_shutdown()
