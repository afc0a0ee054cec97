"""Pictures in the browser, for `render_mode="human"`: no display and no further package needed.

A small server on loopback sends the newest picture to every page that is open, as a browser's
own moving picture (multipart/x-mixed-replace).
"""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

PAGE = b"""<!doctype html><html lang="en"><meta charset="utf-8"><title>Bicycle</title>
<body style="margin:0;background:#1f2933"><img src="pictures" alt="The bicycle from behind"
style="display:block;margin:auto;height:100vh;image-rendering:auto"></body></html>"""
BETWEEN = 0.05
"""s of simulated time between two pictures."""


class PicturePage:
    """One page that shows the newest picture.

    Attributes:
        address: where it is, `http://127.0.0.1:PORT/`.
    """

    def __init__(self, time_step: float, out: Callable[[str], object] = print) -> None:
        """Serve on a free port and tell the address.

        Args:
            time_step: s that a step lasts.
            out: what prints the line.
        """
        self.time_step = time_step
        self._steps, self._begun, self._next = 0, time.monotonic(), 0.0
        self._picture, self._number, self._open = b"", 0, True
        self._changed = threading.Condition()
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self))
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_address[1]}/"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        out(f"The bicycle is shown at {self.address}")

    def show(self, draw: Callable[[], np.ndarray]) -> None:
        """Count one step; draw its picture if one is due, and wait for real time."""
        simulated = self._steps * self.time_step
        self._steps += 1
        if simulated >= self._next:
            self._next = simulated + BETWEEN
            self._publish(_png(draw()))
        ahead = self._begun + simulated - time.monotonic()
        if ahead > 0:
            time.sleep(ahead)
        else:  # drawing takes longer than the step: do not hurry to catch up
            self._begun -= ahead

    def _publish(self, picture: bytes) -> None:
        with self._changed:
            self._picture, self._number = picture, self._number + 1
            self._changed.notify_all()

    def newest(self, after: int) -> tuple[bytes, int]:
        """Wait for a picture with a number above `after`; an empty one when the page closes."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > after or not self._open)
            return (self._picture, self._number) if self._open else (b"", self._number)

    def close(self) -> None:
        """Stop serving."""
        with self._changed:
            self._open = False
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()


def _png(picture: np.ndarray) -> bytes:
    """Return a picture (h, w, 3) uint8 as PNG."""
    from matplotlib.image import imsave

    out = io.BytesIO()
    imsave(out, picture, format="png", pil_kwargs={"compress_level": 1})
    return out.getvalue()


def _handler(page: PicturePage) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """`/` is the page, `/pictures` the moving picture."""

        def do_GET(self) -> None:
            """Answer a browser."""
            host = (self.headers.get("Host") or "").split(":")[0]
            if self.path not in ("/", "/pictures") or host not in ("127.0.0.1", "localhost"):
                self.send_error(404)
                return
            self.send_response(200)
            if self.path == "/":
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(PAGE)))
                self.end_headers()
                self.wfile.write(PAGE)
                return
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=picture")
            self.end_headers()
            number = 0
            while True:
                picture, number = page.newest(number)
                if not picture:
                    return
                head = f"--picture\r\nContent-Type: image/png\r\nContent-Length: {len(picture)}"
                try:
                    self.wfile.write(head.encode() + b"\r\n\r\n" + picture + b"\r\n")
                except OSError:  # the page was closed
                    return

        def log_message(self, format: str, *args: Any) -> None:
            """Print nothing."""

    return Handler
