"""One bicycle in plain Python, as in Randlov & Alstrom's program: the reference of tests.

It follows the errata table's section on their equations word for word, radii, large constant
and all, and shares no code with `bicycle_sim.plants.choi.dynamics`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

C, D_CM, H, L, R = 0.66, 0.30, 0.94, 1.11, 0.34
M_C, M_D, M_P, G = 15.0, 1.7, 60.0, 9.82
M = M_C + M_P
I = 13.0 / 3.0 * M_C * H * H + M_P * (H + D_CM) ** 2  # noqa: E741
I_DC, I_DV, I_DL = M_D * R * R, 1.5 * M_D * R * R, 0.5 * M_D * R * R
HUGE = 1e7
STOP = 1.3963


@dataclass(frozen=True)
class Bicycle:
    omega: float = 0.0
    omega_dot: float = 0.0
    omega_dot_dot: float = 0.0
    theta: float = 0.0
    theta_dot: float = 0.0
    psi: float = 0.0
    x_f: float = 0.0
    y_f: float = L
    x_b: float = 0.0
    y_b: float = 0.0
    v: float = 10.0 / 3.6

    @classmethod
    def heading(cls, psi: float, **values: float) -> Bicycle:
        return cls(psi=psi, x_f=-L * math.sin(psi), y_f=L * math.cos(psi), **values)


def sign(value: float) -> int:
    return (value > 0) - (value < 0)


def step(b: Bicycle, torque: float, d: float, force: float, dt: float = 0.025) -> Bicycle:
    v = b.v + dt * 0.2 * force / 76.7
    sigma_dot = v / R
    r_f = r_b = r_cm = HUGE
    if b.theta != 0.0:
        r_f = L / abs(math.sin(b.theta))
        r_b = L / abs(math.tan(b.theta))
        r_cm = math.sqrt((L - C) ** 2 + L**2 / math.tan(b.theta) ** 2)
    phi = b.omega + math.atan(d / H)
    turning = sign(b.theta) * v * v * (M_D * R / r_f + M_D * R / r_b + M * H / r_cm)
    sideways = I_DC * sigma_dot * b.theta_dot + turning
    omega_dot_dot = (M * H * G * math.sin(phi) - math.cos(phi) * sideways) / I
    theta_dot_dot = (torque - I_DV * sigma_dot * b.omega_dot) / I_DL

    omega_dot = b.omega_dot + omega_dot_dot * dt
    omega = b.omega + omega_dot * dt
    theta_dot = b.theta_dot + theta_dot_dot * dt
    theta = min(max(b.theta + theta_dot * dt, -STOP), STOP)

    travel = v * dt
    front = b.psi + theta
    front += sign(front) * half_chord(travel, r_f)
    rear = b.psi + sign(b.psi) * half_chord(travel, r_b)
    x_f, y_f = b.x_f - travel * math.sin(front), b.y_f + travel * math.cos(front)
    x_b, y_b = b.x_b - travel * math.sin(rear), b.y_b + travel * math.cos(rear)
    apart = math.hypot(x_f - x_b, y_f - y_b)
    if abs(apart - L) > 0.01:
        x_b += (x_b - x_f) * (L - apart) / apart
        y_b += (y_b - y_f) * (L - apart) / apart
    return replace(
        b,
        omega=omega,
        omega_dot=omega_dot,
        omega_dot_dot=omega_dot_dot,
        theta=theta,
        theta_dot=theta_dot,
        psi=math.atan2(x_b - x_f, y_f - y_b),
        x_f=x_f,
        y_f=y_f,
        x_b=x_b,
        y_b=y_b,
        v=v,
    )


def half_chord(travel: float, radius: float) -> float:
    ratio = travel / (2.0 * radius)
    return math.pi / 2 if ratio > 1.0 else math.asin(ratio)
