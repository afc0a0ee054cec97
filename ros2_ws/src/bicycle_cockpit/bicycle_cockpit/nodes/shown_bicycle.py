"""The bicycle that the pages show and steer, by a node in its namespace."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node

from bicycle_cockpit.nodes.hearing import Hearing, Tell
from bicycle_cockpit.nodes.recording import RecorderProcess
from bicycle_cockpit.nodes.request_handler import RequestHandler
from bicycle_cockpit.nodes.ride_conditions import RideConditions, StartedRide
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.ride_state import RideState
from bicycle_cockpit.trouble import Trouble
from bicycle_common.nodes import topics

NAME = "bicycle_cockpit_view"


class NotOurs:
    """The ride of a bicycle that the cockpit did not start."""

    ours = False
    parameters: tuple[str, ...] = ()

    def keep(self, words: tuple[str, ...]) -> None:
        """Change nothing: the next start is not the cockpit's."""

    def restart(self, words: tuple[str, ...]) -> bool:
        """Return False: nothing can be started again."""
        return False


class ShownBicycle:
    """One bicycle: what is heard of it and asked of it; belongs to the executor's thread.

    Args:
        namespace: of the bicycle, `/` for one without.
        choices: controllers that can be chosen.
        recording: recorder that pages can start.
        ride: its simulator and controller; `NotOurs` where others started them.
        tell: reports events to the pages.
        newest: sends the pages data that replace older data of their `type`.
        rules: ROS arguments of the cockpit but the namespace's.

    Attributes:
        node: in the bicycle's namespace, for the executor.
    """

    def __init__(
        self,
        namespace: str,
        choices: PolicyCatalogue,
        recording: RecorderProcess,
        ride: StartedRide,
        tell: Tell,
        newest: Callable[[dict[str, Any]], None],
        rules: Sequence[str] = (),
    ) -> None:
        self.namespace, self.ride = namespace, ride
        # The process's own arguments may name another namespace, which would hold for all nodes.
        self.node = Node(
            NAME, namespace=namespace, cli_args=list(rules), use_global_arguments=False
        )
        self.live = RideState()
        self.trouble = Trouble(ride.ours)
        self.conditions = RideConditions(self.node, ride)
        self.asking = RequestHandler(
            self.node, self.live, choices, recording, ride, self.conditions, tell
        )
        self.hearing = Hearing(self.node, self.live, self.trouble, tell, newest)
        episode = topics.EPISODE
        topics.listen(self.node, episode, lambda message: self.conditions.episode_began())

    @property
    def controllers(self) -> int:
        """Return the number of controllers that command it."""
        return int(self.node.count_publishers(topics.COMMAND.name))

    def close(self) -> None:
        """Leave the graph."""
        self.asking.close()
        self.node.destroy_node()
