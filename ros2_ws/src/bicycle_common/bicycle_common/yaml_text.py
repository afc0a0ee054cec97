"""YAML input and output with bounds: untrusted text costs at most a second and some memory.

PyYAML's safe loader runs no code, but it follows aliases (8 kB of them expand to more values than
any memory holds), recurses as deep as the C stack, and multiplies out numbers of a million digits.
libyaml is used if available: it is ten times as fast.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

YAMLError = yaml.YAMLError


class BoundsError(YAMLError):
    """Text that exceeds this module's bounds on length, depth or count."""


MOST_BYTES = 8 * 2**20
"""Largest size of a text (bytes): the metadata of a bag in 10,000 files has 3 MB."""
MOST_VALUES = 300_000
"""Largest number of values in a text; each alias counts as everything it stands for."""
MOST_DEPTH = 50
"""Deepest nesting of lists and mappings."""
MOST_DIGITS = 100
"""Most characters of a number."""
MOST_TAGS = 100
"""Most `%TAG` directives: libyaml compares each with all before it."""

_Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class _Loader(_Base):  # type: ignore[misc]
    """Safe loader without numbers that take minutes to parse."""


def _number(kind: str) -> None:
    construct = _Base.yaml_constructors[kind]

    def bounded(loader: Any, node: Any) -> Any:
        if len(str(node.value)) > MOST_DIGITS:
            raise BoundsError(f"a number has more than {MOST_DIGITS} characters")
        return construct(loader, node)

    _Loader.add_constructor(kind, bounded)


for _kind in ("int", "float", "timestamp"):
    _number(f"tag:yaml.org,2002:{_kind}")


def dump(content: Any) -> str:
    """Return plain data as YAML text, keys in their order."""
    return str(yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True))


def load(text: str) -> Any:
    """Parse YAML text into plain data.

    Raises:
        YAMLError: if it is not YAML, or exceeds one of this module's bounds.
    """
    check_bounds(text)
    try:
        return yaml.load(text, Loader=_Loader)
    except YAMLError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # PyYAML's own constructors raise these on values that do not fit their tag.
        raise YAMLError(f"a value is not of its tag: {error}") from None


def read(path: Path) -> Any:
    """Parse a YAML file into plain data.

    Raises:
        OSError, UnicodeDecodeError: if it cannot be read, or is not text.
        YAMLError: See `load`.
    """
    return load(read_text(path))


def read_text(path: Path) -> str:
    """Return the text of a file that is within the size limit of YAML.

    Raises:
        OSError, UnicodeDecodeError: if it cannot be read, or is not text.
        YAMLError: if it is too long.
    """
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise BoundsError(f"it is longer than {MOST_BYTES} bytes")
    return content.decode("utf-8")


def check_bounds(text: str) -> None:
    """Check number of values and depth on the parser's events: nothing is built, nothing recurses.

    Raises:
        YAMLError: if it is not YAML; `BoundsError` if it exceeds one of this module's bounds.
    """
    if len(text) > MOST_BYTES:
        raise BoundsError(f"it is longer than {MOST_BYTES} bytes")
    if text.count("%TAG") > MOST_TAGS:
        raise BoundsError(f"it has more than {MOST_TAGS} %TAG directives")
    total = 0
    anchored: dict[str, int] = {}
    opened: list[tuple[str | None, int]] = []
    for event in yaml.parse(text, Loader=_Loader):
        anchor: str | None = getattr(event, "anchor", None)
        if isinstance(event, yaml.CollectionStartEvent):
            opened.append((anchor, total))
            if len(opened) > MOST_DEPTH:
                raise BoundsError(f"it is nested deeper than {MOST_DEPTH} levels")
            total += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = opened.pop()
            if anchor is not None:
                anchored[anchor] = total - before
        elif isinstance(event, yaml.AliasEvent):
            if any(anchor == name for name, _ in opened):
                raise BoundsError(f"*{anchor} lies within itself")
            total += anchored.get(str(anchor), 1)
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            if anchor is not None:
                anchored[anchor] = 1
        if total > MOST_VALUES:
            raise BoundsError(f"it has more than {MOST_VALUES} values, aliases counted in full")
