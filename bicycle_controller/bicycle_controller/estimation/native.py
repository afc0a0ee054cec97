"""`arithmetic` compiled: `estimator.cpp`, which is built with the package.

If it was not built, numpy gives the same bits, about ten times slower for one bicycle.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.native_library import load_or_tell
from bicycle_controller.estimation.arithmetic import (
    Arithmetic,
    Belief,
    Expected,
    ImuReadings,
    Numbers,
)
from bicycle_controller.estimation.model import Model
from bicycle_controller.estimation.states import STATES

LIBRARY = "_estimator"
"""Name of its file beside this one, without the suffix of Python extensions."""
LAYOUT = " ".join(Numbers._fields) + " "
"""Numbers that the library must have been built for."""


class _Bicycles(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_long),
        ("kinds", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("powers", "per", "friction", "pitch", "numbers")),
        *((name, ctypes.c_void_p) for name in ("state", "covariance", "course")),
        *((name, ctypes.c_void_p) for name in ("torque", "moving")),
    )


class Library:
    """Compiled functions."""

    def __init__(self, path: Path) -> None:
        """Load them.

        Raises:
            OSError: if the file is missing, or was built from other sources or for another
                machine.
        """
        library = ctypes.CDLL(str(path))
        library.estimator_layout.restype = ctypes.c_char_p
        if library.estimator_layout().decode() != LAYOUT:
            raise OSError(f"{path} was built from other sources: call ros2_ws/setup.sh --force")
        pointer, number = ctypes.c_void_p, ctypes.c_double
        self.rates = library.estimator_rates
        self.move = library.estimator_move
        self.predict = library.estimator_predict
        self.expected = library.estimator_expected
        self.correct = library.estimator_correct
        arguments: tuple[tuple[Any, list[Any]], ...] = (
            (self.rates, [pointer] * 3),
            (self.move, [pointer, pointer, number]),
            (self.predict, [pointer, number]),
            (self.expected, [pointer, ctypes.c_int, *[pointer] * 4]),
            (self.correct, [*[pointer] * 5, number, pointer]),
        )
        for function, types in arguments:
            function.argtypes, function.restype = types, None


@functools.cache
def load() -> Library | None:
    """Return the library built with the package, or None after one line on standard error."""
    return load_or_tell(Path(__file__).parent, LIBRARY, Library, "estimator")


class NativeArithmetic(Arithmetic):
    """`Arithmetic`, compiled."""

    def __init__(self, model: Model, numbers: Numbers, belief: Belief, library: Library) -> None:
        """Point at the belief's arrays.

        Args:
            model: of the bicycles.
            numbers: settings.
            belief: of the bicycles; `predict` and `correct` change it.
            library: the compiled functions.
        """
        super().__init__(model, numbers, belief)
        self._library = library
        count, width = belief.state.shape
        # Compiled code reads and writes these: finding an array's address costs more than a copy.
        self._state, self._change = np.zeros((count, width)), np.zeros((count, width))
        self._found = np.zeros((count, 3))
        self._error, self._mask = np.zeros(count), np.zeros(count, dtype=bool)
        self._expected = Expected(np.zeros(count), np.zeros((count, len(STATES))), np.zeros(count))
        value, slopes, noise = map(_address, self._expected)
        state, error, mask = map(_address, (self._state, self._error, self._mask))
        # Kept, for the structure only points to them.
        self._constants = [
            np.ascontiguousarray(a, dtype=float)
            for a in (model.powers, model.torque, model.friction, model.pitch, numbers)
        ]
        b = belief
        changing = (b.state, b.covariance, b.course_covariance, b.torque, b.moving)
        self._bicycles = _Bicycles(
            count,
            model.torque.shape[0],
            *(_address(a) for a in (*self._constants, *changing)),
        )
        self._all = ctypes.addressof(self._bicycles)
        self._for_expected = state, value, slopes, noise
        self._for_correct = error, slopes, noise, mask
        self._for_change = _address(self._change)
        self._for_rates = state, _address(self._found)
        self._for_move = state

    def rates(self, state: np.ndarray) -> np.ndarray:
        """See `Arithmetic.rates`."""
        self._state[:] = state
        self._library.rates(self._all, *self._for_rates)
        return self._found.copy()

    def move(self, state: np.ndarray, dt: float) -> None:
        """See `Arithmetic.move`."""
        self._state[:] = state
        self._library.move(self._all, self._for_move, dt)
        state[:] = self._state

    def predict(self, dt: float) -> None:
        """See `Arithmetic.predict`."""
        self._library.predict(self._all, dt)

    def expected(self, what: ImuReadings, then: np.ndarray) -> Expected:
        """See `Arithmetic.expected`."""
        self._state[:] = then
        self._library.expected(self._all, what, *self._for_expected)
        return self._expected

    def correct(
        self,
        error: np.ndarray,
        slopes: np.ndarray,
        noise: np.ndarray,
        mask: np.ndarray,
        gate: float,
    ) -> np.ndarray:
        """See `Arithmetic.correct`."""
        self._error[:] = error
        self._mask[:] = mask
        if slopes is not self._expected.slopes:
            self._expected.slopes[:] = slopes
        if noise is not self._expected.noise:
            self._expected.noise[:] = noise
        self._library.correct(self._all, *self._for_correct, gate, self._for_change)
        return self._change


def _address(array: np.ndarray) -> int:
    """Return where the numbers of a contiguous array begin."""
    return int(array.__array_interface__["data"][0])


def arithmetic(model: Model, numbers: Numbers, belief: Belief) -> Arithmetic:
    """Return the fastest arithmetic that there is; all give the same bits."""
    library = load()
    if library is None:
        return Arithmetic(model, numbers, belief)
    return NativeArithmetic(model, numbers, belief, library)
