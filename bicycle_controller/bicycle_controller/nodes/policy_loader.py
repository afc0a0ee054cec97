"""Load a policy, or compute a fallback, outside the control loop."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Iterator

from bicycle_msgs.srv import LoadPolicy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from bicycle_common.nodes import topics
from bicycle_controller.control.controller import Controller
from bicycle_controller.policy.policy import PolicyError, load_controller

Loaded = Controller | Exception | None
"""Result of a thread, or the reason of its failure."""

LAST_LOAD = 1.0
"""Longest wait at the end for a load in progress (s)."""


class Making:
    """Controllers computed in their own threads; the loop's thread collects the finished ones."""

    def __init__(self) -> None:
        self._ready: queue.SimpleQueue[Loaded] = queue.SimpleQueue()

    def begin(self, make: Callable[[], Controller | None]) -> None:
        """Compute one in a thread; a failure is returned as its exception."""

        def work() -> None:
            try:
                self._ready.put(make())
            except (ValueError, ArithmeticError, TypeError) as error:
                self._ready.put(error)

        threading.Thread(target=work, daemon=True).start()

    def ready(self) -> Iterator[Loaded]:
        """Yield all that are ready and not yet collected."""
        while not self._ready.empty():
            yield self._ready.get()


class PolicyLoader:
    """Serves `bicycle/load_policy` on its own node and thread, so that the loop does not wait."""

    def __init__(
        self, node: Node, present: Callable[[], str], swap: Callable[[Controller], str]
    ) -> None:
        """Start to serve.

        Args:
            node: the loop's node.
            present: returns the id of the active policy.
            swap: activates a policy and returns a warning; called in the loader's thread.
        """
        self._present, self._swap = present, swap
        self._node = Node(
            f"{node.get_name()}_loader",
            namespace=node.get_namespace(),
            use_global_arguments=False,
            start_parameter_services=False,
        )
        name = node.resolve_service_name(topics.LOAD_POLICY.name)
        self._node.create_service(topics.LOAD_POLICY.type, name, self._on_load)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._serve, name="loader", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    def close(self) -> None:
        """Stop serving; wait briefly for a load in progress."""
        self._executor.shutdown(timeout_sec=LAST_LOAD)
        self._thread.join(LAST_LOAD)
        self._node.destroy_node()

    def _on_load(
        self, request: LoadPolicy.Request, response: LoadPolicy.Response
    ) -> LoadPolicy.Response:
        try:
            policy = load(request.path)
            warning = self._swap(policy)
            response.success, response.message = True, f"{policy.policy_id} is in charge"
            if warning:
                response.message += f"; {warning}"
        except PolicyError as error:
            kept = self._present()
            response.success, response.message = False, f"{error}; {kept} stays in charge"
        response.policy = self._present()
        self._node.get_logger().info(response.message)
        return response


def load(name: str) -> Controller:
    """Load a controller by its name or its file.

    Raises:
        PolicyError: one line with the remedy, for every failure.
    """
    try:
        return load_controller(name, may_import=False)
    except PolicyError:
        raise
    except Exception as error:
        raise PolicyError(f"cannot load policy {name}: {type(error).__name__}: {error}") from None
