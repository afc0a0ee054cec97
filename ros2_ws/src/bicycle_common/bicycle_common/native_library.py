"""Libraries in C and C++: find the one that set-up built, or compile one at first use.

Most are built with their package by `../native/build.py`: a robot may have no compiler. Only what
is never needed on a robot is compiled at first use, for the processor it runs on. Each has a
fallback in Python, so whoever loads one catches OSError.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import TypeVar

Library = TypeVar("Library")

COMPILERS = ("c++", "g++", "clang++")
C_COMPILERS = ("cc", "gcc", "clang")
PATIENCE = 120
"""Time limit of the compiler (s)."""


def load_built(folder: Path, name: str, load: Callable[[Path], Library]) -> Library:
    """Load the library that was built with a package.

    Args:
        folder: of the module that uses it.
        name: of its file there, without the suffix of Python extensions.
        load: loads a file, such as `ctypes.PyDLL`; raises OSError if it cannot be used.

    Raises:
        OSError: if the library is missing, built for another machine or refused by `load`.
    """
    reason = OSError("it was not built")
    for suffix in EXTENSION_SUFFIXES:
        path = folder / f"{name}{suffix}"
        if not path.exists():
            continue
        try:
            return load(path)
        except OSError as error:
            reason = error
    raise reason


def load_or_tell(
    folder: Path, name: str, load: Callable[[Path], Library], what: str
) -> Library | None:
    """Load as `load_built` does; without it, tell in one line that numpy does the work instead.

    Args:
        folder: as there.
        name: as there.
        load: as there.
        what: the library does, for the line.
    """
    try:
        return load_built(folder, name, load)
    except OSError as error:
        print(
            f"the compiled {what} is not used ({one_line(error)}): numpy does it, more slowly; "
            "ros2_ws/setup.sh builds it",
            file=sys.stderr,
        )
        return None


def compiled(
    sources: Mapping[str, bytes], flags: Sequence[str], libraries: Sequence[str] = ()
) -> Path:
    """Return a library or a program in the user's cache; compile it if it is missing.

    Args:
        sources: content by file name; those that are no headers are compiled together.
        flags: the compiler's flags; with `-shared` it is a library.
        libraries: flags for the linker, behind the sources.

    Raises:
        OSError: if there is no compiler, it fails, or no folder is writable.
        subprocess.TimeoutExpired: if compiling takes too long.
    """
    about = (" ".join((*flags, *libraries)) + _processor()).encode()
    mark = hashlib.sha256(b"".join([*sources.values(), about]))
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "bicycle"
    suffix = ".so" if "-shared" in flags else ""
    path = root / f"native-{mark.hexdigest()[:16]}{suffix}"
    if path.exists():
        return path
    units = [name for name in sources if not name.endswith((".h", ".hpp"))]
    in_c = all(name.endswith(".c") for name in units)
    compiler = next(filter(None, map(shutil.which, C_COMPILERS if in_c else COMPILERS)), None)
    if compiler is None:
        raise FileNotFoundError(f"there is no {'C' if in_c else 'C++'} compiler")
    root.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=root) as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_bytes(text)
        result = Path(folder) / "native.so"
        words = [compiler, *flags, "-o", str(result), *units, *libraries]
        done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE, cwd=folder)
        if done.returncode != 0:
            said = [line for line in done.stderr.splitlines() if line.strip()] or ["no message"]
            raise OSError(f"{compiler} ended with status {done.returncode}: {said[0]}")
        result.replace(path)
    return path


def one_line(error: Exception) -> str:
    """Return the reason for a message: one line of at most 200 characters."""
    return " ".join(str(error).split())[:200]


def _processor() -> str:
    """Return a key of everything that the machine code depends on."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    kinds = ("flags", "Features", "model name")
    return platform.machine() + "".join(sorted({n for n in lines if n.startswith(kinds)}))
