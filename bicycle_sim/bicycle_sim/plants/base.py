"""Interface of a plant: any bicycle for the task, the simulator and the controllers.

A plant moves N bicycles at once, in pure numpy or compiled code, without ROS. All signs are the
paper's: lean and steering are positive to the left, the heading is counter-clockwise from +y.
"""

from __future__ import annotations

import ctypes
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

Array = Any
"""A float or an array of shape (N,)."""

FALL_ANGLE = math.pi / 6
"""Lean beyond which a bicycle has fallen, rad (eq. 20)."""

SteadyLean = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(N,) rad of lean from (N,) rad of steering and (N,) m/s."""
SteadyTorque = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(N,) N m on the handlebar from (N,) rad of steering and (N,) m/s."""


@dataclass
class BodyState:
    """State that every plant has of N bicycles; arrays of shape (N,), double precision.

    A plant's own state adds fields. A bit-exact restart needs all fields together. The last field
    may be (N, k); every other one is (N,).
    """

    lean_angle: np.ndarray
    """rad."""
    lean_rate: np.ndarray
    """rad/s."""
    lean_acceleration: np.ndarray
    """rad/s^2, the mean over the preceding control period."""
    steer_angle: np.ndarray
    """rad, of the front frame about the steering axis."""
    steer_rate: np.ndarray
    """rad/s."""
    heading: np.ndarray
    """rad in (-pi, pi], of the rear wheel."""
    front_x: np.ndarray
    """m, front contact."""
    front_y: np.ndarray
    """m, front contact."""
    rear_x: np.ndarray
    """m, rear contact."""
    rear_y: np.ndarray
    """m, rear contact."""
    speed: np.ndarray
    """m/s of the rear contact along the heading."""


State = TypeVar("State", bound=BodyState)


@dataclass(frozen=True)
class Loads:
    """External loads on the bicycles during one control period; floats or (N,)."""

    lateral_force: Array = 0.0
    """Force on the rear frame, N, positive to the left."""
    force_height: Array = 0.9
    """Height of that force's point of action above the ground, m."""
    force_forward: Array = 0.4
    """Distance of that point in front of the rear contact, m."""
    roll_torque: Array = 0.0
    """Torque on the rear frame, N m, positive to the left."""
    wind_x: Array = 0.0
    """Wind towards +x, m/s, added to the plant's steady wind."""
    wind_y: Array = 0.0
    """Wind towards +y, m/s, added to the plant's steady wind."""


@dataclass(frozen=True)
class Linear:
    """A plant linearised about riding straight and upright at one speed."""

    states: tuple[str, ...]
    """Names of the n states; `heading_error` is psi_g of a distant goal."""
    inputs: tuple[str, ...]
    """Names of the m inputs."""
    a: np.ndarray
    """(n, n)."""
    b: np.ndarray
    """(n, m)."""
    time_step: float | None = None
    """Period in s if x[k+1] = a x[k] + b u[k]; None if dx/dt = a x + b u."""


@dataclass(frozen=True)
class Geometry:
    """Dimensions to draw a bicycle and to scale a page; m, kg, rad."""

    wheelbase: float
    trail: float
    steer_axis_tilt: float
    """rad back from the vertical, 90 degrees less the head angle."""
    rear_radius: float
    front_radius: float
    mass: float
    mass_forward: float
    """m from the rear contact to the centre of mass."""
    mass_height: float
    """m above the ground."""
    rider_height: float
    """m above the ground of what is drawn as the rider."""
    steer_stop: float
    """rad, where the handlebar stops."""
    crank_ratio: float = 0.5
    """Turns of the crank per turn of the rear wheel."""

    @property
    def has_rider(self) -> bool:
        """True if the mass includes a person's.

        Measured bicycles have up to 35 kg without a rider, and from 75 kg with one.
        """
        return self.mass > 55.0

    @property
    def wheel_turns(self) -> tuple[float, float, float]:
        """Turns of front wheel, rear wheel and crank, rad per m; zero of a wheel without size."""
        front = 1.0 / self.front_radius if self.front_radius > 0.0 else 0.0
        rear = 1.0 / self.rear_radius if self.rear_radius > 0.0 else 0.0
        return front, rear, self.crank_ratio * rear


