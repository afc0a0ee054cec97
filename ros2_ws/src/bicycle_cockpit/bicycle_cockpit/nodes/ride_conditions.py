"""The conditions of the ride that goes on: what was asked for, over what the simulator has."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from bicycle_cockpit import ride_setup
from bicycle_cockpit.ride_setup import RideSetup
from bicycle_sim.nodes.sim_settings import NAME as SIMULATOR


class StartedRide(Protocol):
    """Simulator and controller, where the cockpit started them."""

    @property
    def ours(self) -> bool:
        """True if it did."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Their `NODE.name:=value`."""

    def keep(self, words: tuple[str, ...]) -> None:
        """Use other parameters from the next start on."""

    def restart(self, words: tuple[str, ...]) -> bool:
        """Start them again with other parameters; False if that is going on already."""


class RideConditions:
    """Asks the simulator for its parameters, which its files and command line have set.

    Args:
        node: to ask through.
        ride: simulator and controller.
    """

    def __init__(self, node: Node, ride: StartedRide) -> None:
        self._ride = ride
        self._client = AsyncParameterClient(node, SIMULATOR)
        self._told: dict[str, Any] = {}
        self._due = False

    @property
    def setup(self) -> RideSetup:
        """Return the conditions, as far as pages may choose them."""
        return ride_setup.of_parameters(self._ride.parameters, self._told)

    def facts(self) -> dict[str, Any]:
        """Return the conditions for the pages, and the bicycle's file that they do not offer."""
        own = ride_setup.own_bicycle(self._ride.parameters, self._told)
        return {**asdict(self.setup), "own_bicycle": own}

    def episode_began(self) -> None:
        """Ask again soon: it may be another simulator than before."""
        self._due = True

    def look(self) -> None:
        """Ask if it is due, and the simulator's services are found."""
        if self._due and self._client.services_are_ready():
            self._due = False
            names = [name.partition(".")[2] for name in ride_setup.NAMES]
            self._client.get_parameters(names, self._take)

    def _take(self, answered: Future) -> None:
        result = answered.result()
        if result is None:
            return
        values = map(parameter_value_to_python, result.values)
        pairs = zip(ride_setup.NAMES, values, strict=False)  # another program knows fewer
        self._told = {name: value for name, value in pairs if value is not None}
