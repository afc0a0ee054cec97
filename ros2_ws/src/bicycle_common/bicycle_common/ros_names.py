"""Names that ROS 2 allows for nodes and namespaces."""

from __future__ import annotations

import re
from collections.abc import Iterable

TOKEN = r"[A-Za-z_][A-Za-z0-9_]*"
"""Pattern of a node's name, and of a part of another name."""
NAMESPACE = rf"{TOKEN}(/{TOKEN})*"
"""Pattern of a namespace without its outer slashes."""
LONGEST_NAME = 200
"""Letters of a namespace, so that its topics' names stay within ROS 2's 247."""

_RULES = {"__ns": rf"/({NAMESPACE})?", "__node": TOKEN, "__name": TOKEN}
_REMEDIES = {
    "__ns": "write / and letters, digits and _, as __ns:=/b1",
    "__node": "write letters, digits and _, as __node:=bicycle",
    "__name": "write letters, digits and _, as __name:=bicycle",
}


def wrong_rule(words: Iterable[str]) -> str:
    """Return what is wrong with the first rule for a namespace or a node's name; empty if none.

    ROS itself says it with its parser's words, in up to three lines.

    Args:
        words: of a command line.
    """
    for word in words:
        rule, mark, name = word.partition(":=")
        if not (mark and rule in _RULES):
            continue
        if not re.fullmatch(_RULES[rule], name) or len(name) > LONGEST_NAME:
            kind = "namespace" if rule == "__ns" else "name of a node"
            return f"{name[:80]!r} is no {kind}: {_REMEDIES[rule]}"
    return ""
