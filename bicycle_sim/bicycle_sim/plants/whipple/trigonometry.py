"""Sine, cosine and exponential from products and sums alone, so that every processor agrees.

The functions of a C library differ in the last bit from one version and processor to the next. All
here take floats, numpy arrays or torch tensors, and `whipple.cpp` has the same operations in the
same order.
"""

from __future__ import annotations

import math

from bicycle_sim.plants.base import Array

_SINE = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(8))
_COSINE = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(9))


def sine_cosine(angle: Array) -> tuple[Array, Array]:
    """Sine and cosine of an angle of at most pi/2 either way, to 5e-16.

    Taylor's series of half the angle, whose first omitted term is below 1e-16, then the formulas
    of the double angle.
    """
    half = 0.5 * angle
    square = half * half
    sine, cosine = _SINE[-1], _COSINE[-1]
    for coefficient in _SINE[-2::-1]:
        sine = coefficient + square * sine
    for coefficient in _COSINE[-2::-1]:
        cosine = coefficient + square * cosine
    sine = half * sine
    return 2.0 * sine * cosine, 1.0 - 2.0 * (sine * sine)


def sine_cosine_of_turn(angle: Array) -> tuple[Array, Array]:
    """Sine and cosine of an angle of at most pi either way."""
    sine, cosine = sine_cosine(0.5 * angle)
    return 2.0 * sine * cosine, 1.0 - 2.0 * (sine * sine)


def decay(exponent: float) -> float:
    """Return exp(-exponent) for an exponent of zero or more."""
    halvings = 0
    while exponent > 0.5:
        exponent, halvings = 0.5 * exponent, halvings + 1
        if halvings > 12:
            return 0.0
    grown = 1.0
    for n in range(18, 0, -1):
        grown = 1.0 + grown * exponent / n
    left = 1.0 / grown
    for _ in range(halvings):
        left = left * left
    return left
