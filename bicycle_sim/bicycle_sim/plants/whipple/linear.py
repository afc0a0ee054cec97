"""The Whipple bicycle about riding straight and upright: matrices, eigenvalues, critical speeds.

M q'' + v C1 q' + (g K0 + v^2 K2) q = f with q = (lean, steer) and f the torques on them, after
Meijaard, Papadopoulos, Ruina and Schwab 2007, appendix A. Speeds are m/s, eigenvalues 1/s.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from bicycle_sim.plants.base import Array
from bicycle_sim.plants.whipple.parameters import Bicycle

FASTEST = 30.0
"""m/s up to which critical speeds are looked for."""


class Matrices(NamedTuple):
    """(2, 2), or (N, 2, 2) of N bicycles; rows and columns are lean and steer."""

    mass: np.ndarray
    """kg m^2 (M)."""
    damping: np.ndarray
    """kg m^2 / m, times the speed (C1)."""
    weight: np.ndarray
    """kg m, times gravity (K0)."""
    centrifugal: np.ndarray
    """kg, times the speed squared (K2)."""


def matrices(b: Bicycle) -> Matrices:
    """M, C1, K0 and K2 of a bicycle.

    Computed with more digits than a double has, where the processor offers them, and rounded once.
    """
    b = Bicycle(**{item.name: _extended(getattr(b, item.name)) for item in fields(b)})
    sine, cosine = np.sin(b.lam), np.cos(b.lam)
    x_moment = b.xB * b.mB + b.xH * b.mH + b.w * b.mF
    z_moment = (b.zB * b.mB + b.zH * b.mH) - (b.rR * b.mR + b.rF * b.mF)
    xx_total = (
        b.IRxx + b.IBxx + b.IHxx + b.IFxx
        + b.mR * b.rR**2 + b.mB * b.zB**2 + b.mH * b.zH**2 + b.mF * b.rF**2
    )  # fmt: skip
    xz_total = b.IBxz + b.IHxz - b.mB * b.xB * b.zB - b.mH * b.xH * b.zH + b.mF * b.w * b.rF
    zz_total = b.IRxx + b.IBzz + b.IHzz + b.IFxx + b.mB * b.xB**2 + b.mH * b.xH**2 + b.mF * b.w**2
    # The front assembly A: front frame and front wheel.
    front = b.mH + b.mF
    x_front = (b.xH * b.mH + b.w * b.mF) / front
    z_front = (b.zH * b.mH - b.rF * b.mF) / front
    xx = b.IHxx + b.IFxx + b.mH * (b.zH - z_front) ** 2 + b.mF * (b.rF + z_front) ** 2
    xz = (
        b.IHxz
        - b.mH * (b.xH - x_front) * (b.zH - z_front)
        + b.mF * (b.w - x_front) * (b.rF + z_front)
    )
    zz = b.IHzz + b.IFxx + b.mH * (b.xH - x_front) ** 2 + b.mF * (b.w - x_front) ** 2
    ahead = (x_front - b.w - b.c) * cosine - z_front * sine
    about_axis = front * ahead**2 + xx * sine**2 + 2 * xz * sine * cosine + zz * cosine**2
    axis_x = -front * ahead * z_front + xx * sine + xz * cosine
    axis_z = front * ahead * x_front + xz * sine + zz * cosine
    trail = b.c / b.w * cosine
    rear_spin, front_spin = _over(b.IRyy, b.rR), _over(b.IFyy, b.rF)
    spin = rear_spin + front_spin
    static = front * ahead + trail * x_moment
    zero = 0.0 * z_moment
    mass_across = axis_x + trail * xz_total
    return Matrices(
        mass=_matrix(
            xx_total, mass_across,
            mass_across, about_axis + 2 * trail * axis_z + trail**2 * zz_total,
        ),
        damping=_matrix(
            zero,
            trail * spin + front_spin * cosine + xz_total / b.w * cosine - trail * z_moment,
            -(trail * spin + front_spin * cosine),
            axis_z / b.w * cosine + trail * (static + zz_total / b.w * cosine),
        ),
        weight=_matrix(z_moment, -static, -static, -static * sine),
        centrifugal=_matrix(
            zero, (spin - z_moment) / b.w * cosine,
            zero, (static + front_spin * sine) / b.w * cosine,
        ),
    )  # fmt: skip


def _over(spin: Array, radius: Array) -> Array:
    """Return `spin` / `radius`; zero for a skate."""
    safe = np.where(np.equal(radius, 0.0), 1.0, radius)
    return np.where(np.equal(radius, 0.0), 0.0, spin / safe)


def _matrix(a: Array, b: Array, c: Array, d: Array) -> np.ndarray:
    a, b, c, d = np.broadcast_arrays(a, b, c, d)
    return np.stack([np.stack([a, b], -1), np.stack([c, d], -1)], -2).astype(float)


def _extended(value: Array) -> np.ndarray:
    return np.asarray(value, dtype=np.longdouble)


def state_matrix(b: Bicycle, speed: Array) -> np.ndarray:
    """Return matrices (..., 4, 4) of d/dt (lean, steer, lean rate, steer rate) at speeds."""
    m = matrices(b)
    v = np.asarray(speed, dtype=float)[..., None, None]
    g = np.asarray(b.g)[..., None, None]
    stiffness = np.linalg.solve(m.mass, g * m.weight + v**2 * m.centrifugal)
    damping = np.linalg.solve(m.mass, v * m.damping)
    a = np.zeros((*stiffness.shape[:-2], 4, 4))
    a[..., 0, 2] = a[..., 1, 3] = 1.0
    a[..., 2:, :2], a[..., 2:, 2:] = -stiffness, -damping
    return a


def eigenvalues(b: Bicycle, speed: Array) -> np.ndarray:
    """Return eigenvalues (..., 4), complex, at speeds (...), the largest real part first."""
    found = np.linalg.eigvals(state_matrix(b, speed))
    order = np.lexsort((-found.imag, -np.round(found.real, 9)), axis=-1)
    return np.take_along_axis(found, order, axis=-1)


MODES = ("weave", "capsize", "castering")
"""The motions of a bicycle, by the names that the literature has for them."""


def modes(b: Bicycle, speed: Array) -> dict[str, np.ndarray]:
    """Return eigenvalues at speeds (K,) by the names of MODES.

    Returns:
        `weave` (K, 2), a pair that is real at walking speed and complex above; `castering` (K,),
        the most negative of the rest; `capsize` (K,), the other. The last two are a complex pair
        where two pairs oscillate.
    """
    found = np.linalg.eigvals(state_matrix(b, np.asarray(speed, dtype=float)))
    pairs = [_weave_first(row) for row in np.atleast_2d(found)]
    weave, rest = (np.array(part) for part in zip(*pairs, strict=True))
    return {"weave": weave, "capsize": rest[:, 1], "castering": rest[:, 0]}


def _weave_first(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the weave's pair and the rest, each with the larger imaginary or real part first."""
    swings = np.abs(values.imag) > 1e-9 * np.abs(values).max()
    if swings.sum() == 2 and values[~swings].real.min() < values[swings].real[0]:
        pair, rest = values[swings], values[~swings]
    else:
        # Two pairs, or none: those that are the least damped.
        order = np.argsort(-values.real)
        pair, rest = values[order[:2]], values[order[2:]]
    return pair[np.lexsort((-pair.real, -pair.imag))], rest[np.lexsort((rest.imag, rest.real))]


