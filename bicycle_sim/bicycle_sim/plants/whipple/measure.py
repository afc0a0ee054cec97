"""A bicycle's 25 parameters from what a tape measure, a protractor and a scale give.

What they do not give is estimated from ten measured bicycles (those of `bicycles/` that have no
rider, without the benchmark and the two-mass skate): their mean radii of gyration, shares of mass
and places of the centres of mass. A rider is estimated from one rider who was measured on three
bicycles, scaled with body height. Means and standard deviations stand in ESTIMATES.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from bicycle_common.validation import require
from bicycle_sim.plants.whipple.parameters import Bicycle


class Estimate(NamedTuple):
    """A mean over measured bicycles."""

    mean: float
    deviation: float
    """Standard deviation over the bicycles."""
    unit: str
    meaning: str


ESTIMATES = {
    "rear_wheel_share": Estimate(0.172, 0.045, "", "rear wheel's share of the bicycle's mass"),
    "front_wheel_share": Estimate(0.126, 0.048, "", "front wheel's share of the bicycle's mass"),
    "fork_share": Estimate(0.190, 0.046, "", "fork and handlebar's share of the bicycle's mass"),
    "rear_rim": Estimate(
        0.646, 0.069, "", "rear wheel's radius of gyration as a share of its radius"
    ),
    "front_rim": Estimate(
        0.781, 0.054, "", "front wheel's radius of gyration as a share of its radius"
    ),
    "rear_flat": Estimate(0.597, 0.062, "", "rear wheel's IRxx over IRyy"),
    "front_flat": Estimate(0.559, 0.034, "", "front wheel's IFxx over IFyy"),
    "frame_forward": Estimate(
        0.336, 0.078, "", "rear frame's centre of mass as a share of the wheelbase"
    ),
    "frame_height": Estimate(0.577, 0.074, "m", "height of the rear frame's centre of mass"),
    "frame_xx": Estimate(0.258, 0.030, "m", "rear frame's radius of gyration about x"),
    "frame_yy": Estimate(0.357, 0.035, "m", "rear frame's radius of gyration about y"),
    "frame_zz": Estimate(0.280, 0.034, "m", "rear frame's radius of gyration about z"),
    "frame_xz": Estimate(0.005, 0.011, "m^2", "rear frame's Ixz over its mass"),
    "fork_ahead": Estimate(
        0.025, 0.026, "m", "front frame's centre of mass before the steering axis"
    ),
    "fork_height": Estimate(0.800, 0.074, "m", "height of the front frame's centre of mass"),
    "fork_xx": Estimate(0.246, 0.033, "m", "front frame's radius of gyration about x"),
    "fork_yy": Estimate(0.234, 0.036, "m", "front frame's radius of gyration about y"),
    "fork_zz": Estimate(0.132, 0.035, "m", "front frame's radius of gyration about z"),
    "fork_xz": Estimate(-0.012, 0.007, "m^2", "front frame's Ixz over its mass"),
    "rider_forward": Estimate(0.137, 0.017, "m", "rider's centre of mass before the saddle"),
    "rider_above": Estimate(0.093, 0.008, "m", "rider's centre of mass above the saddle"),
    "rider_xx": Estimate(0.349, 0.018, "m", "radius of gyration of a rider of 1.77 m about x"),
    "rider_yy": Estimate(0.352, 0.020, "m", "radius of gyration of a rider of 1.77 m about y"),
    "rider_zz": Estimate(0.169, 0.009, "m", "radius of gyration of a rider of 1.77 m about z"),
    "rider_xz": Estimate(-0.0192, 0.006, "m^2", "Ixz over the mass of a rider of 1.77 m"),
}
"""Values if nothing was measured; `tests/sim/test_bicycles.py` computes the bicycles'
rows again."""

RIDER_HEIGHT = 1.77
"""m, of the rider that the estimates are from, summed up from his measured segments."""


@dataclass(frozen=True)
class RigidRider:
    """A rider who sits still; added to the rear frame. Axes as those of `Bicycle`.

    Raises:
        ValueError: on a mass that is not above zero or a centre of mass below the ground.
    """

    m: float
    """kg."""
    x: float
    """m."""
    z: float
    """m, below zero."""
    Ixx: float
    """kg m^2 about the rider's own centre of mass."""
    Iyy: float
    Izz: float
    Ixz: float

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            good = isinstance(value, (int, float)) and math.isfinite(value)
            require(good, f"{item.name} of the rigid rider must be a number, not {value!r}")
        require(self.m > 0.0, f"m of the rigid rider must be above zero kg, not {self.m:g}")
        require(self.z < 0.0, f"z of the rigid rider must be below zero m, not {self.z:g}")


