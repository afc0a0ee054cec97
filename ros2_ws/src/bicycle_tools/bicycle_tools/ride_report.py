"""Results of a ride from its bag: numbers, picture, and a screen of text."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bicycle_bag.errors import BagError
from bicycle_bag.repair import repair
from bicycle_tools.ride_log import RideLog, read_ride
from bicycle_tools.summary import RideSummary, summarise
from bicycle_tools.text_summary import render


@np.errstate(invalid="ignore", over="ignore")
def report(bag: Path, folder: Path, events: Sequence[str] = ()) -> tuple[RideSummary, str]:
    """Sum up a bag into a folder: summary.json and ride.png.

    Args:
        bag: bag directory; one that was cut short is repaired first.
        folder: for the two files.
        events: one line per event of the processes, which a bag does not contain.

    Returns:
        The summary, and its text for the screen.

    Raises:
        BagError: if the bag cannot be read or holds no state of a bicycle.
    """
    # matplotlib takes longer to import than all else of a ride: a ride begins without it.
    from bicycle_tools.picture import draw_ride

    log = _read(bag)
    if not len(log.states["step"]):
        raise BagError(f"{bag} holds no state of the bicycle: see the nodes' logs beside it")
    summary = summarise(log)
    data = {**summary.to_dict(), "events": list(events)}
    (folder / "summary.json").write_text(json.dumps(data, indent=2) + "\n")
    draw_ride(log, folder / "ride.png")
    return summary, render(summary, events)


def _read(bag: Path) -> RideLog:
    """Read the ride, after a repair if its recorder was cut off."""
    try:
        return read_ride(bag)
    except BagError:
        repair(bag)
        return read_ride(bag)
