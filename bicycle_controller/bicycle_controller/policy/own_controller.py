"""Controllers of one's own in Python: `module:Class`, or a name of an installed entry point.

A package names its controllers in the entry point group `bicycle.controllers`:

    [project.entry-points."bicycle.controllers"]
    my-pid = "my_package.my_module:MyController"

The class is called without arguments and has what `control.controller.Controller` asks for.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import numpy as np

from bicycle_controller.control.controller import Controller
from bicycle_controller.policy.policy_file import PolicyError

GROUP = "bicycle.controllers"
_CLASS = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def installed() -> dict[str, EntryPoint]:
    """Return the installed controllers by name."""
    return {point.name: point for point in entry_points(group=GROUP)}


def is_class(text: str) -> bool:
    """Return True for `module:Class`."""
    return _CLASS.fullmatch(text) is not None


def load_own(text: str) -> Controller | None:
    """Return one's own controller, or None if `text` is not the name of one.

    Raises:
        PolicyError: one line, for every failure of the code that is loaded.
    """
    if is_class(text):
        module, _, name = text.partition(":")
        return _made(text, lambda: getattr(importlib.import_module(module), name))
    point = installed().get(text)
    return None if point is None else _made(text, point.load)


def _made(text: str, find: Callable[[], Any]) -> Controller:
    try:
        controller: Controller = find()()
        identity = controller.policy_id
        action = np.asarray(controller.act(np.zeros((1, 6)), np.full(1, 2.0)), dtype=float)
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise PolicyError(
            f"cannot load controller {text!r}: {reason}; it must be a class without arguments "
            "that has policy_id and act(observation, speed)"
        ) from None
    if not isinstance(identity, str) or action.shape != (1, 3):
        raise PolicyError(
            f"controller {text!r} must have a policy_id that is text and give (N, 3) actions, "
            f"not {identity!r} and {action.shape}"
        )
    return controller
