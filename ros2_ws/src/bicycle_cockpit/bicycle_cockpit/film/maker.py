"""A film of a recorded ride: the cockpit's own page draws it, picture by picture."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import secrets
import tempfile
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from bicycle_cockpit.export_page import export_page
from bicycle_cockpit.film.browser import BrowserError, BrowserTab, browser_tab
from bicycle_cockpit.film.encoder import encoder

CAMERAS = ("chase", "orbit", "side", "rider", "top")
TOUR = "tour"
"""Camera that changes by itself."""
SHOTS = ("chase", "side", "orbit", "top")
SHOT = 6.0
"""Time of the film from one camera of the tour (s)."""
READY = 60.0
"""Time that the page has to load (s)."""


@dataclass(frozen=True)
class FilmOptions:
    """Contents and format of a film.

    Raises:
        ValueError: on values that make no film.
    """

    size: tuple[int, int] = (960, 540)
    """Width and height, pixels."""
    rate: float = 25.0
    """Pictures per second."""
    speed: float = 1.0
    """Seconds of the ride per second of the film."""
    start: float = 0.0
    """s of the ride."""
    end: float | None = None
    """s of the ride; None for its end."""
    camera: str = TOUR
    """Camera's name, one of CAMERAS or TOUR."""
    against: str = ""
    """Controller that rides along as a ghost, see `same_ride`; empty for none."""

    def __post_init__(self) -> None:
        """Check."""
        width, height = self.size
        if not (160 <= width <= 3840 and 90 <= height <= 2160) or width % 2 or height % 2:
            raise ValueError("the size must be even, from 160x90 to 3840x2160")
        if not 1 <= self.rate <= 60:
            raise ValueError("a film has 1 to 60 pictures per second")
        if not 0.05 <= self.speed <= 50:
            raise ValueError("the speed must be from 0.05 to 50")
        if self.start < 0 or (self.end is not None and not self.end > self.start):
            raise ValueError("the film must end after it begins, and begin at 0 s or later")
        if self.camera not in (*CAMERAS, TOUR):
            raise ValueError(f"unknown camera {self.camera}: {', '.join((*CAMERAS, TOUR))}")

    def times(self, duration: float) -> list[float]:
        """Return the time of each picture, s of a ride that lasts `duration`.

        Raises:
            ValueError: if the ride ends before the film begins.
        """
        end = duration if self.end is None else min(self.end, duration)
        if self.start >= end:
            raise ValueError(f"the ride lasts {duration:.1f} s: begin before that")
        count = max(1, round((end - self.start) * self.rate / self.speed))
        return [self.start + n * self.speed / self.rate for n in range(count)]

    def camera_at(self, picture: int) -> str:
        """Return the camera of a picture by its number."""
        if self.camera != TOUR:
            return self.camera
        return SHOTS[int(picture / self.rate / SHOT) % len(SHOTS)]


def make_film(
    bag: Path, film: Path, options: FilmOptions, progress: Callable[[int, int], None]
) -> int:
    """Film a bag's ride.

    Args:
        bag: folder or file.
        film: path of the film; see `encoder.FORMATS`.
        options: what is filmed, and how.
        progress: called with the numbers of pictures done and wanted.

    Returns:
        The number of pictures.

    Raises:
        BagError: if the bag cannot be read.
        BrowserError, EncoderError, ValueError, OSError: if the film cannot be made.
    """
    with tempfile.TemporaryDirectory() as folder:
        export_page([bag], Path(folder), against=options.against)
        return asyncio.run(_film(Path(folder), film, options, progress))


async def _film(
    page: Path, film: Path, options: FilmOptions, progress: Callable[[int, int], None]
) -> int:
    async with _served(page) as address, browser_tab(f"{address}?film=1", options.size) as tab:
        duration = await _loaded(tab)
        times = options.times(duration)
        with encoder(film, options.rate) as writer:
            for number, time in enumerate(times):
                call = f"page.frame({time:.6f}, {json.dumps(options.camera_at(number))})"
                picture = await tab.evaluate(call)
                writer.add(base64.b64decode(str(picture).partition(",")[2]))
                progress(number + 1, len(times))
        return len(times)


async def _loaded(tab: BrowserTab) -> float:
    """Wait until the page shows the ride in 3D; return the ride's duration, s."""
    ready = """(async () => {
        if (document.readyState !== "complete") return null;
        globalThis.page ??= await import(document.querySelector("script[type=module]").src);
        if (page.views.refused) throw new Error(page.views.refused);
        const ready = page.player.bag && page.views.stage && page.complete();
        return ready ? page.player.bag.duration : null;
    })()"""
    deadline = asyncio.get_running_loop().time() + READY
    while asyncio.get_running_loop().time() < deadline:
        duration = await tab.evaluate(ready)
        if duration is not None:
            return float(duration)
        await asyncio.sleep(0.1)
    said = f": {tab.errors[0].splitlines()[0]}" if tab.errors else ""
    raise BrowserError(f"the page does not show the ride{said}")


@contextlib.asynccontextmanager
async def _served(folder: Path) -> AsyncIterator[str]:
    """Serve a folder on this machine under a name that nobody guesses."""
    name = secrets.token_urlsafe(16)
    app = web.Application()

    async def index(request: web.Request) -> web.FileResponse:
        return web.FileResponse(folder / "index.html")

    app.router.add_get(f"/{name}/", index)
    app.router.add_static(f"/{name}", folder)
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    try:
        await site.start()
        port = runner.addresses[0][1]
        yield f"http://127.0.0.1:{port}/{name}/"
    finally:
        await runner.cleanup()
