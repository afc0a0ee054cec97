"""Classes of message types by the names that topics have them under."""

from __future__ import annotations

import importlib
from typing import Any

FEEDBACK = "_FeedbackMessage"
"""End of the type of an action's feedback, whose class lies within the action's."""


def message_class(kind: str) -> type[Any]:
    """Return the class of `pkg/msg/Type` or `pkg/action/Type_FeedbackMessage`.

    Raises:
        LookupError: if it is not installed, or the topic carries several types, with commas.
    """
    if "," in kind:
        raise LookupError(f"has several types ({kind}): end the node that has the wrong one")
    package, _, short = kind.partition("/msg/")
    folder = "msg"
    if not short and kind.endswith(FEEDBACK):
        package, _, short = kind.removesuffix(FEEDBACK).partition("/action/")
        folder = "action"
    try:
        found: Any = getattr(importlib.import_module(f"{package}.{folder}"), short)
        return found.Impl.FeedbackMessage if folder == "action" else found
    except (ImportError, AttributeError, TypeError, ValueError):
        raise LookupError(f"has type {kind}, which is not installed here") from None
