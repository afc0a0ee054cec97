"""A web server for tests, with what it asks for and what it says."""

from __future__ import annotations

from pathlib import Path

from bicycle_cockpit.access import AccessPolicy
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.requests import Request
from bicycle_cockpit.server import Server

TOKEN = "0123456789abcdef"


class Desk:
    """A server that runs.

    Attributes:
        greets: True if a page is greeted at once.
    """

    def __init__(
        self, door: AccessPolicy, folder: Path, choices: PolicyCatalogue | None = None
    ) -> None:
        self.greets = True
        self.requests: list[tuple[int, Request]] = []
        self.joined: list[int] = []
        self.lines: list[str] = []
        self.server = Server(
            door,
            0,
            folder,
            lambda page, request: self.requests.append((page, request)),
            self._join,
            self.lines.append,
            choices,
        )
        self.server.start()

    def _join(self, page: int) -> None:
        """Note a page that has come."""
        if self.greets:
            self.server.greet(page, {"type": "hello"}, [])
        self.joined.append(page)

    @property
    def url(self) -> str:
        """Address on which it listens."""
        return f"http://127.0.0.1:{self.server.port}"
