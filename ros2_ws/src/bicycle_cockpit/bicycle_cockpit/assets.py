"""The page's own files, compressed, from one folder; nothing outside it has a name here."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import mimetypes
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

KINDS = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}
"""MIME types by suffix; the system's own table may differ."""
ALREADY_SMALL = (".png", ".woff2")


@dataclass(frozen=True)
class Asset:
    """One file as it is sent."""

    changed: int
    """ns, its time of change when it was read."""
    kind: str
    """MIME type."""
    tag: str
    """Entity tag, for If-None-Match."""
    plain: bytes
    packed: bytes
    """gzip; empty where that would gain nothing."""


class Assets:
    """Files below a folder; each is read again when it has changed."""

    def __init__(self, folder: Path) -> None:
        """Serve what lies in `folder` and below."""
        self._folder = folder
        self._files = self._listed()
        self._read: dict[str, Asset] = {}

    def read_all(self) -> None:
        """Read and compress every file, so that the first page need not wait for it."""
        for name in self._files:
            with contextlib.suppress(OSError):
                self._asset(name)

    def response(self, request: web.Request, name: str) -> web.Response:
        """Return the answer for one file.

        Raises:
            HTTPNotFound: when the folder holds no such file.
        """
        asset = self._asset(name)
        headers = {"ETag": asset.tag, "Vary": "Accept-Encoding"}
        if asset.tag in request.headers.get("If-None-Match", ""):
            return web.Response(status=304, headers=headers)
        body = asset.plain
        if asset.packed and accepts_gzip(request):
            body, headers["Content-Encoding"] = asset.packed, "gzip"
        charset = "utf-8" if asset.kind.startswith("text/") else None
        return web.Response(body=body, content_type=asset.kind, charset=charset, headers=headers)

    def _listed(self) -> dict[str, Path]:
        paths = (path for path in self._folder.rglob("*") if path.is_file())
        return {path.relative_to(self._folder).as_posix(): path for path in paths}

    def _asset(self, name: str) -> Asset:
        if name not in self._files or not self._files[name].is_file():
            self._files = self._listed()
        if name not in self._files:
            raise web.HTTPNotFound
        path = self._files[name]
        changed = path.stat().st_mtime_ns
        known = self._read.get(name)
        if known is None or known.changed != changed:
            known = self._read[name] = _read(path, changed)
        return known


def _read(path: Path, changed: int) -> Asset:
    data = path.read_bytes()
    kind = KINDS.get(path.suffix) or mimetypes.guess_type(path.name)[0]
    packed = b"" if path.suffix in ALREADY_SMALL else gzip.compress(data, mtime=0)
    tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
    return Asset(changed, kind or "application/octet-stream", tag, data, packed)


def accepts_gzip(request: web.Request) -> bool:
    """Return True if a browser takes gzip."""
    for offer in request.headers.get("Accept-Encoding", "").lower().split(","):
        name, _, weight = offer.replace(" ", "").partition(";")
        if name == "gzip":
            return weight not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False