def with_rider(b: Bicycle, rider: RigidRider) -> Bicycle:
    """Return the bicycle with the rider as a part of its rear frame."""
    mass = b.mB + rider.m
    x = (b.mB * b.xB + rider.m * rider.x) / mass
    z = (b.mB * b.zB + rider.m * rider.z) / mass
    frame_x, frame_z, rider_x, rider_z = b.xB - x, b.zB - z, rider.x - x, rider.z - z
    values = {item.name: getattr(b, item.name) for item in fields(b)}
    values.update(
        mB=mass,
        xB=x,
        zB=z,
        IBxx=b.IBxx + b.mB * frame_z**2 + rider.Ixx + rider.m * rider_z**2,
        IByy=b.IByy
        + b.mB * (frame_x**2 + frame_z**2)
        + rider.Iyy
        + rider.m * (rider_x**2 + rider_z**2),
        IBzz=b.IBzz + b.mB * frame_x**2 + rider.Izz + rider.m * rider_x**2,
        IBxz=b.IBxz - b.mB * frame_x * frame_z + rider.Ixz - rider.m * rider_x * rider_z,
    )
    return Bicycle(**values)


@dataclass(frozen=True)
class TapeReadings:
    """Readings of a tape measure, a protractor and a scale.

    Raises:
        ValueError: on a value that no bicycle has, or when trail and fork offset are both given
            or both missing.
    """

    wheelbase: float
    """m."""
    head_angle: float
    """degrees between the steering axis and the ground, 90 is upright."""
    rear_radius: float
    """m, from the axle to the ground with the bicycle loaded."""
    front_radius: float
    """m."""
    mass: float
    """kg of the bicycle without rider."""
    trail: float | None = None
    """m from the front contact forward to where the steering axis meets the ground."""
    fork_offset: float | None = None
    """m from the steering axis to the front axle, at right angles; instead of the trail."""
    rear_wheel_mass: float | None = None
    """kg."""
    front_wheel_mass: float | None = None
    """kg."""
    fork_mass: float | None = None
    """kg of all that turns with the handlebar, but for the wheel."""
    front_load: float | None = None
    """kg on a scale under the front wheel, level, without rider."""
    mass_height: float | None = None
    """m of the bicycle's centre of mass above the ground."""
    rider_mass: float | None = None
    """kg; with the three below."""
    rider_height: float | None = None
    """m, body height."""
    saddle_height: float | None = None
    """m of the saddle's top above the ground."""
    saddle_forward: float | None = None
    """m of the saddle's middle in front of the rear axle."""
    g: float = 9.81
    """m/s^2."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value is None:
                continue
            good = (
                isinstance(value, (int, float))
                and not isinstance(value, bool)
                and math.isfinite(value)
            )
            require(good, f"{item.name} must be a number, not {value!r}")
            signed = item.name in ("trail", "fork_offset", "saddle_forward")
            require(signed or value > 0.0, f"{item.name} must be above zero, not {value:g}")
        require(
            25.0 < self.head_angle < 155.0,
            f"head_angle must lie between 25 and 155 degrees, not {self.head_angle:g}",
        )
        require(
            (self.trail is None) != (self.fork_offset is None),
            "give either trail or fork_offset",
        )
        rider = [self.rider_mass, self.rider_height, self.saddle_height, self.saddle_forward]
        require(
            all(value is None for value in rider) or all(value is not None for value in rider),
            "a rider needs rider_mass, rider_height, saddle_height and saddle_forward",
        )


def bicycle(m: TapeReadings) -> tuple[Bicycle, list[str]]:
    """Return the 25 parameters, and a line for each estimated one.

    Raises:
        ValueError: when the masses contradict each other.
    """
    notes: list[str] = []

    def taken(given: float | None, name: str, scale: float, parameter: str) -> float:
        if given is not None:
            return given
        estimate = ESTIMATES[name]
        figure = f"{estimate.mean:g} ± {estimate.deviation:g} {estimate.unit}".rstrip()
        notes.append(f"{parameter}: {estimate.meaning} is {figure} on ten measured bicycles")
        return estimate.mean * scale

    tilt = math.radians(90.0 - m.head_angle)
    trail = m.trail
    if trail is None:
        assert m.fork_offset is not None
        trail = (m.front_radius * math.sin(tilt) - m.fork_offset) / math.cos(tilt)
    rear_wheel = taken(m.rear_wheel_mass, "rear_wheel_share", m.mass, "mR")
    front_wheel = taken(m.front_wheel_mass, "front_wheel_share", m.mass, "mF")
    fork = taken(m.fork_mass, "fork_share", m.mass, "mH")
    frame = m.mass - rear_wheel - front_wheel - fork
    require(
        frame > 0.0,
        f"wheels and fork of {rear_wheel + front_wheel + fork:.2f} kg are as heavy as the whole "
        f"bicycle of {m.mass:g} kg",
    )
    fork_z = -taken(None, "fork_height", 1.0, "zH")
    ahead = taken(None, "fork_ahead", 1.0, "xH")
    fork_x = m.wheelbase + trail + (ahead + fork_z * math.sin(tilt)) / math.cos(tilt)
    if m.front_load is not None:
        moment = m.front_load * m.wheelbase - fork * fork_x - front_wheel * m.wheelbase
        frame_x = moment / frame
    else:
        frame_x = taken(None, "frame_forward", m.wheelbase, "xB")
    if m.mass_height is not None:
        wheels = rear_wheel * m.rear_radius + front_wheel * m.front_radius
        frame_z = -(m.mass * m.mass_height - wheels + fork * fork_z) / frame
    else:
        frame_z = -taken(None, "frame_height", 1.0, "zB")
    require(frame_z < 0.0, f"mass_height {m.mass_height} m puts the frame below the ground")

    def gyration(name: str, mass: float, parameter: str, size: float = 1.0) -> float:
        return mass * (taken(None, name, 1.0, parameter) * size) ** 2

    rear_spin = gyration("rear_rim", rear_wheel, "IRyy", m.rear_radius)
    front_spin = gyration("front_rim", front_wheel, "IFyy", m.front_radius)
    bicycle = Bicycle(
        w=m.wheelbase,
        c=trail,
        lam=tilt,
        rR=m.rear_radius,
        mR=rear_wheel,
        IRxx=taken(None, "rear_flat", rear_spin, "IRxx"),
        IRyy=rear_spin,
        xB=frame_x,
        zB=frame_z,
        mB=frame,
        IBxx=gyration("frame_xx", frame, "IBxx"),
        IByy=gyration("frame_yy", frame, "IByy"),
        IBzz=gyration("frame_zz", frame, "IBzz"),
        IBxz=taken(None, "frame_xz", frame, "IBxz"),
        xH=fork_x,
        zH=fork_z,
        mH=fork,
        IHxx=gyration("fork_xx", fork, "IHxx"),
        IHyy=gyration("fork_yy", fork, "IHyy"),
        IHzz=gyration("fork_zz", fork, "IHzz"),
        IHxz=taken(None, "fork_xz", fork, "IHxz"),
        rF=m.front_radius,
        mF=front_wheel,
        IFxx=taken(None, "front_flat", front_spin, "IFxx"),
        IFyy=front_spin,
        g=m.g,
    )
    if m.rider_mass is None:
        return bicycle, notes
    notes.append(
        "rider: centre of mass and inertia of one rider measured on three bicycles, scaled with "
        "body height"
    )
    return with_rider(bicycle, _rider(m)), notes


def _rider(m: TapeReadings) -> RigidRider:
    """Return the rider as a rigid body."""
    assert m.rider_mass is not None
    assert m.rider_height is not None
    assert m.saddle_height is not None
    assert m.saddle_forward is not None
    size, mass = m.rider_height / RIDER_HEIGHT, m.rider_mass
    mean = {name: estimate.mean for name, estimate in ESTIMATES.items()}
    return RigidRider(
        m=mass,
        x=m.saddle_forward + mean["rider_forward"] * size,
        z=-(m.saddle_height + mean["rider_above"] * size),
        Ixx=mass * (mean["rider_xx"] * size) ** 2,
        Iyy=mass * (mean["rider_yy"] * size) ** 2,
        Izz=mass * (mean["rider_zz"] * size) ** 2,
        Ixz=mass * mean["rider_xz"] * size**2,
    )


def estimates_of(bicycles: list[Bicycle]) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of each of the bicycles' ESTIMATES over measured bicycles."""
    found: dict[str, list[float]] = {}
    for b in bicycles:
        ahead = (b.xH - b.w - b.c) * np.cos(b.lam) - b.zH * np.sin(b.lam)
        values = {
            "rear_wheel_share": b.mR / b.mass,
            "front_wheel_share": b.mF / b.mass,
            "fork_share": b.mH / b.mass,
            "rear_rim": np.sqrt(b.IRyy / b.mR) / b.rR,
            "front_rim": np.sqrt(b.IFyy / b.mF) / b.rF,
            "rear_flat": b.IRxx / b.IRyy,
            "front_flat": b.IFxx / b.IFyy,
            "frame_forward": b.xB / b.w,
            "frame_height": -b.zB,
            "frame_xx": np.sqrt(b.IBxx / b.mB),
            "frame_yy": np.sqrt(b.IByy / b.mB),
            "frame_zz": np.sqrt(b.IBzz / b.mB),
            "frame_xz": b.IBxz / b.mB,
            "fork_ahead": ahead,
            "fork_height": -b.zH,
            "fork_xx": np.sqrt(b.IHxx / b.mH),
            "fork_yy": np.sqrt(b.IHyy / b.mH),
            "fork_zz": np.sqrt(b.IHzz / b.mH),
            "fork_xz": b.IHxz / b.mH,
        }
        for name, value in values.items():
            found.setdefault(name, []).append(float(value))
    return {name: (float(np.mean(v)), float(np.std(v))) for name, v in found.items()}
