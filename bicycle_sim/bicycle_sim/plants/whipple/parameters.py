"""The parameters of a Whipple-Carvallo bicycle: 25 numbers and what is bolted to it.

Every number may be a float or an array of shape (N,), one for each of N bicycles. The 25 names,
their axes (x forward, y right, z down, from the rear contact) and their symbols are those of
Meijaard, Papadopoulos, Ruina and Schwab 2007, Table 1.
"""

# ruff: noqa: N815  (the literature's symbols)

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from bicycle_common.validation import require
from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.parameter_checks import (
    require_above,
    require_finite,
    require_good,
    require_inertia,
)

Part = TypeVar("Part")

STOP = math.radians(80.0)
"""rad, as far as the paper's handlebar turns (errata row 22)."""


@dataclass(frozen=True)
class Bicycle:
    """The 25 parameters and gravity, SI units.

    Body B is the rear frame with all that is fixed to it (a rigid rider, too), H the front
    frame, R and F the wheels. Inertias are about the body's own centre of mass; `I?xz` is the
    entry of the tensor.

    Raises:
        ValueError: on a value that no bicycle has.
    """

    w: Array
    """m, wheelbase."""
    c: Array
    """m, trail; positive where the front contact is behind the steering axis."""
    lam: Array
    """rad, tilt of the steering axis: 90 degrees less the head angle."""
    rR: Array
    """m, radius of the rear wheel; zero is a skate."""
    mR: Array
    """kg."""
    IRxx: Array
    """kg m^2, about a diameter."""
    IRyy: Array
    """kg m^2, about the axle."""
    xB: Array
    """m."""
    zB: Array
    """m, below zero."""
    mB: Array
    """kg."""
    IBxx: Array
    """kg m^2."""
    IByy: Array
    """kg m^2."""
    IBzz: Array
    """kg m^2."""
    IBxz: Array
    """kg m^2."""
    xH: Array
    """m."""
    zH: Array
    """m, below zero."""
    mH: Array
    """kg."""
    IHxx: Array
    """kg m^2."""
    IHyy: Array
    """kg m^2."""
    IHzz: Array
    """kg m^2."""
    IHxz: Array
    """kg m^2."""
    rF: Array
    """m, radius of the front wheel; zero is a skate."""
    mF: Array
    """kg."""
    IFxx: Array
    """kg m^2, about a diameter."""
    IFyy: Array
    """kg m^2, about the axle."""
    g: Array = 9.81
    """m/s^2."""

    def __post_init__(self) -> None:
        require_finite(self)
        require_above(self, "w", 0.0, False, "above zero m")
        require_above(self, "mB mH", 0.0, False, "above zero kg")
        require_above(self, "rR rF", 0.0, True, "zero or more m")
        require_above(self, "mR mF", 0.0, True, "zero or more kg")
        require_above(self, "IRxx IRyy IFxx IFyy", 0.0, True, "zero or more kg m^2")
        require_above(self, "g", 0.0, False, "above zero m/s^2")
        require_inertia(self, "B")
        require_inertia(self, "H")
        for name in ("zB", "zH"):
            value = getattr(self, name)
            below = np.less(value, 0.0)
            require_good(
                value, below, f"{name} must be below zero m (z points down from the ground)"
            )
        require_good(
            self.lam,
            np.less(np.abs(self.lam), 1.2),
            "lam must lie between -1.2 and 1.2 rad (90 degrees less the head angle)",
        )
        for wheel, spin in (("rR", "IRyy"), ("rF", "IFyy")):
            rolls = np.greater(getattr(self, wheel), 0.0) | np.equal(getattr(self, spin), 0.0)
            require(bool(np.all(rolls)), f"{spin} must be zero where {wheel} is: a skate is fixed")

    @property
    def mass(self) -> Array:
        """kg of all four bodies."""
        return self.mR + self.mB + self.mH + self.mF

    @property
    def mass_forward(self) -> Array:
        """m from the rear contact to the common centre of mass."""
        return (self.mB * self.xB + self.mH * self.xH + self.mF * self.w) / self.mass

    @property
    def mass_height(self) -> Array:
        """m of the common centre of mass above the ground."""
        frames = self.mB * self.zB + self.mH * self.zH
        return (self.mR * self.rR - frames + self.mF * self.rF) / self.mass


