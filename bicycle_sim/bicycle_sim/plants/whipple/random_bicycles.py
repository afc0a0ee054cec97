"""Random bicycles: thousands of different ones, with riders, motors, delays and roads.

Geometry and masses are drawn evenly between limits that hold city, racing, cargo and steer-by-wire
bicycles; inertias follow from radii of gyration, which are drawn around the means of
`measure.ESTIMATES`, twice as far as the deviations there. No measured bicycle is among them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from bicycle_common.validation import as_pair, require
from bicycle_sim.plants.whipple.measure import ESTIMATES
from bicycle_sim.plants.whipple.parameters import (
    Bicycle,
    Motor,
    Parameters,
    Resistance,
    Road,
    Steering,
)


@dataclass(frozen=True)
class Ranges:
    """Least and largest value of what is drawn evenly.

    Raises:
        ValueError: on a range that does not grow, or on a value that no bicycle has.
    """

    wheelbase: tuple[float, float] = (0.92, 1.30)
    """m."""
    trail: tuple[float, float] = (0.02, 0.13)
    """m."""
    head_angle: tuple[float, float] = (62.0, 76.0)
    """degrees."""
    wheel_radius: tuple[float, float] = (0.25, 0.37)
    """m, the rear wheel's; the front one's differs by a few percent."""
    mass: tuple[float, float] = (8.0, 35.0)
    """kg, without rider."""
    rider_share: float = 0.5
    """Share of the bicycles that have a rider."""
    rider_mass: tuple[float, float] = (50.0, 110.0)
    """kg."""
    torque_limit: tuple[float, float] = (2.0, 20.0)
    """N m of the steering motor; drawn evenly in its logarithm."""
    delay: tuple[float, float] = (0.0, 0.075)
    """s from a command until the motor follows it; long ones are drawn more often."""
    motor_lag: tuple[float, float] = (0.0, 0.04)
    """s."""
    friction: tuple[float, float] = (0.0, 0.5)
    """N m of Coulomb friction in the steering."""
    damping: tuple[float, float] = (0.0, 0.5)
    """N m s/rad in the steering."""
    grade: tuple[float, float] = (-0.03, 0.03)
    """m per m, along x and along y."""
    wind: tuple[float, float] = (-3.0, 3.0)
    """m/s, along x and along y."""
    plain_share: float = 0.25
    """Share of the bicycles that have none of something: no lag, friction, damping, grade, wind or
    air, each drawn for itself. As many have a delay of whole control periods."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name.endswith("_share"):
                require(0.0 <= value <= 1.0, f"{item.name} must be 0 to 1, not {value!r}")
                continue
            low, high = as_pair(value)
            object.__setattr__(self, item.name, (low, high))
            require(low <= high, f"{item.name} must not shrink, as {low, high} does")
        positive = ("wheelbase", "head_angle", "wheel_radius", "mass", "rider_mass")
        for name in (*positive, "torque_limit"):
            require(getattr(self, name)[0] > 0, f"{name} must be above zero")
        for name in ("delay", "motor_lag", "friction", "damping"):
            require(getattr(self, name)[0] >= 0, f"{name} must be zero or more")


def draw(
    count: int, rng: np.random.Generator, ranges: Ranges | None = None, substeps: int = 10
) -> Parameters:
    """Return the parameters of `count` different bicycles.

    Args:
        count: N.
        rng: source of all of them.
        ranges: see there.
        substeps: steps of integration in a control period.
    """
    ranges = ranges or Ranges()

    def between(name: str) -> np.ndarray:
        low, high = getattr(ranges, name)
        return rng.uniform(low, high, count)

    def some(values: np.ndarray) -> np.ndarray:
        return np.where(rng.uniform(size=count) < ranges.plain_share, 0.0, values)

    bicycle = _bicycle(between, rng, count, ranges)
    least_torque, most_torque = ranges.torque_limit
    limit = np.exp(rng.uniform(math.log(least_torque), math.log(most_torque), count))
    friction = some(between("friction"))
    air = some(rng.uniform(0.0, 1.0, count))
    least, most = ranges.delay
    # Long delays are the hard ones: half of them lie in the last 30 % of the range.
    delay, period = least + (most - least) * np.sqrt(rng.uniform(size=count)), Parameters.time_step
    whole = np.clip(np.rint(delay / period) * period, least, most)
    delay = np.where(rng.uniform(size=count) < ranges.plain_share, whole, delay)
    along, across = some(between("grade")), some(between("grade"))
    wind_x, wind_y = some(between("wind")), some(between("wind"))
    return Parameters(
        bicycle,
        name="random",
        steering=Steering(friction=friction, stiction=friction, damping=some(between("damping"))),
        motor=Motor(limit=limit, lag=some(between("motor_lag"))),
        resistance=Resistance(drag_area=0.5 * air, side_area=0.8 * air, rolling=0.005),
        road=Road(along, across, wind_x, wind_y),
        delay=delay,
        substeps=substeps,
    )


