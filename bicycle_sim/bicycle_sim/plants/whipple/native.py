"""`integrate.advance` compiled: `whipple.cpp`, which is built with the package.

Where it was not built, numpy gives the same bits, some hundred times as slowly for one bicycle.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import numpy as np

from bicycle_sim.plants.whipple.constants import Constants
from bicycle_sim.plants.whipple.integrate import ROWS, Inputs

LIBRARY = "_whipple"
"""Its file beside this one, less the suffix of Python's extensions."""

LAYOUT = " / ".join(" ".join(names) for names in (Constants._fields, ROWS, Inputs._fields)) + " "
"""The rows that the library must have been built for."""


class Library:
    """The compiled step."""

    def __init__(self, path: Path) -> None:
        """Load it.

        Raises:
            OSError: when it is not there, or was built from other sources or for another machine.
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
            time_step: s of a whole control period.
            first: of the substeps to make.
            last: the one that is not made.
            extras: whether there are air, road, rolling resistance or loads.
            leaning_rider: whether there is a rider who leans.
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
    """The library that was built with the package, or None after one line that says so."""
    reason = "it was not built"
    for suffix in EXTENSION_SUFFIXES:
        path = Path(__file__).parent / f"{LIBRARY}{suffix}"
        if not path.exists():
            continue
        try:
            return Library(path)
        except OSError as error:
            reason = " ".join(str(error).split())[:200]
    print(
        f"the compiled Whipple step is not used ({reason}): numpy does it, more slowly; "
        "ros2_ws/setup.sh builds it",
        file=sys.stderr,
    )
    return None
