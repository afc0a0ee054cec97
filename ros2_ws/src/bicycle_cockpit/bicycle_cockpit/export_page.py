"""Recorded rides as a page for any web server: the cockpit's page with the rides as JSON files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bicycle_cockpit.bags import session
from bicycle_cockpit.policy_catalogue import file_title
from bicycle_cockpit.riders import Palette
from bicycle_cockpit.same_ride import same_ride

WEB = Path(__file__).parent / "web"
RIDES = "rides"
_MARK = '<meta name="color-scheme"'


def export_page(
    bags: Sequence[Path], folder: Path, names: Sequence[str] = (), against: str = ""
) -> Path:
    """Write the page of some bags.

    Args:
        bags: folders or files, in the order of the page's list.
        folder: receives `index.html`, `web` and the rides; made if it does not exist.
        names: displayed names of the bags; by default those of their files.
        against: controller that rides each of them again, see `same_ride`; empty for none.

    Returns:
        The path of `index.html`.

    Raises:
        BagError: if a bag cannot be read or holds no ride.
        OSError: if a file cannot be written.
    """
    chosen = list(names) or _distinct([bag.name.removesuffix(".mcap") for bag in bags])
    rides = [exported(bag, name) for bag, name in zip(bags, chosen, strict=True)]
    if against:
        rides += [
            exported(bag, f"{name} by {file_title(Path(against))}", against)
            for bag, name in zip(bags, chosen, strict=True)
        ]
    shutil.copytree(WEB, folder / "web", dirs_exist_ok=True)
    (folder / RIDES).mkdir(exist_ok=True)
    for ride in rides:
        _write(folder / RIDES / f"{ride['name']}.json", ride)
    _write(folder / RIDES / "index.json", {"bags": [_entry(ride) for ride in rides]})
    page = (WEB / "index.html").read_text()
    index = folder / "index.html"
    index.write_text(page.replace(_MARK, f'<meta name="rides" content="{RIDES}">\n{_MARK}', 1))
    return index


def exported(bag: Path, name: str, controller: str = "") -> dict[str, Any]:
    """Return a ride in the page's form, with the colours of its policies.

    Args:
        bag: folder or file.
        name: displayed name.
        controller: that rides it again; empty for the ride itself.
    """
    ride = same_ride(bag, controller) if controller else session(bag)
    palette = Palette()
    palette.add([one["colour"] for one in ride["riders"]])
    slots = palette.message()["slots"]
    named = [{"colour": one["colour"], "slot": slots[one["colour"]]} for one in ride["riders"]]
    return {"name": name, **ride, "slots": named}


def _entry(ride: dict[str, Any]) -> dict[str, Any]:
    """Return a line of the page's list."""
    duration = ride["duration"]
    return {
        "name": ride["name"],
        "start": None,
        "duration": duration,
        "ridden": duration,
        "messages": len(ride["data"][0]),
        "problem": "",
    }


def _distinct(names: Sequence[str]) -> list[str]:
    """Return names that differ, and are names of files."""
    taken: list[str] = []
    for name in names:
        plain = "".join(c if c.isalnum() or c in "-_." else "-" for c in name) or "ride"
        number = 2
        while plain in taken:
            plain, number = f"{plain.rstrip('0123456789')}{number}", number + 1
        taken.append(plain)
    return taken


def _write(path: Path, data: dict[str, Any]) -> None:
    path.write_text(json.dumps(data, allow_nan=False, separators=(",", ":")))
