"""An actor's forward pass for one bicycle: few calls, each into memory that is there already.

At this size numpy spends as long on calling as on reckoning, so what can be is reckoned once:
observations are scaled by the first weights, and biases are columns that meet a constant one.
A symmetric actor's second layer is two halves that are not connected, and alike: half the weights
are zeros, and the halves share their memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

Layer = tuple[np.ndarray, ...]
"""Weight (out, in), bias (out, 1) and, where there is a norm, its weight and bias (out, 1)."""


class OneBicycle:
    """The network of a `Policy` for a single observation."""

    def __init__(
        self, layers: Sequence[Layer], scale: np.ndarray, limits: np.ndarray, epsilon: float
    ) -> None:
        """Prepare weights and memory.

        Args:
            layers: of the network; weights and biases that a norm follows are centred.
            scale: (6,) that observations are divided by.
            limits: (3,) that the last layer's hyperbolic tangent is multiplied by.
            epsilon: added to the variance in layer normalisation.
        """
        weights = [layer[0].astype(np.float64) for layer in layers]
        weights[0] = weights[0] / scale
        self._matrices = [
            np.ascontiguousarray(np.hstack((weight, layer[1])), dtype=np.float32)
            for weight, layer in zip(weights, layers, strict=True)
        ]
        self._inputs = [np.ones(matrix.shape[1], dtype=np.float32) for matrix in self._matrices]
        self._observation = self._inputs[0][:-1]
        self._hidden = [
            (*_products(matrix, inputs, outputs[:-1]), outputs[:-1], _norm(layer))
            for matrix, inputs, outputs, layer in zip(
                self._matrices, self._inputs, self._inputs[1:], layers, strict=False
            )
        ]
        self._last = np.empty(len(limits), dtype=np.float32)
        self._limits = limits
        self._epsilon = epsilon

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """(3,) actions of one observation (6,), both in physical units."""
        self._observation[:] = observation
        for products, bias, values, norm in self._hidden:
            for matrix, inputs, outputs in products:
                np.dot(matrix, inputs, out=outputs)
            if bias is not None:
                np.add(values, bias, out=values)
            if norm is not None:
                gain, offset, gained = norm
                variance = float(np.dot(values, values)) / len(values)
                np.multiply(gain, 1.0 / math.sqrt(variance + self._epsilon), out=gained)
                np.multiply(values, gained, out=values)
                np.add(values, offset, out=values)
            np.maximum(values, 0.0, out=values)
        np.dot(self._matrices[-1], self._inputs[-1], out=self._last)
        return np.tanh(self._last) * self._limits


def _products(
    matrix: np.ndarray, inputs: np.ndarray, outputs: np.ndarray
) -> tuple[list[tuple[np.ndarray, np.ndarray, np.ndarray]], np.ndarray | None]:
    """Matrix, input and output of each product that makes a layer, and a bias to add to them.

    One product with the bias in it, or two of a half each where the halves are not connected.
    """
    rows, columns = matrix.shape[0] // 2, (matrix.shape[1] - 1) // 2
    first, second = matrix[:rows, :columns], matrix[rows:, columns:-1]
    across = matrix[:rows, columns:-1], matrix[rows:, :columns]
    if first.shape != second.shape or any(part.any() for part in across):
        return [(matrix, inputs, outputs)], None
    upper = np.ascontiguousarray(first)
    lower = upper if (first == second).all() else np.ascontiguousarray(second)
    halves = [
        (upper, inputs[:columns], outputs[:rows]),
        (lower, inputs[columns:-1], outputs[rows:]),
    ]
    return halves, np.ascontiguousarray(matrix[:, -1])


def _norm(layer: Layer) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Gain and bias of a layer's norm (out,), and memory for the product with the first."""
    if len(layer) == 2:
        return None
    return layer[2][:, 0].copy(), layer[3][:, 0].copy(), np.empty(len(layer[2]), dtype=np.float32)
