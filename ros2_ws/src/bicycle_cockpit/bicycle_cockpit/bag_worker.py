"""Process that reads bags for the web server, so that a bad file cannot break the pages.

Requests come on standard input, one JSON object a line: `{"do": "list", "skip": [...]}` and
`{"do": "load", "name": ..., "rider": ..., "title": ...}`, where a `rider`, shown by its `title`,
rides the bag's goals again. Answers go to standard output: a line of JSON and, where it has a
`size`, so many bytes after it. The list comes bag by bag, each announced before it is read: the
server must know which one takes too long.
"""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_cockpit.bag_worker")

import gzip
import json
import os
import resource
import signal
import sys
from collections import OrderedDict
from pathlib import Path
from typing import Any, BinaryIO

from bicycle_bag.errors import BagError
from bicycle_cockpit.bags import session
from bicycle_cockpit.same_ride import same_ride
from bicycle_cockpit.shelf import BagShelf, Signature, entry, left_out, signature
from bicycle_common.processes import end_with_parent

MOST_MEMORY = 4 * 1024**3
"""Address space that the process may use beyond its size at the start (bytes)."""
MOST_KEPT = 64 * 1024**2
"""Size of the cache of compressed bags (bytes)."""
NICENESS = 10


class Worker:
    """Reads bags and caches them as long as their files do not change.

    Args:
        folder: of the bags.
        out: receives the answers.
    """

    def __init__(self, folder: Path, out: BinaryIO) -> None:
        self._shelf = BagShelf(folder)
        self._out = out
        self._entries: dict[str, tuple[Signature, dict[str, Any]]] = {}
        self._kept: OrderedDict[str, tuple[Signature, dict[str, Any], bytes]] = OrderedDict()

    def answer(self, request: dict[str, Any]) -> None:
        """Execute a request."""
        if request["do"] == "list":
            self._list(set(request["skip"]))
        else:
            rider, title = (str(request.get(name, "")) for name in ("rider", "title"))
            self._load(str(request["name"]), rider, title)

    def _say(self, data: dict[str, Any], body: bytes = b"") -> None:
        self._out.write(json.dumps(data).encode() + b"\n" + body)
        self._out.flush()

    def _list(self, skip: set[str]) -> None:
        """List every bag except those in `skip`, which took too long before."""
        found = self._shelf.found()
        self._entries = {name: self._entries[name] for name in found if name in self._entries}
        for name, path in found.items():
            if name in skip:
                continue
            now = signature(path)
            known = self._entries.get(name)
            if known is None or known[0] != now:
                self._say({"reading": name})
                known = self._entries[name] = (now, _safe_entry(name, path))
            self._say({"entry": known[1]})
        if self._shelf.left_out:
            self._say({"entry": left_out(self._shelf.left_out)})
        self._say({"done": True})

    def _load(self, name: str, controller: str, title: str) -> None:
        """Send a bag in the page's form, compressed."""
        try:
            path = self._shelf.path(name)
        except KeyError:
            self._say({"missing": True})
            return
        now = signature(path)
        if Path(controller).is_file():  # a policy in training is replaced
            now = (*now, *signature(Path(controller)))
        key = f"{name}?{controller}?{title}"
        kept = self._kept.pop(key, None)
        if kept is None or kept[0] != now:
            try:
                kept = (now, *_packed(name, path, controller, title))
            except BagError as error:
                self._say({"problem": str(error)})
                return
            except Exception as error:
                self._say({"problem": _unforeseen(name, error)})
                return
        self._kept[key] = kept
        while len(self._kept) > 1 and self._size() > MOST_KEPT:
            self._kept.popitem(last=False)
        self._say(kept[1], kept[2])

    def _size(self) -> int:
        return sum(len(body) for _, _, body in self._kept.values())


def _safe_entry(name: str, path: Path) -> dict[str, Any]:
    """Return a bag's list entry, with any problem of the bag."""
    try:
        return entry(name, path)
    except Exception as error:
        return {"name": name, "problem": _unforeseen(name, error)}


def _unforeseen(name: str, error: Exception) -> str:
    if isinstance(error, MemoryError):
        return f"{name} needs more than {MOST_MEMORY >> 30} GiB of memory to be shown"
    text = " ".join(str(error).split())[:120]
    return f"{name} cannot be read ({type(error).__name__}: {text})"


def _packed(name: str, path: Path, controller: str, title: str) -> tuple[dict[str, Any], bytes]:
    """Return a bag's description and its compressed content."""
    data = same_ride(path, controller, title) if controller else session(path)
    text = json.dumps({"name": name, **data}, allow_nan=False, separators=(",", ":"))
    body = gzip.compress(text.encode(), compresslevel=5, mtime=0)
    return {"size": len(body), "colours": [one["colour"] for one in data["riders"]]}, body


def _bound() -> None:
    """Limit the process's use of the machine, and end it with its parent."""
    # A terminal's Ctrl-C is for the cockpit.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(signal.SIGKILL)
    os.nice(NICENESS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MOST_MEMORY
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = most if hard < 0 else min(most, hard)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def main() -> int:
    """Serve until standard input ends."""
    _bound()
    worker = Worker(Path(sys.argv[1]), os.fdopen(os.dup(1), "wb"))
    os.dup2(2, 1)  # a library's prints must not mix with the answers
    for line in sys.stdin:
        worker.answer(json.loads(line))
    return 0
