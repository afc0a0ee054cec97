"""Recorded rides as the page for any web server, served by Python's own."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from node_process import NodeProcess

from bicycle_cockpit.export_page import export_page


@contextmanager
def served_page(bags: Sequence[Path], folder: Path, against: str = "") -> Iterator[str]:
    """The address of the page of some bags, which is written to `folder`.

    With `against` that controller rides each of them, too.
    """
    export_page(bags, folder, against=against)
    server = [sys.executable, "-m", "http.server", "0", "--bind", "127.0.0.1"]
    with NodeProcess(server, cwd=folder) as process:
        port = process.wait_for_line(r"port (\d+)")[1]
        yield f"http://127.0.0.1:{port}/"