class Plant(ABC, Generic[State]):
    """N bicycles with the same equations and one set of parameters, or one set for each."""

    name: ClassVar[str]
    """Kind of plant, `plant` in its JSON."""
    about: ClassVar[str] = ""
    """Kind of plant in words for people."""
    takes_bicycle: ClassVar[bool] = False
    """True if its bicycle is one of those of `catalogue.names` or of a YAML file."""
    takes_displacement_noise: ClassVar[bool] = False
    """True if `with_displacement_noise` takes any spread."""
    state_type: ClassVar[type[BodyState]]
    """Type of the states that `initial` and `step` return."""
    body_is_all: ClassVar[bool] = False
    """True if the numbers of BodyState alone restore a state to the bit, the heading from the
    two contacts."""
    fits_named_tunings: ClassVar[bool] = False
    """True if the LQR's tunings by name were made for this kind, and serve each bicycle of it."""
    safety_envelope: ClassVar[tuple[tuple[float, ...], tuple[float, ...]] | None] = None
    """Measured limit of the safety layer: speeds, m/s, and the largest extrapolated lean at each,
    rad. In between it is interpolated, beyond held. None lets the layer compute one."""

    @property
    @abstractmethod
    def time_step(self) -> float:
        """Duration of one control period, s."""

    @property
    @abstractmethod
    def count(self) -> int | None:
        """Number of different bicycles; None if all are alike, for any N."""

    @property
    @abstractmethod
    def input_names(self) -> tuple[str, ...]:
        """Inputs of `step` that move this bicycle; the others must be zero."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Name of this bicycle among its kind, in a word or two."""

    @property
    @abstractmethod
    def geometry(self) -> Geometry:
        """Geometry of the bicycle, or of the first of many."""

    @property
    def displacement_noise(self) -> float:
        """m, half width of uniform noise on the displacement, added by the caller of `step`."""
        return 0.0

    def with_displacement_noise(self, spread: float) -> Plant[State]:
        """Return the plant whose `displacement_noise` is `spread`, m.

        Raises:
            ValueError: when it takes none.
        """
        if spread == self.displacement_noise:
            return self
        raise ValueError(f"the plant {self.name} takes no displacement noise: leave it at 0")

    @property
    def pedal_gear(self) -> float:
        """Force at the rear wheel's rim per pedal force, of the first of many bicycles."""
        return 1.0

    @property
    def steer_friction(self) -> Array:
        """N m of Coulomb friction of the steering, a float or (N,)."""
        return 0.0

    @property
    def substeps(self) -> int:
        """Number of integration steps in a control period."""
        return 1

    def with_time_step(self, time_step: float, substeps: int) -> Plant[State]:
        """Return the plant whose control period is `time_step`, s, integrated in `substeps`.

        Raises:
            ValueError: when the plant has one period only.
        """
        raise ValueError(
            f"the plant {self.name} steps by {self.time_step:g} s only: choose plant:=whipple"
        )

    def with_actuation(
        self, delay: float, limit: float, lag: float, step: float, friction: float
    ) -> Plant[State]:
        """Return the plant whose commands are late and whose handlebar a real motor turns.

        Args:
            delay: s between a command and its effect.
            limit: N m, largest torque of the motor.
            lag: s, time constant of the motor.
            step: N m, quantum of the motor's torque.
            friction: N m, Coulomb friction and stiction of the steering.

        Raises:
            ValueError: when the plant has no motor.
        """
        raise ValueError(
            "only a Whipple bicycle has a motor and friction: name one with --bicycle"
        )

    def on_device(self, device: str) -> Plant[State]:
        """Return the plant that torch steps on `device`.

        Raises:
            ValueError: when the plant is stepped on the processor only.
        """
        raise ValueError(f"{self.label} is stepped on the processor only: use device=cpu")

    @property
    def compiled_numbers(self) -> ctypes.Structure | None:
        """Numbers for the plant's compiled step, a `Block` of `compiled.h`; None without one."""
        return None

    @abstractmethod
    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> State:
        """Return N upright bicycles with straight handlebars; arguments (N,), m, rad, m/s."""

    @abstractmethod
    def step(
        self,
        state: State,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> State:
        """Simulate one control period of N bicycles.

        Args:
            state: bicycles before the period; not changed.
            torque: (N,) N m requested on the handlebar.
            displacement: (N,) m requested of the centre of mass.
            pedal_force: (N,) N on the pedal; a negative one brakes.
            speed_limits: bounds of the speed, m/s, or None.
            loads: pushes and gusts, or None.

        Returns:
            The bicycles one `time_step` later.

        Raises:
            ValueError: if the plant cannot use a nonzero input, or the number of bicycles differs
                from `count`.
        """

    def trace(
        self,
        state: State,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> list[State]:
        """Return the states at equal intervals within a control period; the last is `step`'s.

        Sensors that sample faster than the controller need them.
        """
        return [self.step(state, torque, displacement, pedal_force, speed_limits, loads)]

    @abstractmethod
    def pushed(self, state: State, lean_rate: Array) -> State:
        """Return the state after a push that adds `lean_rate`, rad/s, float or (N,)."""

    def settled(self, state: State) -> State:
        """Return the state with every dependent field computed from lean, steering and speed.

        For a caller that has set these three: pitch and yaw rate follow from them.
        """
        return state

    @abstractmethod
    def yaw_rate(self, state: State) -> np.ndarray:
        """Return the yaw rate (N,), rad/s, counter-clockwise."""

    def pitch(self, state: State) -> np.ndarray:
        """Return the pitch of the rear frame, (N,) rad, positive with the nose up."""
        return np.zeros(len(state.speed))

    def pitch_on_road(self, lean: np.ndarray, steer: np.ndarray) -> np.ndarray:
        """Return the pitch that puts both wheels on the road, (N,) rad for (N,) rad each."""
        return np.zeros(len(lean))

    @abstractmethod
    def fallen(self, state: State, limit: float) -> np.ndarray:
        """Return (N,) bool: True if it leans by more than `limit`, rad, or cannot be ridden."""

    @abstractmethod
    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        """Linearise about riding straight at `speed`, m/s; as one `step` if `discrete`."""

    @abstractmethod
    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the lean of a balanced steady turn, (N,) rad; arguments (N,), rad and m/s."""

    def steady_lean_law(self, steer_limit: float) -> SteadyLean:
        """Return `steady_lean` for a caller that needs it at every step.

        Args:
            steer_limit: rad, the largest steering that is asked for.
        """
        return self.steady_lean

    def steady_torque_law(self, steer_limit: float) -> SteadyTorque:
        """Return the torque that holds a steady turn, for a caller that needs it at every step.

        Args:
            steer_limit: rad, the largest steering that is asked for.
        """
        return lambda steer_angle, speed: np.zeros(np.shape(steer_angle))

    @property
    def torque_limit(self) -> float | None:
        """Largest steer torque, N m; None if only the task limits it."""
        return None

    @abstractmethod
    def take(self, mask: np.ndarray) -> Plant[State]:
        """Return the plant of the bicycles that `mask` (N,) selects."""

    @abstractmethod
    def to_json(self) -> str:
        """Return all parameters as JSON, exact to the bit, with the key `plant`."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Plant[State]:
        """Return the plant that `to_json` wrote, from plain data with or without `plant`.

        Raises:
            ValueError: on an unknown or missing key, or on a value that makes no sense.
        """

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other.to_json() == self.to_json()

    def __hash__(self) -> int:
        return hash(self.to_json())

    def __repr__(self) -> str:
        return f"<{self.name}: {self.label}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Reduce the plant to its parameters, for copies and other processes."""
        return type(self).from_dict, (json.loads(self.to_json()),)

    def __deepcopy__(self, memo: dict[int, object]) -> Plant[State]:
        return self  # nothing changes it


def where(mask: np.ndarray, first: State, second: State) -> State:
    """Return for each bicycle `first` where `mask` (N,) holds and `second` elsewhere."""

    def chosen(name: str) -> np.ndarray:
        one, other = getattr(first, name), getattr(second, name)
        return np.where(mask if one.ndim == 1 else mask[:, None], one, other)

    return type(first)(**{item.name: chosen(item.name) for item in fields(first)})


def take(state: State, index: np.ndarray) -> State:
    """Return the bicycles of an index or mask as a separate state."""
    return type(state)(**{item.name: getattr(state, item.name)[index] for item in fields(state)})


def put(state: State, index: np.ndarray, other: State) -> State:
    """Return `state` with the bicycles of an index or mask replaced by `other`'s, in order."""
    values = {item.name: getattr(state, item.name).copy() for item in fields(state)}
    for name, old in values.items():
        old[index] = getattr(other, name)
    return type(state)(**values)


def copy(state: State) -> State:
    """Return a state that shares no memory with `state`."""
    return take(state, np.arange(len(state.lean_angle)))


def to_array(state: BodyState) -> np.ndarray:
    """Return everything that a restart needs as (N, k), in the order of the fields."""
    return np.column_stack([getattr(state, item.name) for item in fields(state)])


def from_array(state_type: type[State], values: np.ndarray) -> State:
    """Return the state that `to_array` converted to (N, k).

    Raises:
        ValueError: if there are fewer columns than fields.
    """
    names = [item.name for item in fields(state_type)]
    if values.ndim != 2 or values.shape[1] < len(names) - 1:
        raise ValueError(f"a {state_type.__name__} needs {len(names)} columns or more")
    columns = dict(zip(names, np.array(values.T), strict=False))
    if state_type.__dataclass_fields__[names[-1]].metadata.get("wide"):
        columns[names[-1]] = np.array(values[:, len(names) - 1 :])
    elif values.shape[1] != len(names):
        raise ValueError(f"a {state_type.__name__} has {len(names)} columns, not {len(values.T)}")
    return state_type(**columns)