@dataclass(frozen=True)
class CriticalSpeeds:
    """m/s at which something changes; each rising, empty where it never does below FASTEST."""

    double_root: tuple[float, ...]
    """Two real eigenvalues meet and become the weave's pair, or the other way round."""
    weave: tuple[float, ...]
    """The weave's damping changes sign."""
    capsize: tuple[float, ...]
    """A real eigenvalue changes sign."""
    stable: tuple[tuple[float, float], ...]
    """Ranges in which the bicycle balances itself; inf where one has no end below FASTEST."""


def critical_speeds(b: Bicycle) -> CriticalSpeeds:
    """Return the critical speeds of one bicycle."""
    terms = _characteristic(b)
    a0, a1, a2, a3, a4 = terms
    product = np.polynomial.polynomial.polymul

    def times(*factors: np.ndarray) -> np.ndarray:
        polynomial = np.ones(1)
        for factor in factors:
            polynomial = product(polynomial, factor)
        return polynomial

    def difference(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        polynomial: np.ndarray = np.polynomial.polynomial.polysub(one, other)
        return polynomial

    # An imaginary pair: Routh and Hurwitz' last determinant.
    hurwitz = difference(times(a1, difference(times(a2, a3), times(a1, a4))), times(a0, a3, a3))
    weave = []
    for v in _positive_roots(hurwitz):
        p1, p3 = (float(np.polynomial.polynomial.polyval(v, term)) for term in (a1, a3))
        if p3 != 0.0 and p1 / p3 > 0.0:
            weave.append(v)
    capsize = _positive_roots(a0)
    return CriticalSpeeds(
        double_root=tuple(v for v, _ in double_roots(b)),
        weave=tuple(weave),
        capsize=tuple(capsize),
        stable=_stable(b, sorted([*weave, *capsize])),
    )


def _characteristic(b: Bicycle) -> list[np.ndarray]:
    """Return the characteristic polynomial's coefficients of s^0 to s^4, polynomials in v."""
    m = matrices(b)
    # entry[i][j][power of s][power of v]
    entry = np.zeros((2, 2, 3, 3))
    entry[:, :, 2, 0] = m.mass
    entry[:, :, 1, 1] = m.damping
    entry[:, :, 0, 0] = float(b.g) * m.weight
    entry[:, :, 0, 2] = m.centrifugal
    result = np.zeros((5, 5))
    for s1 in range(3):
        for s2 in range(3):
            across = np.convolve(entry[0, 0, s1], entry[1, 1, s2])
            result[s1 + s2] += across - np.convolve(entry[0, 1, s1], entry[1, 0, s2])
    return list(result)


def _positive_roots(polynomial: np.ndarray) -> list[float]:
    """Real roots between 0 and FASTEST, rising; each polished by Newton's method."""
    trimmed = np.trim_zeros(polynomial, "b")
    roots = np.polynomial.polynomial.polyroots(trimmed) if len(trimmed) > 1 else np.zeros(0)
    slope = np.polynomial.polynomial.polyder(polynomial)
    value = np.polynomial.polynomial.polyval
    found: list[float] = []
    for root in sorted(r.real for r in roots if abs(r.imag) < 1e-6 * (1.0 + abs(r))):
        for _ in range(3):
            steepness = float(value(root, slope))
            if steepness:
                root -= float(value(root, polynomial)) / steepness
        if 1e-6 < root < FASTEST and not any(abs(root - other) < 1e-6 for other in found):
            found.append(float(root))
    return found


def double_roots(b: Bicycle) -> list[tuple[float, float]]:
    """Return speeds at which two real eigenvalues meet above zero, and that eigenvalue."""
    terms = np.array(_characteristic(b))
    speeds = np.linspace(0.0, 10.0, 2001)
    pairs = np.count_nonzero(np.abs(eigenvalues(b, speeds).imag) > 1e-9, axis=1)
    found = []
    for index in np.flatnonzero(np.diff(pairs)):
        v = 0.5 * (speeds[index] + speeds[index + 1])
        near = eigenvalues(b, v)
        s = float(near[np.argmax(near.real)].real)
        for _ in range(50):
            powers_v, powers_s = v ** np.arange(5), s ** np.arange(5)
            in_v = np.arange(5) * np.concatenate([[0.0], powers_v[:-1]])
            in_s = np.arange(5) * np.concatenate([[0.0], powers_s[:-1]])
            in_ss = np.arange(5) * np.concatenate([[0.0], in_s[:-1]])
            rows = terms @ powers_v
            rows_v = terms @ in_v
            value = np.array([powers_s @ rows, in_s @ rows])
            jacobian = np.array([[powers_s @ rows_v, in_s @ rows], [in_s @ rows_v, in_ss @ rows]])
            try:
                change = np.linalg.solve(jacobian, value)
            except np.linalg.LinAlgError:
                break
            v, s = v - float(change[0]), s - float(change[1])
            if np.abs(change).max() < 1e-15 * (1.0 + abs(s)):
                break
        if abs(v - speeds[index]) < 0.02 and s > 0.0:
            found.append((float(v), s))
    return found


def _stable(b: Bicycle, marks: list[float]) -> tuple[tuple[float, float], ...]:
    """Return the ranges between `marks` in which no eigenvalue has a real part above zero."""
    ranges: list[tuple[float, float]] = []
    edges = [0.0, *marks, FASTEST]
    for low, high in itertools.pairwise(edges):
        if high - low < 1e-9 or eigenvalues(b, 0.5 * (low + high)).real.max() >= 0.0:
            continue
        if ranges and ranges[-1][1] == low:
            low = ranges.pop()[0]
        ranges.append((low, high))
    if ranges and ranges[-1][1] == FASTEST:
        ranges[-1] = (ranges[-1][0], math.inf)
    return tuple(ranges)
