"""Fast forward pass of an actor for one bicycle, for the control loop.

`inference.cpp` needs one call. Numpy's dozen calls would leave the processor's cache between two
states, 25 ms apart; they are the fallback if the library is missing.
"""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from bicycle_common.native_library import load_built

Layer = tuple[np.ndarray, ...]
"""Weight (out, in), bias (out, 1) and, where there is a norm, its weight and bias (out, 1)."""

LIBRARY = "_inference"
"""Name of its file beside this one, without the suffix of Python extensions."""
LINE = 64
"""Bytes of a cache line."""


class Forward(Protocol):
    """Network for a single observation; not thread-safe."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return (1, 3) actions for one observation (1, 6), both in physical units."""
        ...


def forward_pass(
    layers: Sequence[Layer], scale: np.ndarray, limits: np.ndarray, epsilon: float
) -> Forward:
    """Return the fastest available implementation.

    Args:
        layers: of the network; weights and biases before a norm are centred.
        scale: (6,) divisors of the observations.
        limits: (3,) factors of the last layer's hyperbolic tangent.
        epsilon: added to the variance in layer normalisation.
    """
    weights = [layer[0].astype(np.float64) for layer in layers]
    weights[0] = weights[0] / scale
    scaled = [
        (weight.astype(np.float32), *(column[:, 0] for column in layer[1:]))
        for weight, layer in zip(weights, layers, strict=True)
    ]
    kind = NumpyForward if load() is None else NativeForward
    return kind(scaled, limits, epsilon)


class NumpyForward:
    """Few calls into preallocated memory; a bias is a column that is multiplied by one."""

    def __init__(self, layers: Sequence[Layer], limits: np.ndarray, epsilon: float) -> None:
        """Allocate memory; as `forward_pass`, but `layers` hold the scale and (out,) vectors."""
        self._matrices = [
            np.ascontiguousarray(np.column_stack(layer[:2]), dtype=np.float32) for layer in layers
        ]
        self._inputs = [np.ones(matrix.shape[1], dtype=np.float32) for matrix in self._matrices]
        self._norms = [(*layer[2:], np.empty_like(layer[1])) for layer in layers[:-1]]
        self._last = np.empty(len(limits), dtype=np.float32)
        self._limits = limits
        self._epsilon = epsilon

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """See `Forward`."""
        self._inputs[0][:-1] = observation[0]
        for index, norm in enumerate(self._norms):
            values = self._inputs[index + 1][:-1]
            np.dot(self._matrices[index], self._inputs[index], out=values)
            if len(norm) == 3:
                gain, offset, gained = norm
                variance = float(np.dot(values, values)) / len(values)
                np.multiply(gain, 1.0 / math.sqrt(variance + self._epsilon), out=gained)
                np.multiply(values, gained, out=values)
                np.add(values, offset, out=values)
            np.maximum(values, 0.0, out=values)
        np.dot(self._matrices[-1], self._inputs[-1], out=self._last)
        return (np.tanh(self._last) * self._limits)[None]


class _Layer(ctypes.Structure):
    """`Layer` of inference.cpp."""

    _fields_ = (
        ("blocks", ctypes.c_int),
        ("inputs", ctypes.c_int),
        ("outputs", ctypes.c_int),
        ("weights", ctypes.c_void_p * 2),
        ("bias", ctypes.c_void_p),
        ("gain", ctypes.c_void_p),
        ("offset", ctypes.c_void_p),
    )


class NativeForward:
    """One call of inference.cpp.

    A symmetric actor's second layer consists of two equal, unconnected halves: their zeros are
    skipped, and they share their memory.
    """

    def __init__(self, layers: Sequence[Layer], limits: np.ndarray, epsilon: float) -> None:
        """Allocate memory; see `NumpyForward`.

        Raises:
            RuntimeError: if the library was not built.
        """
        library = load()
        if library is None:
            raise RuntimeError("the native forward pass was not built: call ros2_ws/setup.sh")
        blocks = [_blocks(layer[0]) for layer in layers]
        vectors = [[_aligned(vector) for vector in layer[1:]] for layer in layers]
        widest = max(max(layer[0].shape) for layer in layers)
        widest += -widest % LINE
        memory = _aligned(np.zeros(2 * widest))
        self._observation = np.empty((1, layers[0][0].shape[1]))
        self._action = np.empty((1, len(limits)))
        table = (_Layer * len(layers))(*map(_layer, blocks, vectors))
        self._keep = blocks, vectors, memory, limits, table
        self._call = functools.partial(
            library.actor_forward,
            ctypes.byref(table),
            ctypes.c_int(len(layers)),
            ctypes.c_float(epsilon),
            _pointer(self._observation),
            _pointer(limits),
            _pointer(memory),
            ctypes.c_int(widest),
            _pointer(self._action),
        )

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """See `Forward`."""
        self._observation[:] = observation
        self._call()
        return self._action.copy()


@functools.cache
def load() -> ctypes.PyDLL | None:
    """Return the library built with the package, or None if it is missing or fails to load."""
    try:
        # PyDLL keeps the interpreter's lock: to reacquire it would cost more than the call.
        library = load_built(Path(__file__).parent, LIBRARY, lambda path: ctypes.PyDLL(str(path)))
    except OSError:
        return None
    library.actor_forward.restype = None
    return library


def _blocks(weight: np.ndarray) -> list[np.ndarray]:
    """Return the (in, out) matrices of the weight (out, in): itself, or two unconnected halves."""
    rows, columns = weight.shape[0] // 2, weight.shape[1] // 2
    first, second = weight[:rows, :columns], weight[rows:, columns:]
    across = weight[:rows, columns:], weight[rows:, :columns]
    if first.shape != second.shape or any(part.any() for part in across):
        return [_aligned(weight.T)]
    upper = _aligned(first.T)
    return [upper, upper if (first == second).all() else _aligned(second.T)]


def _aligned(array: np.ndarray) -> np.ndarray:
    """Return a row-major single-precision copy that is aligned to a cache line."""
    memory = np.empty(array.size + LINE, dtype=np.float32)
    first = -memory.ctypes.data % LINE // memory.itemsize
    copy = memory[first : first + array.size].reshape(array.shape)
    copy[...] = array
    return copy


def _layer(blocks: list[np.ndarray], vectors: list[np.ndarray]) -> _Layer:
    inputs, outputs = blocks[0].shape
    weights = (ctypes.c_void_p * 2)(*(block.ctypes.data for block in blocks))
    pointers = [vector.ctypes.data for vector in vectors]
    return _Layer(len(blocks), inputs, outputs, weights, *pointers)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
