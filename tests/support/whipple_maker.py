"""Whipple bicycles and their energy for tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.equations import Forces, motion
from bicycle_sim.plants.whipple.kinematics import Pose, rolling
from bicycle_sim.plants.whipple.parameters import (
    Bicycle,
    Drive,
    Motor,
    Parameters,
    Resistance,
    Rider,
    Road,
    Steering,
)
from bicycle_sim.plants.whipple.plant import WhipplePlant, WhippleState

DATA = Path(__file__).parent.parent / "data" / "whipple"


def published(name: str) -> Any:
    return json.loads((DATA / name).read_text())


def benchmark() -> Bicycle:
    return catalogue.load("benchmark").parameters.bicycle


def riding(plant: WhipplePlant, speed: Any, lean_rate: Any = 0.0, count: int = 1) -> WhippleState:
    """Return `count` bicycles at the origin, heading 0, pushed."""
    zero = np.zeros(count)
    return plant.pushed(plant.initial(zero, zero, zero, zero + speed), zero + lean_rate)


def coast(plant: WhipplePlant, state: WhippleState, steps: int, **inputs: Any) -> WhippleState:
    """Return `steps` control periods under inputs that stay."""
    zero = np.zeros(len(state.lean_angle))
    held = {"torque": zero, "displacement": zero, "pedal_force": zero, **inputs}
    for _ in range(steps):
        state = plant.step(state, **held)
    return state


def energy(plant: WhipplePlant, s: WhippleState) -> np.ndarray:
    """J of N bicycles, kinetic and of their weight, from the road's origin; no leaning rider."""
    k = plant.constants
    r = rolling(k, s.lean_angle, s.pitch, s.steer_angle)
    pose = Pose(s.lean_angle, s.pitch, s.steer_angle, s.lean_rate, s.steer_rate, s.speed)
    m11, m12, m13, m22, m23, m33 = motion(k, pose, Forces(), r).mass
    p, q, v = s.lean_rate, s.steer_rate, s.speed
    kinetic = 0.5 * (m11 * p * p + m22 * q * q + m33 * v * v) + m12 * p * q + m13 * p * v
    kinetic = kinetic + m23 * q * v
    # First moments of mass from the rear contact: along the heading, across, into the road.
    forward, across, down = _moments(plant, s)
    cosine, sine = np.cos(s.heading), np.sin(s.heading)
    mass = k.rear_mass + k.front_mass
    x = mass * s.rear_x - sine * forward - cosine * across
    y = mass * s.rear_y + cosine * forward - sine * across
    return kinetic - (k.gravity * down + k.gravity_x * x + k.gravity_y * y)


def _moments(plant: WhipplePlant, s: WhippleState) -> tuple[Any, Any, Any]:
    """kg m, by plain rotations: front frame to rear frame to the rear wheel's plane to level."""
    k = plant.constants
    x = k.axis_forward + np.cos(s.steer_angle) * (k.fork_offset + k.front_x / k.front_mass)
    y = np.sin(s.steer_angle) * (k.fork_offset + k.front_x / k.front_mass)
    z = k.axis_down + k.front_z / k.front_mass
    x, y, z = k.rear_x + k.front_mass * x, k.front_mass * y, k.rear_z + k.front_mass * z
    pitch = k.tilt + s.pitch
    x, z = np.cos(pitch) * x + np.sin(pitch) * z, np.cos(pitch) * z - np.sin(pitch) * x
    z = z - k.rear_radius * (k.rear_mass + k.front_mass)
    lean = s.lean_angle
    return x, np.cos(lean) * y - np.sin(lean) * z, np.sin(lean) * y + np.cos(lean) * z


def various(count: int, seed: int, rider: bool = False, plain: bool = False) -> Parameters:
    """Return `count` different bicycles with everything bolted to them, or with nothing."""
    rng = np.random.default_rng(seed)

    def spread(value: float) -> np.ndarray:
        return value * rng.uniform(0.8, 1.2, count)

    def some(value: float) -> np.ndarray:
        return spread(value) * (rng.random(count) < 0.6)

    values = {name: spread(value) for name, value in vars(benchmark()).items()}
    values["lam"] = 0.3 + rng.uniform(-0.1, 0.1, count)
    bicycle = Bicycle(**values)
    if plain:
        return Parameters(bicycle)
    return Parameters(
        bicycle,
        rider=Rider(
            mG=spread(40.0),
            xG=spread(0.3),
            zG=spread(-1.3),
            zP=spread(-0.8),
            IGxx=spread(2.0),
            IGyy=spread(1.7),
            IGzz=spread(1.1),
            IGxz=spread(0.01),
            stiffness=some(10.0),
            damping=some(2.0),
        )
        if rider
        else None,
        steering=Steering(some(0.3), some(0.5), spread(0.1), spread(0.6)),
        motor=Motor(some(7.0), some(0.03), some(200.0), some(0.2)),
        drive=Drive(power=spread(400.0)),
        resistance=Resistance(spread(0.5), spread(0.8), rolling=spread(0.005)),
        road=Road(*(rng.normal(size=(4, count)) * [[0.03], [0.03], [2.0], [2.0]])),
        delay=rng.uniform(0.0, 0.15, count) * (rng.random(count) < 0.8),
    )