def _bicycle(between: object, rng: np.random.Generator, count: int, ranges: Ranges) -> Bicycle:
    """Return the 25 parameters, each (N,)."""

    def about(name: str) -> np.ndarray:
        mean, deviation = ESTIMATES[name].mean, ESTIMATES[name].deviation
        drawn: np.ndarray = rng.uniform(mean - 2.0 * deviation, mean + 2.0 * deviation, count)
        return drawn

    assert callable(between)
    w, c = between("wheelbase"), between("trail")
    lam = np.radians(90.0 - between("head_angle"))
    rear = between("wheel_radius")
    front = rear * rng.uniform(0.95, 1.05, count)
    mass = between("mass")
    rear_share, front_share = about("rear_wheel_share"), about("front_wheel_share")
    fork_share = about("fork_share")
    m_rear, m_front, m_fork = (
        np.maximum(share, 0.04) * mass for share in (rear_share, front_share, fork_share)
    )
    m_frame = mass - m_rear - m_front - m_fork
    spin_r = m_rear * (np.minimum(about("rear_rim"), 1.0) * rear) ** 2
    spin_f = m_front * (np.minimum(about("front_rim"), 1.0) * front) ** 2
    frame = _body(m_frame, about, "frame", about("frame_forward") * w, -about("frame_height"))
    height = about("fork_height")
    # The steering axis meets the ground `c` before the front contact, and leans back by `lam`.
    ahead = w + c - height * np.tan(lam) + about("fork_ahead") / np.cos(lam)
    fork = _body(m_fork, about, "fork", ahead, -height)
    rides = rng.uniform(size=count) < ranges.rider_share
    tall = rng.uniform(0.9, 1.1, count)
    saddle = rng.uniform(0.1, 0.3, count)
    rider = _body(
        np.where(rides, between("rider_mass"), 0.0),
        lambda name: about(name) * (tall**2 if name.endswith("xz") else tall),
        "rider",
        saddle + about("rider_forward"),
        -rng.uniform(0.9, 1.2, count),
    )
    rear_frame = _joined(frame, rider)
    return Bicycle(
        w=w, c=c, lam=lam,
        rR=rear, mR=m_rear, IRxx=spin_r * about("rear_flat"), IRyy=spin_r,
        **{f"{key[0]}B{key[1:]}": value for key, value in rear_frame.items()},
        **{f"{key[0]}H{key[1:]}": value for key, value in fork.items()},
        rF=front, mF=m_front, IFxx=spin_f * about("front_flat"), IFyy=spin_f,
    )  # fmt: skip


Body = Mapping[str, np.ndarray]
"""Mass, place and inertia of a body: m, x, z, Ixx, Iyy, Izz, Ixz."""


def _body(mass: np.ndarray, about: object, name: str, x: np.ndarray, z: np.ndarray) -> Body:
    """Return a body with radii of gyration drawn around those of `name`."""
    assert callable(about)
    xx, yy, zz = (mass * about(f"{name}_{axis}") ** 2 for axis in ("xx", "yy", "zz"))
    most = 0.9 * np.sqrt(xx * zz)
    xz = np.clip(mass * about(f"{name}_xz"), -most, most)
    return {"m": mass, "x": x, "z": z, "Ixx": xx, "Iyy": yy, "Izz": zz, "Ixz": xz}


def _joined(one: Body, other: Body) -> Body:
    """Return two bodies as one."""
    mass = one["m"] + other["m"]
    x, z = ((one["m"] * one[axis] + other["m"] * other[axis]) / mass for axis in "xz")
    found = {name: one[name] + other[name] for name in ("Ixx", "Iyy", "Izz", "Ixz")}
    for body in (one, other):
        ahead, below = body["x"] - x, body["z"] - z
        found["Ixx"] = found["Ixx"] + body["m"] * below**2
        found["Iyy"] = found["Iyy"] + body["m"] * (ahead**2 + below**2)
        found["Izz"] = found["Izz"] + body["m"] * ahead**2
        found["Ixz"] = found["Ixz"] - body["m"] * ahead * below
    return {"m": mass, "x": x, "z": z, **found}
