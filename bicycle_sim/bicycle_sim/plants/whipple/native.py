"""`integrate.advance` compiled: `whipple.cpp`, which is built with the package.

If it was not built, numpy gives the same bits, about a hundred times slower for one bicycle.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path

import numpy as np

from bicycle_common.native_library import load_or_tell
from bicycle_sim.plants.whipple.constants import Constants
from bicycle_sim.plants.whipple.integrate import ROWS, Inputs

LIBRARY = "_whipple"
"""Name of its file beside this one, without the suffix of Python extensions."""

LAYOUT = " / ".join(" ".join(names) for names in (Constants._fields, ROWS, Inputs._fields)) + " "
"""Rows that the library must have been built for."""


class Library:
    """Compiled step."""

    def __init__(self, path: Path) -> None:
        """Load it.

        Raises:
            OSError: if it is missing, or was built from other sources or for another machine.
        """
        library = ctypes.CDLL(str(path))
        library.whipple_rows.restype = ctypes.c_char_p
        if library.whipple_rows().decode() != LAYOUT:
            raise OSError(f"{path} was built from other sources: call ros2_ws/setup.sh --force")
        self._advance = library.whipple_advance
        self._advance.restype = None
        self._advance.argtypes = [
            ctypes.c_void_p,
            ctypes.c_long,
            ctypes.c_void_p,
            ctypes.c_void_p,
            ctypes.c_void_p,
            ctypes.c_long,
            ctypes.c_int,
            ctypes.c_double,
            *[ctypes.c_int] * 5,
        ]
        self.width = int(library.whipple_width())
        """2 for AVX-512, 1 for AVX2, 0 for neither; a narrower one may be set."""

    def advance(
        self,
        table: np.ndarray,
        state: np.ndarray,
        inputs: Inputs,
        substeps: int,
        time_step: float,
        first: int,
        last: int,
        extras: bool,
        leaning_rider: bool,
    ) -> None:
        """See `integrate.advance`; `state` (rows, N) is changed in place.

        Args:
            table: (rows, N) or (rows, 1) constants.
            state: (rows, N), see ROWS.
            inputs: each (N,) or (1,).
            substeps: of a whole control period.
            time_step: whole control period, s.
            first: first substep to make.
            last: first substep that is not made.
            extras: True if there are air, road, rolling resistance or loads.
            leaning_rider: True if there is a rider who leans.
        """
        rows = [np.ascontiguousarray(row, dtype=float) for row in inputs]
        addresses = np.array([row.ctypes.data for row in rows], dtype=np.uintp)
        lengths = np.array([row.size for row in rows], dtype=np.int_)
        self._advance(
            table.ctypes.data,
            table.shape[1],
            state.ctypes.data,
            addresses.ctypes.data,
            lengths.ctypes.data,
            state.shape[1],
            substeps,
            time_step,
            first,
            last,
            extras,
            leaning_rider,
            self.width,
        )


@functools.cache
def load() -> Library | None:
    """Return the library built with the package, or None after one line on standard error."""
    return load_or_tell(Path(__file__).parent, LIBRARY, Library, "Whipple step")
