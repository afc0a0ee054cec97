"""Message definitions from the installed packages, as rosbag2 embeds them in a bag."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from bicycle_bag.errors import BagError

INTEGERS = tuple(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
PRIMITIVES = frozenset(
    ("bool", "byte", "char", "float32", "float64", "string", "wstring", *INTEGERS)
)
SEPARATOR = "=" * 80
_FIELD = re.compile(
    r"^\s*(?P<type>[A-Za-z][\w/]*)(?P<bound><=\d+)?(?P<array>\[[^\]]*\])?\s+(?P<name>[A-Za-z]\w*)"
    r"\s*(?P<constant>=)?"
)
_TYPE_NAME = re.compile(r"[A-Za-z]\w*/msg/[A-Za-z]\w*")


class Field(NamedTuple):
    """One field of a message definition; `array` holds its brackets, or nothing."""

    type: str
    array: str
    name: str


def fields(definition: str) -> Iterator[Field]:
    """Yield the fields of one `.msg` text, in order, without its constants."""
    for line in definition.splitlines():
        match = _FIELD.match(line.split("#", 1)[0])
        if match and not match["constant"]:
            yield Field(match["type"], match["array"] or "", match["name"])


def dependencies(definition: str, package: str) -> list[str]:
    """Return names `pkg/Type` of the messages that a definition uses, sorted, each once."""
    used = {field.type for field in fields(definition) if field.type not in PRIMITIVES}
    return sorted(name if "/" in name else f"{package}/{name}" for name in used)


class Schemas:
    """Finds definitions in the `share` folders of installed packages.

    Args:
        prefixes: Install prefixes, the first that holds a package wins; by default those of
            `AMENT_PREFIX_PATH`.
    """

    def __init__(self, prefixes: Sequence[Path] | None = None) -> None:
        if prefixes is None:
            named = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
            prefixes = [Path(name) for name in named if name]
        self._prefixes = tuple(prefixes)
        self._text = cache(self._read)

    def definition(self, type_name: str) -> str:
        """Return the `ros2msg` text of `pkg/msg/Type`: its definition, then its dependencies'.

        Raises:
            BagError: No installed package defines the type or one that it uses.
        """
        package, name = self._split(type_name)
        seen: set[str] = set()
        return self._with_dependencies(f"{package}/{name}", seen)

    def type_hash(self, type_name: str) -> str:
        """Return the type's hash `RIHS01_…`, or an empty string where none is installed."""
        package, name = self._split(type_name)
        path = self._find(package, f"{name}.json")
        if path is None:
            return ""
        for entry in json.loads(path.read_text(encoding="utf-8"))["type_hashes"]:
            if entry["type_name"] == type_name:
                return str(entry["hash_string"])
        return ""

    def _with_dependencies(self, name: str, seen: set[str]) -> str:
        text = self._text(name)
        result = text
        for used in dependencies(text, name.split("/")[0]):
            if used not in seen:
                seen.add(used)
                nested = self._with_dependencies(used, seen)
                result += f"\n{SEPARATOR}\nMSG: {used}\n{nested}"
        return result

    def _read(self, name: str) -> str:
        package, short = name.split("/")
        path = self._find(package, f"{short}.msg")
        if path is None:
            raise BagError(
                f"no definition of {package}/msg/{short} in AMENT_PREFIX_PATH: "
                "source the workspace that has it"
            )
        return path.read_text(encoding="utf-8")

    def _find(self, package: str, file_name: str) -> Path | None:
        for prefix in self._prefixes:
            path = prefix / "share" / package / "msg" / file_name
            if path.is_file():
                return path
        return None

    @staticmethod
    def _split(type_name: str) -> tuple[str, str]:
        if not _TYPE_NAME.fullmatch(type_name):
            raise BagError(f"{type_name!r} is not a message type: write it as package/msg/Type")
        package, _, name = type_name.split("/")
        return package, name
