"""The one loader of libraries in C++; what uses it is tested beside each library."""

from __future__ import annotations

import ctypes
import shutil
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from bicycle_common import native_library
from bicycle_common.native_library import compiled, load_built, load_or_tell, one_line

FLAGS = ("-shared", "-fPIC")
SOURCES = {"sum.cpp": b'#include "one.h"\nextern "C" int two() { return ONE + ONE; }\n'}
HEADER = {"one.h": b"#define ONE 1\n"}


def test_a_library_that_was_not_built_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="it was not built"):
        load_built(tmp_path, "_absent", lambda path: ctypes.CDLL(str(path)))


def test_the_reason_of_a_library_that_does_not_load_is_kept(tmp_path: Path) -> None:
    (tmp_path / f"_broken{EXTENSION_SUFFIXES[0]}").write_text("no library")
    with pytest.raises(OSError, match="_broken") as found:
        load_built(tmp_path, "_broken", lambda path: ctypes.CDLL(str(path)))
    assert "\n" not in one_line(found.value)


def test_who_has_numpy_instead_is_told_so_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert load_or_tell(tmp_path, "_absent", lambda path: ctypes.CDLL(str(path)), "sum") is None
    expected = "the compiled sum is not used (it was not built): numpy does it, more slowly; "
    assert capsys.readouterr().err == f"{expected}ros2_ws/setup.sh builds it\n"


@pytest.mark.skipif(not any(map(shutil.which, native_library.COMPILERS)), reason="no compiler")
def test_a_change_of_source_or_flags_is_compiled_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = compiled(SOURCES | HEADER, FLAGS)
    assert path.parent == tmp_path / "bicycle"
    assert ctypes.CDLL(str(path)).two() == 2
    other = compiled(SOURCES | {"one.h": b"#define ONE 3\n"}, FLAGS)
    assert ctypes.CDLL(str(other)).two() == 6
    assert compiled(SOURCES | HEADER, (*FLAGS, "-O2")) not in (path, other)
    monkeypatch.setattr(native_library, "COMPILERS", ())
    assert compiled(SOURCES | HEADER, FLAGS) == path, "it is kept"
    with pytest.raises(FileNotFoundError, match=r"there is no C\+\+ compiler"):
        compiled(SOURCES, FLAGS)
