"""Load a policy beside the control loop."""

from __future__ import annotations

import threading
from collections.abc import Generator

from bicycle_controller.controllers import Controller
from bicycle_controller.policy import PolicyError, load_controller


class Loading:
    """A load in its own thread; `await` it in a callback and the executor serves others."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._made: Controller | None = None
        self._error = ""
        self._thread = threading.Thread(target=self._load, daemon=True)
        self._thread.start()

    def _load(self) -> None:
        try:
            self._made = load_controller(self._name)
        except PolicyError as error:
            self._error = str(error)
        except Exception as error:
            self._error = f"cannot load policy {self._name}: {type(error).__name__}: {error}"

    def __await__(self) -> Generator[None, None, Controller]:
        """The policy.

        Raises:
            PolicyError: one line with the remedy.
        """
        while self._thread.is_alive():
            yield  # The executor looks again whenever it wakes for something else.
        if self._made is None:
            raise PolicyError(self._error)
        return self._made
