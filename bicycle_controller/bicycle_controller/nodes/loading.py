"""Load a policy, or make a fallback, beside the control loop."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterator

from bicycle_controller.controllers import Controller
from bicycle_controller.policy import PolicyError, load_controller

Made = Controller | Exception | None
"""What a thread made, or why it could not."""


class Making:
    """Controllers made in threads of their own; the loop's thread picks up what is ready."""

    def __init__(self) -> None:
        self._ready: queue.SimpleQueue[Made] = queue.SimpleQueue()

    def begin(self, make: Callable[[], Controller | None]) -> None:
        """Make one; what cannot be computed is ready as the exception that says so."""

        def work() -> None:
            try:
                self._ready.put(make())
            except (ValueError, ArithmeticError, TypeError) as error:
                self._ready.put(error)

        threading.Thread(target=work, daemon=True).start()

    def ready(self) -> Iterator[Made]:
        """All that is ready and was not picked up yet."""
        while not self._ready.empty():
            yield self._ready.get()


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
