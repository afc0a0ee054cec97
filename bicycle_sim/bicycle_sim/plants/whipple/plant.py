"""The Whipple-Carvallo bicycle as a plant."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from bicycle_sim.plants.base import (
    Array,
    BodyState,
    Geometry,
    Linear,
    Loads,
    Plant,
    SteadyLean,
    SteadyTorque,
)
from bicycle_sim.plants.whipple import (
    integrate,
    native,
    parameters,
    plain_parameters,
    state_space,
    steady,
)
from bicycle_sim.plants.whipple.constants import (
    UNLIMITED,
    Constants,
    constants,
    delay_steps,
    table,
)
from bicycle_sim.plants.whipple.integrate import Inputs
from bicycle_sim.plants.whipple.kinematics import front_height, rolling
from bicycle_sim.plants.whipple.parameters import Parameters


@dataclass
class WhippleState(BodyState):
    """N Whipple bicycles; arrays of shape (N,) but for the last."""

    pitch: np.ndarray
    """rad, nose up; zero on an upright bicycle with straight steering."""
    yaw_rate: np.ndarray
    """rad/s."""
    rear_wheel_angle: np.ndarray
    """rad, against the rear frame, growing forward."""
    front_wheel_angle: np.ndarray
    """rad, against the front frame, growing forward."""
    rider_lean: np.ndarray
    """rad, against the rear frame; zero without a leaning rider."""
    rider_rate: np.ndarray
    """rad/s."""
    motor_torque: np.ndarray
    """N m on the steering now."""
    stopped: np.ndarray
    """1 where the bicycle lies or its geometry is singular, so that it moves no more; else 0."""
    commands: np.ndarray = field(metadata={"wide": True})
    """(N, 3 k), the last k commands that have not come to rule yet: torque, displacement and
    pedal force of the last step, of the one before it and so on."""


class WhipplePlant(Plant[WhippleState]):
    """N Whipple bicycles, all alike or each with parameters of its own."""

    name = "whipple"
    about = "Whipple-Carvallo model of a measured bicycle"
    takes_bicycle = True
    state_type = WhippleState

    def __init__(self, p: Parameters, compiled: bool = True) -> None:
        """Prepare the constants.

        Args:
            p: the parameters.
            compiled: True if `whipple.cpp` steps it, where it was built; numpy gives the same.
        """
        self.parameters = p
        self._count = p.count
        self.constants: Constants = constants(p)
        self._table = table(self.constants, self._count)
        self._delay = np.asarray(delay_steps(p)[0])
        self._memory = int(np.max(self._delay + (np.asarray(self.constants.delay_share) > 0.0)))
        self._library = native.load() if compiled else None
        air, road = p.resistance, p.road
        outside = (air.drag_area, air.side_area, air.rolling, road.grade_x, road.grade_y)
        none = dict.fromkeys(Inputs._fields, np.zeros(1))
        none["wind_x"], none["wind_y"] = np.atleast_1d(road.wind_x), np.atleast_1d(road.wind_y)
        self._idle = Inputs(**none)
        self._extras = bool(np.any([np.any(value) for value in outside]))
        self._tables: dict[float, steady.TurnTable] = {}

    @property
    def time_step(self) -> float:
        """s of one control period."""
        return self.parameters.time_step

    @property
    def count(self) -> int | None:
        """Number of different bicycles; None if all are alike."""
        return self._count

    @property
    def input_names(self) -> tuple[str, ...]:
        """Displacement only with a leaning rider."""
        if self.parameters.rider is None:
            return "torque", "pedal_force"
        return "torque", "displacement", "pedal_force"

    @property
    def pedal_gear(self) -> float:
        """Force at the rear wheel's rim per pedal force; the largest of many bicycles."""
        return float(np.max(self.parameters.drive.gear))

    @property
    def steer_friction(self) -> Array:
        """N m of Coulomb friction of the steering; a higher stiction is not in it."""
        return self.parameters.steering.friction

    @property
    def substeps(self) -> int:
        """Number of integration steps in a control period."""
        return self.parameters.substeps

    def with_time_step(self, time_step: float, substeps: int) -> WhipplePlant:
        """Return the plant whose control period is `time_step`, s, integrated in `substeps`."""
        return type(self)(replace(self.parameters, time_step=time_step, substeps=substeps))

    def with_actuation(
        self, delay: float, limit: float, lag: float, step: float, friction: float
    ) -> WhipplePlant:
        """Return the plant with a delay, a motor and friction; see `Plant.with_actuation`."""
        p = self.parameters
        return type(self)(
            replace(
                p,
                delay=delay,
                motor=replace(p.motor, limit=limit, lag=lag, step=step),
                steering=replace(p.steering, friction=friction, stiction=friction),
            )
        )

    @property
    def label(self) -> str:
        """The plant and the bicycle's name."""
        return f"{self.name} {self.parameters.name}".strip()

    @property
    def geometry(self) -> Geometry:
        """Geometry of the bicycle, or of the first of many; masses include a leaning rider's."""
        b, rider = self.parameters.bicycle, self.parameters.rider
        mass, forward, height = b.mass, b.mass_forward, b.mass_height
        if rider is not None:
            total = mass + rider.mG
            forward = (mass * forward + rider.mG * rider.xG) / total
            height = (mass * height - rider.mG * rider.zG) / total
            mass = total
        stop = self.parameters.steering.stop
        values = (b.w, b.c, b.lam, b.rR, b.rF, mass, forward, height, height, stop)
        return Geometry(*(float(np.ravel(value)[0]) for value in values))

    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> WhippleState:
        """N upright bicycles with straight handlebars; arguments of shape (N,), m, rad, m/s."""
        count = len(rear_x)
        state = np.zeros((len(integrate.ROWS), count))
        for name, values in (
            ("rear_x", rear_x),
            ("rear_y", rear_y),
            ("heading", heading),
            ("speed", speed),
        ):
            state[integrate.ROWS.index(name)] = values
        zero = np.zeros(count)
        self._advance(state, self._idle, 0, 0, False)
        return self._state(state, zero, np.zeros((count, 3 * self._memory)))

    def step(
        self,
        state: WhippleState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> WhippleState:
        """Step by one control period; see `Plant.step`."""
        inputs, commands = self._commanded(
            state, torque, displacement, pedal_force, speed_limits, loads
        )
        rows = self._rows(state)
        before, rate = rows[_STOPPED] != 0.0, rows[_LEAN_RATE].copy()
        self._advance(rows, inputs, 0, self.parameters.substeps, loads is not None)
        up = (rows[_LEAN_RATE] - rate) / self.time_step
        return self._state(rows, np.where(before, state.lean_acceleration, up), commands)

    def trace(
        self,
        state: WhippleState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> list[WhippleState]:
        """Return the states after each substep; the last is that of `step`, to the bit."""
        inputs, commands = self._commanded(
            state, torque, displacement, pedal_force, speed_limits, loads
        )
        rows = self._rows(state)
        before, rate = rows[_STOPPED] != 0.0, rows[_LEAN_RATE].copy()
        states = []
        substeps = self.parameters.substeps
        for index in range(substeps):
            self._advance(rows, inputs, index, index + 1, loads is not None)
            up = (rows[_LEAN_RATE] - rate) / (self.time_step * ((index + 1) / substeps))
            up = np.where(before, state.lean_acceleration, up)
            states.append(self._state(rows.copy(), up, commands))
        return states

    def pushed(self, state: WhippleState, lean_rate: Array) -> WhippleState:
        """Return the state after a push that adds `lean_rate`, rad/s, float or (N,)."""
        up = np.where(state.stopped == 0.0, lean_rate, 0.0)
        return self.settled(replace(state, lean_rate=state.lean_rate + up))

    def settled(self, state: WhippleState) -> WhippleState:
        """Return the state with the pitch and the yaw rate of its lean, steering and rates."""
        rows = self._rows(state)
        self._advance(rows, self._idle, 0, 0, False)
        return self._state(rows, state.lean_acceleration, state.commands)

    def yaw_rate(self, state: WhippleState) -> np.ndarray:
        """Return the yaw rate (N,), rad/s."""
        return state.yaw_rate

    def pitch(self, state: WhippleState) -> np.ndarray:
        """Return the pitch of the rear frame, (N,) rad, positive with the nose up."""
        return state.pitch

    def pitch_on_road(self, lean: np.ndarray, steer: np.ndarray) -> np.ndarray:
        """Return the pitch that puts both wheels on the road, by Newton's method."""
        pitch = np.zeros(len(lean))
        for _ in range(6):
            r = rolling(self.constants, lean, pitch, steer)
            pitch = pitch - front_height(self.constants, r) / r.pitch_lever
        return pitch

    def fallen(self, state: WhippleState, limit: float) -> np.ndarray:
        """Return True (N,) for a lean of more than `limit`, rad, or a stop for good."""
        leans: np.ndarray = np.abs(state.lean_angle) > limit
        return leans | (state.stopped != 0.0)

    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        """About riding straight at a speed, m/s; see `state_space.model`."""
        return state_space.model(self.parameters, speed, discrete)

    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the lean (N,), rad, at which a steady turn is balanced; see `steady.lean`."""
        return steady.lean(self.constants, steer_angle, speed)

    def steady_lean_law(self, steer_limit: float) -> SteadyLean:
        """Return a table of `steady_lean`, within 1e-3 rad of it, for bicycles that are alike."""
        if self._count is not None:
            return self.steady_lean
        return self._turns(steer_limit).lean

    def steady_torque_law(self, steer_limit: float) -> SteadyTorque:
        """Return a table of the torques that hold steady turns; see `steady.turn`."""
        if self._count is not None:
            return lambda steer, speed: steady.turn(self.constants, steer, speed).steer_torque
        return self._turns(steer_limit).torque

    @property
    def torque_limit(self) -> float | None:
        """N m of the motor, the smallest of many; None if it has no limit."""
        limits = np.ravel(self.parameters.motor.limit)
        limits = limits[limits > 0.0]
        return float(limits.min()) if limits.size else None

    def _turns(self, steer_limit: float) -> steady.TurnTable:
        if steer_limit not in self._tables:
            self._tables[steer_limit] = steady.TurnTable(self.constants, steer_limit)
        return self._tables[steer_limit]

    def take(self, mask: np.ndarray) -> WhipplePlant:
        """Return the plant of those bicycles that `mask` (N,) keeps."""
        if self._count is None:
            return self
        return WhipplePlant(parameters.take(self.parameters, mask), self._library is not None)

    def to_json(self) -> str:
        """Return all parameters to the last bit, with the key `plant`."""
        return json.dumps({"plant": self.name, **plain_parameters.to_dict(self.parameters)})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> WhipplePlant:
        """Return the content of `to_json` as plain data.

        Raises:
            ValueError: on an unknown or missing key, or on a value that makes no sense.
        """
        return cls(plain_parameters.from_dict({k: v for k, v in data.items() if k != "plant"}))

    def _rows(self, state: WhippleState) -> np.ndarray:
        """Return a copy of the integrated rows, (rows, N)."""
        return np.array([getattr(state, name) for name in integrate.ROWS], dtype=float)

    def _state(
        self, rows: np.ndarray, lean_acceleration: np.ndarray, commands: np.ndarray
    ) -> WhippleState:
        found = dict(zip(integrate.ROWS, rows, strict=True))
        found.update(lean_acceleration=lean_acceleration, commands=commands)
        return WhippleState(**{item.name: found[item.name] for item in fields(WhippleState)})

    def _commanded(
        self,
        state: WhippleState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None,
        loads: Loads | None,
    ) -> tuple[Inputs, np.ndarray]:
        """Return the inputs of a period, and the commands that wait after it."""
        count = len(state.lean_angle)
        if self._count is not None and count != self._count:
            raise ValueError(f"the plant has {self._count} bicycles, the state {count}")
        if self.parameters.rider is None and np.any(displacement):
            raise ValueError(
                "this bicycle has no leaning rider: its displacement must be zero, or choose "
                "one with a rider who leans"
            )
        wait = state.commands
        torque = self.parameters.motor.rounded(torque)
        new = before = torque, displacement, pedal_force
        if self._memory:
            # The newest command first; each bicycle takes the one that is as old as its delay.
            queue = np.concatenate([np.stack(new), wait.T]).reshape(-1, 3, count)
            age, lane = np.broadcast_to(self._delay, count), np.arange(count)
            new = tuple(queue[age, :, lane].T)
            before = tuple(queue[np.minimum(age + 1, self._memory), :, lane].T)
            wait = np.ascontiguousarray(queue[:-1].reshape(-1, count).T)
        low, high = speed_limits if speed_limits is not None else (-UNLIMITED, UNLIMITED)
        changed = {} if loads is None else self._loads(loads)
        return self._idle._replace(
            torque_before=before[0],
            torque=new[0],
            displacement_before=before[1],
            displacement=new[1],
            pedal_before=before[2],
            pedal=new[2],
            speed_low=np.atleast_1d(low),
            speed_high=np.atleast_1d(high),
            **changed,
        ), wait

    def _loads(self, loads: Loads) -> dict[str, np.ndarray]:
        """Return pushes and gusts as inputs."""
        road = self.parameters.road
        down = self.parameters.bicycle.rR - loads.force_height
        found = {
            "force_across": loads.lateral_force,
            "torque_x": loads.roll_torque - down * loads.lateral_force,
            "torque_z": loads.force_forward * loads.lateral_force,
            "wind_x": road.wind_x + loads.wind_x,
            "wind_y": road.wind_y + loads.wind_y,
        }
        return {name: np.atleast_1d(value) for name, value in found.items()}

    def _advance(
        self, rows: np.ndarray, inputs: Inputs, first: int, last: int, loaded: bool
    ) -> None:
        """Move `rows` (rows, N) in place."""
        p = self.parameters
        extras, rider = self._extras or loaded, p.rider is not None
        span = p.substeps, p.time_step, first, last, extras or rider, rider
        if self._library is not None:
            self._library.advance(self._table, rows, inputs, *span)
            return
        single = rows.shape[1] == 1
        pick = (lambda row: float(row[0])) if single else np.asarray
        moved = integrate.advance(
            Constants(*map(pick, self._table)),
            dict(zip(integrate.ROWS, map(pick, rows), strict=True)),
            Inputs(*map(pick, inputs)),
            *span,
            xp=integrate.FLOATS if single else np,
        )
        for row, name in zip(rows, integrate.ROWS, strict=True):
            row[:] = moved[name]


_LEAN_RATE, _STOPPED = integrate.ROWS.index("lean_rate"), integrate.ROWS.index("stopped")
