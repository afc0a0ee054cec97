"""The contract of a plant: any bicycle that the task, the simulator and controllers can ride.

A plant moves N bicycles at once, in pure numpy or compiled code, without ROS. All signs are the
paper's: lean and steering are positive to the left, the heading is counter-clockwise from +y.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

Array = Any
"""A float or an array of shape (N,)."""


@dataclass
class BodyState:
    """What every plant knows of N bicycles; arrays of shape (N,), double precision.

    A plant's own state adds fields. All fields together are what a restart to the bit needs. The
    last field may be (N, k); every other one is (N,).
    """

    lean_angle: np.ndarray
    """rad."""
    lean_rate: np.ndarray
    """rad/s."""
    lean_acceleration: np.ndarray
    """rad/s^2, the mean over the control period before."""
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
    """What acts on the bicycles from outside during one control period; floats or (N,)."""

    lateral_force: Array = 0.0
    """N on the rear frame, positive to the left."""
    force_height: Array = 0.9
    """m above the ground where that force acts."""
    force_forward: Array = 0.4
    """m in front of the rear contact where that force acts."""
    roll_torque: Array = 0.0
    """N m on the rear frame, positive to the left."""
    wind_x: Array = 0.0
    """m/s towards +x, besides the steady wind of the plant."""
    wind_y: Array = 0.0
    """m/s towards +y, besides the steady wind of the plant."""


@dataclass(frozen=True)
class Linear:
    """A plant linearised about riding straight and upright at one speed."""

    states: tuple[str, ...]
    """Names of the n states; `heading_error` is psi_g of a goal far away."""
    inputs: tuple[str, ...]
    """Names of the m inputs."""
    a: np.ndarray
    """(n, n)."""
    b: np.ndarray
    """(n, m)."""
    time_step: float | None = None
    """s, x[k+1] = a x[k] + b u[k]; None where dx/dt = a x + b u."""


@dataclass(frozen=True)
class Geometry:
    """What is needed to draw a bicycle; m, kg, rad."""

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


class Plant(ABC, Generic[State]):
    """N bicycles that obey one set of equations; one set of parameters or one for each."""

    name: ClassVar[str]
    """The kind of plant, `plant` in its JSON."""
    state_type: ClassVar[type[BodyState]]
    """Of the states that `initial` and `step` give."""

    @property
    @abstractmethod
    def time_step(self) -> float:
        """s of one control period."""

    @property
    @abstractmethod
    def count(self) -> int | None:
        """How many different bicycles there are; None where all are alike, however many."""

    @property
    @abstractmethod
    def input_names(self) -> tuple[str, ...]:
        """The inputs of `step` that move this bicycle; the others must be zero."""

    @property
    @abstractmethod
    def geometry(self) -> Geometry:
        """Of the bicycle, or of the first of many."""

    @abstractmethod
    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> State:
        """N upright bicycles with straight handlebars; arguments of shape (N,), m, rad, m/s."""

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
        """One control period of N bicycles.

        Args:
            state: the bicycles before it; not changed.
            torque: (N,) N m that is wanted on the handlebar.
            displacement: (N,) m that the centre of mass is wanted to be moved by.
            pedal_force: (N,) N on the pedal; below zero it brakes.
            speed_limits: m/s that the speed is kept between, or None.
            loads: pushes and gusts, or None.

        Returns:
            The bicycles one `time_step` later.

        Raises:
            ValueError: when the plant has no use for an input that is not zero, or on a number
                of bicycles other than `count`.
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
        """The states within one control period at equal distances; the last is that of `step`.

        A sensor that is read more often than the controller answers needs them.
        """
        return [self.step(state, torque, displacement, pedal_force, speed_limits, loads)]

    @abstractmethod
    def pushed(self, state: State, lean_rate: Array) -> State:
        """The state after a push that adds `lean_rate`, rad/s, float or (N,)."""

    @abstractmethod
    def fallen(self, state: State, limit: float) -> np.ndarray:
        """(N,) bool: leans by more than `limit`, rad, or cannot be ridden any more."""

    @abstractmethod
    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        """The plant about riding straight at a speed, m/s, as `step` moves it if `discrete`."""

    @abstractmethod
    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """(N,) rad at which a steady turn is balanced; arguments of shape (N,), rad and m/s."""

    @abstractmethod
    def take(self, mask: np.ndarray) -> Plant[State]:
        """The plant of those bicycles that `mask` (N,) keeps."""

    @abstractmethod
    def to_json(self) -> str:
        """All parameters to the last bit, with the key `plant`."""


def where(mask: np.ndarray, first: State, second: State) -> State:
    """Bicycle by bicycle, `first` where `mask` (N,) holds and `second` elsewhere."""

    def chosen(name: str) -> np.ndarray:
        one, other = getattr(first, name), getattr(second, name)
        return np.where(mask if one.ndim == 1 else mask[:, None], one, other)

    return type(first)(**{item.name: chosen(item.name) for item in fields(first)})


def take(state: State, index: np.ndarray) -> State:
    """The bicycles of an index or mask, as a state of its own."""
    return type(state)(**{item.name: getattr(state, item.name)[index] for item in fields(state)})


def put(state: State, index: np.ndarray, other: State) -> State:
    """`state` with the bicycles of an index or mask replaced by those of `other`, in order."""
    values = {item.name: getattr(state, item.name).copy() for item in fields(state)}
    for name, old in values.items():
        old[index] = getattr(other, name)
    return type(state)(**values)


def to_array(state: BodyState) -> np.ndarray:
    """All that a restart needs as (N, k), in the order of the fields."""
    return np.column_stack([getattr(state, item.name) for item in fields(state)])


def from_array(state_type: type[State], values: np.ndarray) -> State:
    """The state that `to_array` turned into (N, k).

    Raises:
        ValueError: when there are fewer columns than fields.
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