@dataclass(frozen=True)
class Rider:
    """A rider's upper body that leans on the rear frame (body G of Moore 2012).

    It turns about an axis that is level on an upright bicycle. A muscle brings it to the lean
    that moves the common centre of mass by the wanted displacement.

    Raises:
        ValueError: on a value that no rider has.
    """

    mG: Array
    """kg."""
    xG: Array
    """m, centre of mass in front of the rear contact."""
    zG: Array
    """m, centre of mass, below zero."""
    zP: Array
    """m, axis of the lean, below zero and nearer to the ground than zG."""
    IGxx: Array
    """kg m^2."""
    IGyy: Array
    """kg m^2."""
    IGzz: Array
    """kg m^2."""
    IGxz: Array
    """kg m^2."""
    stiffness: Array = 0.0
    """N m/rad of passive resistance to leaning (k9)."""
    damping: Array = 0.0
    """N m s/rad of passive resistance to leaning (c9)."""
    frequency: Array = 8.0
    """rad/s at which the muscle moves the body; zero is a limp rider."""
    damping_ratio: Array = 1.0
    """Damping ratio of the muscle's motion; 1 does not overshoot."""
    torque_limit: Array = 150.0
    """N m, the muscle's most."""

    def __post_init__(self) -> None:
        require_finite(self)
        require_above(self, "mG", 0.0, False, "above zero kg")
        require_inertia(self, "G")
        names = "stiffness damping frequency damping_ratio torque_limit"
        require_above(self, names, 0.0, True, "zero or more")
        above = np.less(self.zG, self.zP) & np.less(self.zP, 0.0)
        require(
            bool(np.all(above)),
            "zG must lie above zP, and zP above the ground: zG < zP < 0 (z points down)",
        )


@dataclass(frozen=True)
class Steering:
    """Friction, stop and the like of the steering's bearing and frame.

    Raises:
        ValueError: on a negative value or a stop beyond 85 degrees.
    """

    friction: Array = 0.0
    """N m of Coulomb friction while the steering turns."""
    stiction: Array = 0.0
    """N m that hold the resting steering; not less than `friction` is taken."""
    damping: Array = 0.0
    """N m s/rad of viscous friction."""
    stop: Array = STOP
    """rad to either side, where the front frame meets the rear one without a rebound."""

    def __post_init__(self) -> None:
        require_finite(self)
        require_above(self, "friction stiction damping", 0.0, True, "zero or more")
        require_above(self, "stop", 0.0, False, "above zero rad")
        inside = np.less_equal(self.stop, math.radians(85.0))
        require(bool(np.all(inside)), "stop must be at most 85 degrees (1.483 rad)")


@dataclass(frozen=True)
class Motor:
    """The motor that turns the wanted steer torque into a real one; as it stands, a perfect one.

    Raises:
        ValueError: on a negative value.
    """

    limit: Array = 0.0
    """N m, the largest torque; zero is no limit."""
    lag: Array = 0.0
    """s, time constant of a first-order lag."""
    rate: Array = 0.0
    """N m/s, the fastest change; zero is no limit."""
    dead_band: Array = 0.0
    """N m of a wanted torque that are lost."""
    step: Array = 0.0
    """N m of one digit of the wanted torque, which is rounded to whole ones; zero is none."""

    def __post_init__(self) -> None:
        require_finite(self)
        require_above(self, "limit lag rate dead_band step", 0.0, True, "zero or more")

    def rounded(self, torque: np.ndarray) -> np.ndarray:
        """Return wanted torques (N,) in whole digits, N m."""
        if not np.any(self.step):
            return torque
        digit = np.where(np.equal(self.step, 0.0), 1.0, self.step)
        found: np.ndarray = np.where(
            np.equal(self.step, 0.0), torque, digit * np.rint(torque / digit)
        )
        return found


@dataclass(frozen=True)
class Drive:
    """Drive of the bicycle: the force at the rear wheel's rim.

    Raises:
        ValueError: on a negative value.
    """

    gear: Array = 0.2
    """Force at the rim per pedal force (F_4 / F_1 of the paper, eq. 11)."""
    power: Array = 1000.0
    """W, the most that drives it."""
    brake: Array = 400.0
    """N at the rim, the most that brakes it."""
    governor: Array = 500.0
    """N per m/s that the speed is beyond its limits, where a step names limits."""

    def __post_init__(self) -> None:
        require_finite(self)
        require_above(self, "gear power brake governor", 0.0, True, "zero or more")


