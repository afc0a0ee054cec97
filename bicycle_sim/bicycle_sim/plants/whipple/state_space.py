"""State-space models of the whole plant about riding straight: rider, motor and delay in them.

The derivatives are exact: they come from `equations.motion` with complex numbers (Squire and Trapp
1998).
"""

from __future__ import annotations

import math

import numpy as np

from bicycle_sim.plants.base import Array, Linear
from bicycle_sim.plants.whipple.constants import constants, delay_steps
from bicycle_sim.plants.whipple.equations import Forces, motion
from bicycle_sim.plants.whipple.kinematics import Pose, rolling
from bicycle_sim.plants.whipple.parameters import Parameters


def model(p: Parameters, speed: float, discrete: bool = False) -> Linear:
    """Return the plant linearised about riding straight, with its rider, motor and delay if any.

    Coulomb friction, dead band and limits are left out.

    Args:
        p: the parameters; of N bicycles it gives (N, n, n) matrices.
        speed: m/s.
        discrete: for one control period under commands that are held, delayed as in `step`.
    """
    rider, lag = p.rider is not None, bool(np.any(np.asarray(p.motor.lag) > 0.0))
    states = ["lean_angle", "lean_rate", "steer_angle", "steer_rate", "heading_error"]
    states += ["rider_lean", "rider_rate"] if rider else []
    states += ["motor_torque"] if lag else []
    inputs = ["torque", "displacement"] if rider else ["torque"]
    a, b = _continuous(p, speed, states, inputs)
    if not discrete:
        return Linear(tuple(states), tuple(inputs), a, b)
    return _discrete(p, states, inputs, a, b)


def _continuous(
    p: Parameters, speed: float, states: list[str], inputs: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    k, count = constants(p), p.count
    rider = p.rider is not None
    wide = (count,) if count is not None else ()
    a = np.zeros((*wide, len(states), len(states)))
    b = np.zeros((*wide, len(states), len(inputs)))
    place = {name: index for index, name in enumerate(states)}
    rates = {"lean_angle": "lean_rate", "steer_angle": "steer_rate", "rider_lean": "rider_rate"}
    for angle, rate in rates.items():
        if angle in place:
            a[..., place[angle], place[rate]] = 1.0

    tiny = 1e-30
    axes = ("lean_angle", "steer_angle", "lean_rate", "steer_rate", "rider_lean", "rider_rate")

    def response(changed: str) -> dict[str, Array]:
        """Return accelerations and yaw rate per unit of one of the axes, or of a torque."""
        at = {name: tiny * 1j if name == changed else 0.0 for name in (*axes, "steer", "rider")}
        r = rolling(k, at["lean_angle"], 0.0, at["steer_angle"])
        pose = Pose(
            at["lean_angle"], 0.0, at["steer_angle"], at["lean_rate"], at["steer_rate"], speed,
            at["rider_lean"], at["rider_rate"],
        )  # fmt: skip
        forces = Forces(steer_torque=at["steer"], rider_torque=at["rider"])
        m = motion(k, pose, forces, r, leaning_rider=rider)
        found = {"lean_rate": m.lean, "steer_rate": m.steer, "heading_error": m.yaw_rate}
        if rider:
            found["rider_rate"] = m.rider
        return {name: np.imag(value) / tiny for name, value in found.items()}

    for name in axes:
        if name in place:
            for row, value in response(name).items():
                a[..., place[row], place[name]] = value
    for row, per_torque in response("steer").items():
        a[..., place[row], place["steer_rate"]] -= k.damping * per_torque
        if "motor_torque" in place:
            a[..., place[row], place["motor_torque"]] = per_torque
        else:
            b[..., place[row], 0] = per_torque
    if "motor_torque" in place:
        rate = 1.0 / np.maximum(np.asarray(p.motor.lag), 1e-4)
        a[..., place["motor_torque"], place["motor_torque"]] = -rate
        b[..., place["motor_torque"], 0] = rate
    if rider:
        for row, per_torque in response("rider").items():
            held = k.muscle_stiffness + k.muscle_weight + k.passive_stiffness
            a[..., place[row], place["rider_lean"]] -= held * per_torque
            a[..., place[row], place["lean_angle"]] -= k.muscle_weight * per_torque
            damped = k.muscle_damping + k.passive_damping
            a[..., place[row], place["rider_rate"]] -= damped * per_torque
            b[..., place[row], 1] += k.muscle_stiffness * k.muscle_gain * per_torque
    return a, b


def _discrete(
    p: Parameters, states: list[str], inputs: list[str], a: np.ndarray, b: np.ndarray
) -> Linear:
    whole, share = (np.atleast_1d(value) for value in delay_steps(p))
    if len(np.unique(whole)) > 1 or len(np.unique(share)) > 1:
        raise ValueError("a discrete model of bicycles whose delays differ has no common states")
    periods, early = int(whole[0]), float(share[0])
    first = _held(a, b, early * p.time_step)
    second = _held(a, b, (1.0 - early) * p.time_step)
    memory = periods + (early > 0.0)
    n, m = len(states), len(inputs)
    big_a = np.zeros((*a.shape[:-2], n + m * memory, n + m * memory))
    big_b = np.zeros((*a.shape[:-2], n + m * memory, m))
    big_a[..., :n, :n] = second[0] @ first[0]

    def rules(age: int, effect: np.ndarray) -> None:
        """Let the command of `age` periods before have that effect on the states."""
        if age == 0:
            big_b[..., :n, :] += effect
        else:
            big_a[..., :n, n + m * (age - 1) : n + m * age] += effect

    rules(periods, second[1])
    if early > 0.0:
        rules(periods + 1, second[0] @ first[1])
    if memory:
        big_b[..., n : n + m, :] = np.eye(m)
        big_a[..., n + m :, n : n + m * (memory - 1)] = np.eye(m * (memory - 1))
    names = [f"{name}[-{age}]" for age in range(1, memory + 1) for name in inputs]
    return Linear((*states, *names), tuple(inputs), big_a, big_b, p.time_step)


def _held(a: np.ndarray, b: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """State and input matrix over a time in which the input is held."""
    n, m = b.shape[-2:]
    both = np.zeros((*a.shape[:-2], n + m, n + m))
    both[..., :n, :n], both[..., :n, n:] = a, b
    grown = exponential(both * duration)
    return grown[..., :n, :n], grown[..., :n, n:]


def exponential(matrix: np.ndarray) -> np.ndarray:
    """Return exp of (..., n, n): Taylor's series of a small part, squared repeatedly."""
    norm = float(np.abs(matrix).sum(-1).max(initial=0.0))
    squarings = max(0, math.ceil(math.log2(norm / 0.25))) if norm > 0.25 else 0
    part = matrix / 2.0**squarings
    grown = np.broadcast_to(np.eye(matrix.shape[-1]), matrix.shape).copy()
    for n in range(14, 0, -1):
        grown = np.eye(matrix.shape[-1]) + part @ grown / n
    for _ in range(squarings):
        grown = grown @ grown
    return grown
