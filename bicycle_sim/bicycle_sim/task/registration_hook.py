"""Registration of the environments as soon as a program imports Gymnasium, in any order."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

LIBRARY = "gymnasium"


class _Hook(MetaPathFinder):
    """Finds Gymnasium as usual, and registers the environments once it is loaded."""

    def __init__(self) -> None:
        self._asks_others = False

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the usual spec of Gymnasium with a loader that registers; None for others."""
        if name != LIBRARY or self._asks_others:
            return None
        self._asks_others = True
        try:
            spec = importlib.util.find_spec(name)
        finally:
            self._asks_others = False
        if spec is not None and spec.loader is not None:
            loader: Any = spec.loader
            load = loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                _register()

            loader.exec_module = load_and_register
        return spec


def register_with_gymnasium() -> None:
    """Register the environments now if Gymnasium is loaded, else when a program loads it.

    A program that never does pays nothing for it.
    """
    if LIBRARY in sys.modules:
        _register()
    elif not any(isinstance(finder, _Hook) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Hook())


def _register() -> None:
    from bicycle_sim.task import registration

    registration.register()