@dataclass(frozen=True)
class Resistance:
    """Resistance of air and tyres; none by default.

    Raises:
        ValueError: on a negative value.
    """

    drag_area: Array = 0.0
    """m^2, drag coefficient times frontal area; 0.5 for an upright rider."""
    side_area: Array = 0.0
    """m^2, side force coefficient times side area; 0.8 for an upright rider."""
    pressure_height: Array = 1.0
    """m above the ground where the air presses."""
    pressure_forward: Array = 0.4
    """m in front of the rear contact where the air presses."""
    air_density: Array = 1.2
    """kg/m^3."""
    rolling: Array = 0.0
    """N of rolling resistance per N of wheel load; 0.005 for good tyres on asphalt."""

    def __post_init__(self) -> None:
        require_finite(self)
        names = "drag_area side_area pressure_height air_density rolling"
        require_above(self, names, 0.0, True, "zero or more")


@dataclass(frozen=True)
class Road:
    """A plane that is not level, and a steady wind.

    Raises:
        ValueError: on a slope of 45 degrees or more.
    """

    grade_x: Array = 0.0
    """m that the road rises per m towards +x."""
    grade_y: Array = 0.0
    """m that the road rises per m towards +y."""
    wind_x: Array = 0.0
    """m/s towards +x."""
    wind_y: Array = 0.0
    """m/s towards +y."""

    def __post_init__(self) -> None:
        require_finite(self)
        flat = np.less(np.hypot(self.grade_x, self.grade_y), 1.0)
        require(bool(np.all(flat)), "the road must rise by less than 1 m per m")


@dataclass(frozen=True)
class Parameters:
    """All parameters of one Whipple plant.

    Raises:
        ValueError: on a value that makes no sense.
    """

    bicycle: Bicycle
    name: str = ""
    """Name to display; no computation depends on it."""
    rider: Rider | None = None
    steering: Steering = field(default_factory=Steering)
    motor: Motor = field(default_factory=Motor)
    drive: Drive = field(default_factory=Drive)
    resistance: Resistance = field(default_factory=Resistance)
    road: Road = field(default_factory=Road)
    delay: Array = 0.0
    """s from a command until the actuators begin to follow it."""
    time_step: float = 0.025
    """s of one control period."""
    substeps: int = 10
    """Steps of integration in a control period."""

    def __post_init__(self) -> None:
        require(isinstance(self.name, str), f"name must be a text, not {self.name!r}")
        require_finite(self)
        require_above(self, "delay", 0.0, True, "zero or more s")
        require(bool(np.all(np.less_equal(self.delay, 0.5))), "delay must be at most 0.5 s")
        require(
            np.ndim(self.time_step) == 0 and 0.0 < self.time_step <= 0.1,
            f"time_step must be a number above zero and at most 0.1 s, not {self.time_step!r}",
        )
        whole = np.ndim(self.substeps) == 0 and self.substeps == int(self.substeps)
        require(
            whole and 1 <= self.substeps <= 1000,
            f"substeps must be a whole number from 1 to 1000, not {self.substeps!r}",
        )
        object.__setattr__(self, "substeps", int(self.substeps))

    @property
    def count(self) -> int | None:
        """Number of bicycles in the arrays; None if there are only floats.

        Raises:
            ValueError: when two arrays differ in length.
        """
        sizes = {len(value) for value in _arrays(self)}
        require(len(sizes) <= 1, f"arrays of {sorted(sizes)} bicycles: give one number or N")
        return sizes.pop() if sizes else None


def _arrays(part: object) -> list[np.ndarray]:
    """Yield every array in a part and its parts."""
    found = []
    for item in fields(part):  # type: ignore[arg-type]
        value = getattr(part, item.name)
        if is_dataclass(value):
            found += _arrays(value)
        elif isinstance(value, np.ndarray) and value.ndim:
            found.append(value)
    return found


def take(part: Part, index: Any) -> Part:
    """Return the parameters of those bicycles that an index or mask keeps."""
    values = {}
    for item in fields(part):  # type: ignore[arg-type]
        value = getattr(part, item.name)
        if is_dataclass(value):
            values[item.name] = take(value, index)
        elif isinstance(value, np.ndarray) and value.ndim:
            values[item.name] = value[index]
    return replace(part, **values)  # type: ignore[type-var]
