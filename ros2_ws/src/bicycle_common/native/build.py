"""Building of the libraries in C++, the one way for the setup.py of every package.

Their sources stand beside the Python code whose bits they repeat. The headers that several of them
include are here. A setup.py runs this file from beside its own package, because pip builds each
package where no other one is installed.
"""

from __future__ import annotations

from pathlib import Path

from setuptools import Extension

HERE = Path(__file__).resolve().parent
FLAGS = (
    "-O3",
    # No flag may change a result: products and sums are rounded one by one.
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-std=c++17",
)


def library(name: str, source: str, *headers: str) -> Extension:
    """Return a plain shared library, which ctypes loads; numpy is the fallback without a compiler.

    Args:
        name: of the module's place, such as `bicycle_sim.task._native_task`.
        source: C++ file, below the folder of setup.py.
        headers: of the same package that it includes; those beside this file need not be named.
    """
    shared = sorted(map(str, HERE.glob("*.h")))
    return Extension(
        name,
        [source],
        depends=[*headers, *shared],
        include_dirs=[str(HERE)],
        extra_compile_args=list(FLAGS),
        optional=True,
    )
