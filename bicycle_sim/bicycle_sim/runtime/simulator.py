"""One bicycle, step by step, that a bag's messages restore to the bit.

Signs and symbols are the paper's. A bicycle is a batch of one, stepped by the same plant as the
thousands in training, so a policy meets the same bicycle in both.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from bicycle_common import steer_into_lean
from bicycle_common.types import (
    AppliedCommand,
    BicycleState,
    Command,
    CommandSource,
    InitialPose,
)
from bicycle_common.validation import require
from bicycle_sim.plants import base, registry
from bicycle_sim.plants.base import BodyState, Plant
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.sensors.suite import SensorSuite
from bicycle_sim.task.scenario import Scenario
from bicycle_sim.task.task import BicycleTask

_BODY = tuple(item.name for item in fields(BodyState))
"""Fields of a snapshot of any bicycle."""


class Simulator:
    """One bicycle on one scenario.

    Episodes are counted from 1 and steps from 0. The state of a fallen bicycle does not change,
    but its steps are counted (errata row 25).

    Attributes:
        snapshot: present state.
        applied: input of the step that led to it.
    """

    def __init__(
        self,
        scenario: Scenario,
        plant: Plant[Any] | None = None,
        seed: int = 0,
        sensors: SensorSettings | None = None,
    ) -> None:
        """Make a simulator whose first episode is still to be started by `reset`.

        Args:
            scenario: limits, start speed and fall angle.
            plant: the bicycle; the paper's by default. Actions that it has no use for get a
                limit of zero.
            seed: of the first episode, unless `reset` names another; not negative.
            sensors: on the bicycle; none by default.
        """
        self._sensors = sensors
        self._suite: SensorSuite | None = None
        self._under_way: list[Reading] = []
        self.readings: list[Reading] = []
        """Readings that have arrived since the last step, in the order of the time stamps; at the
        first state of an episode, those of the rest before it."""
        self.plant = plant if plant is not None else registry.default()
        self.scenario = scenario.suited(self.plant.input_names)
        self.seed = _checked_seed(seed) - 1
        self._state: Any
        self._noise: np.random.Generator
        self.snapshot = self._place(InitialPose(0.0, 0.0, 0.0, scenario.start_speed), episode=0)

    @property
    def time_step(self) -> float:
        """s (dt)."""
        return self.plant.time_step

    def reset(self, start: InitialPose | None = None, seed: int | None = None) -> BicycleState:
        """Begin the next episode.

        Args:
            start: where; None draws one from the scenario with this episode's seed.
            seed: of the episode; None takes the one after the last episode's.

        Returns:
            The state at step 0.

        Raises:
            ValueError: on a negative seed or a speed outside the scenario's limits.
        """
        seed = self.seed + 1 if seed is None else _checked_seed(seed)
        start = self._draw(seed) if start is None else start
        limits = self.scenario.speed_limits
        if limits is not None and not limits[0] <= start.speed <= limits[1]:
            raise ValueError(
                f"the start's speed {start.speed:g} m/s is outside the scenario's limits "
                f"{limits[0]:g} to {limits[1]:g} m/s"
            )
        self.seed = seed
        self.snapshot = self._place(start, self.snapshot.episode + 1)
        return self.snapshot

    @classmethod
    def restore(
        cls, snapshot: BicycleState, scenario: Scenario, plant: Plant[Any], seed: int
    ) -> Simulator:
        """Return a simulator that continues from `snapshot` exactly as the original did.

        Args:
            snapshot: any state of an episode, as a message gives it.
            scenario: of that episode.
            plant: of that episode.
            seed: of that episode, so that displacement noise goes on where it was.

        Raises:
            ValueError: when the snapshot holds no state of that plant.
        """
        simulator = cls(scenario, plant, seed)
        simulator.seed = seed
        simulator.snapshot = snapshot
        if plant.body_is_all:
            simulator._state = plant.state_type(
                **{name: np.array([getattr(snapshot, name)]) for name in _BODY}
            )
        else:
            simulator._state = base.from_array(plant.state_type, np.array([snapshot.plant_state]))
        simulator._noise = _noise(seed, snapshot.step)
        return simulator

    def step(self, command: Command | None, push: float = 0.0) -> BicycleState:
        """Make a time step, with or without a command (see `Scenario.silence_gain`).

        Args:
            command: newest valid one; applied as it is, so check it with `CommandValidator` first.
            push: rad/s added to the lean rate before the step (`push.PushGate` checks it).

        Returns:
            The state dt later.
        """
        before = self.snapshot
        if not before.fallen:
            torque, displacement, pedal = command.action if command else self._unbidden()
            spread = self.plant.displacement_noise
            if spread > 0:
                displacement += spread * (2.0 * float(self._noise.random()) - 1.0)
            begun = self._state
            if push:
                begun = self.plant.pushed(begun, push)
            inputs = np.array([torque]), np.array([displacement]), np.array([pedal])
            limits = self.scenario.speed_limits
            if self._suite is None:
                self._state = self.plant.step(begun, *inputs, limits)
            else:
                trace = self.plant.trace(begun, *inputs, limits)
                self._state = trace[-1]
                self._measure(self._suite.advance(trace, self.time_step, inputs[0]))
        elif self._suite is not None:
            self._measure(self._suite.advance([self._state], self.time_step))
        self.applied = AppliedCommand(_source(command, before.step), command)
        self.snapshot = self._observe(before.episode, before.step + 1)
        return self.snapshot

    def _unbidden(self) -> tuple[float, float, float]:
        """Torque, displacement and pedal force of a step without a command."""
        gain, before = self.scenario.silence_gain, self.snapshot
        if gain == 0.0:
            return 0.0, 0.0, 0.0
        limit = self.scenario.torque_limit
        torque = steer_into_lean.torque(before.lean_rate, before.speed, limit, gain)
        return float(torque), 0.0, 0.0

    def _observe(self, episode: int, step: int) -> BicycleState:
        """Return the present state as plain numbers."""
        state = self._state
        numbers: dict[str, Any] = {name: float(getattr(state, name)[0]) for name in _BODY}
        lies = self.plant.fallen(state, self.scenario.fall_angle)[0]
        inner = () if self.plant.body_is_all else tuple(base.to_array(state)[0].tolist())
        return BicycleState(
            episode=episode,
            step=step,
            **numbers,
            fallen=bool(lies),
            plant_state=inner,
            yaw_rate=float(self.plant.yaw_rate(state)[0]),
            pitch=float(self.plant.pitch(state)[0]),
        )

    def _place(self, start: InitialPose, episode: int) -> BicycleState:
        """Put the bicycle at `start`."""
        where = (np.array([start.x]), np.array([start.y]), np.array([start.heading]))
        self._state = self.plant.initial(*where, np.array([start.speed]))
        self._noise = _noise(self.seed)
        self.applied = AppliedCommand()
        if self._sensors is not None:
            self._suite = SensorSuite(self._sensors, self.plant, 1, max(self.seed, 0))
            self._under_way = []
            self._measure(self._suite.rest(self._state))
        return self._observe(episode, 0)

    @property
    def sensor_time(self) -> float:
        """s of the sensors' clock in this episode; its rest is before the first step."""
        return 0.0 if self._suite is None else self._suite.time

    def _measure(self, measured: list[Reading]) -> None:
        """Take readings; return those that have arrived."""
        now = self.sensor_time + 1e-9
        self._under_way += [reading for reading in measured if not reading.lost[0]]
        self.readings = [one for one in self._under_way if one.arrival[0] <= now]
        self._under_way = [one for one in self._under_way if one.arrival[0] > now]

    def _draw(self, seed: int) -> InitialPose:
        """A start of the scenario's distribution, as the task draws it."""
        drawn = BicycleTask(self.scenario, self.plant, rng=np.random.default_rng([seed, 1]))
        state = drawn.state
        return InitialPose(
            x=float(state.rear_x[0]),
            y=float(state.rear_y[0]),
            heading=float(state.heading[0]),
            speed=self.scenario.start_speed,
        )


def _source(command: Command | None, step: int) -> CommandSource:
    """Return the source of the input of the step after `step`."""
    if command is None:
        return CommandSource.ZERO
    return CommandSource.FRESH if command.step == step else CommandSource.HELD


def _checked_seed(seed: int) -> int:
    """Return the seed.

    Raises:
        ValueError: when it is negative.
    """
    require(seed >= 0, f"a seed must be zero or more, not {seed}")
    return seed


def _noise(seed: int, drawn: int = 0) -> np.random.Generator:
    """Return the source of displacement noise, advanced by so many draws, one a step."""
    bits = np.random.PCG64([max(seed, 0), 0])
    bits.advance(drawn)
    return np.random.Generator(bits)
