"""The bags of one folder: which there are, and a ride in the form that the page draws.

A bag goes by its path below the folder, and only by one that the folder's listing holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_bag import metadata
from bicycle_bag.columns import load
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader
from bicycle_bringup.ride_log import PUSHED, RideLog, prefix_of, read_ride
from bicycle_bringup.summary import dropped_steps, late_steps
from bicycle_cockpit.loop_stats import loop_figures
from bicycle_cockpit.samples import COLUMNS, plain_column, reward_columns
from bicycle_controller.goals import Status
from bicycle_sim.reward import RewardWeights
from bicycle_sim.scenario import Scenario

MOST_BAGS = 200
"""That are listed, the newest."""
DEEPEST = 3
"""Folders below the folder that bags are looked for in."""
MOST_ROWS = 24_000
"""Of one bag for the page, ten minutes at 40 Hz; longer ones are thinned evenly."""
MOST_MARKS = 2_000

Numbers = NDArray[np.float64]


class BagShelf:
    """The finished bags below one folder."""

    def __init__(self, folder: Path) -> None:
        """Look into `folder`, which may not be there yet."""
        self.folder = folder

    def listed(self) -> list[dict[str, Any]]:
        """The newest bags first: name, start (s since 1970), duration (s) and messages."""
        entries: list[dict[str, Any]] = []
        for name, path in self._found().items():
            try:
                about = metadata.read(path)
            except BagError:
                continue
            entries.append(
                {
                    "name": name,
                    "start": about.starting_time_ns / 1e9,
                    "duration": about.duration_ns / 1e9,
                    "messages": sum(about.counts.values()),
                }
            )
        entries.sort(key=lambda entry: float(entry["start"]), reverse=True)
        return [entry for entry in entries if entry["messages"]][:MOST_BAGS]

    def load(self, name: str) -> dict[str, Any]:
        """A bag for the page; see `session`.

        Raises:
            KeyError: when the folder's listing has no such bag.
            BagError: when it cannot be read or holds no ride.
        """
        return {"name": name, **session(self._found()[name])}

    def _found(self) -> dict[str, Path]:
        """Paths by name; a link that leads out of the folder is none."""
        root = self.folder.resolve()
        found = {}
        for path in _bag_folders(self.folder, DEEPEST):
            if path.resolve().is_relative_to(root):
                found[path.relative_to(self.folder).as_posix()] = path
        return found


def _bag_folders(folder: Path, depth: int) -> Iterator[Path]:
    try:
        inside = sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError:
        return
    for path in inside:
        if (path / metadata.FILE_NAME).is_file():
            yield path
        elif depth > 1:
            yield from _bag_folders(path, depth - 1)


def session(path: Path) -> dict[str, Any]:
    """A ride as the page draws it.

    Returns:
        `columns` (names), `data` (one list per column), `marks` (what happened: `t`, `kind`,
        `text`, and `x`, `y` for goals), `policies` (from when which rode), `loop` (figures of
        the whole bag), `goal_radius` and `duration`.

    Raises:
        BagError: when it cannot be read or holds no ride.
    """
    ride = read_ride(path)
    if not len(ride.states["step"]):
        raise BagError(f"{path} holds no state of a bicycle: record a ride with record.sh")
    time = _simulated_time(ride)
    scenario = _scenario(ride)
    newest = _newest_before(ride.commands, ride.states["recorded_order"])
    table = _table(ride, time, newest, scenario)
    stride = -(-len(time) // MOST_ROWS)
    timing = [
        np.asarray(ride.timing.get(name, ()), dtype=np.float64)
        for name in ("period", "lateness", "latency")
    ]
    marks = [*_goal_marks(ride, time), *_state_marks(ride, time), *_push_marks(path, ride, time)]
    return {
        "columns": list(COLUMNS),
        "data": [plain_column(column[::stride]) for column in table],
        "marks": sorted(marks, key=lambda mark: mark["t"])[:MOST_MARKS],
        "policies": _policies(ride, time, newest),
        "loop": {**loop_figures(*timing), "late": late_steps(ride.timing)}
        | {"dropped": dropped_steps(ride.timing)},
        "goal_radius": scenario.goal_radius if scenario else 1.0,
        "duration": float(time[-1] - time[0]),
    }


def _simulated_time(ride: RideLog) -> Numbers:
    """(n,) s from the first state on; goes on where the simulator was started anew."""
    stamp = np.asarray(ride.states["header.stamp"], dtype=np.float64)
    steps = np.diff(stamp, prepend=stamp[:1])
    return np.cumsum(np.where(steps < 0, 0.025, steps))


def _scenario(ride: RideLog) -> Scenario | None:
    for text in ride.episodes.get("scenario", ()):
        try:
            return Scenario.from_json(text)
        except (ValueError, TypeError):
            return None
    return None


def _newest_before(
    messages: Mapping[str, NDArray[Any]], places: NDArray[np.int64]
) -> NDArray[np.intp]:
    """(n,) row of the newest message before each place in the recorded order, -1 for none."""
    if "recorded_order" not in messages:
        return np.full(len(places), -1)
    return np.searchsorted(messages["recorded_order"], places, side="left") - 1


def _table(
    ride: RideLog, time: Numbers, newest: NDArray[np.intp], scenario: Scenario | None
) -> list[Numbers]:
    """The columns of `Sample`."""
    states = ride.states
    weights = scenario.reward if scenario else RewardWeights()
    rewards = reward_columns(states, weights)
    return [
        time,
        states["episode"],
        states["step"],
        states["rear_contact.x"],
        states["rear_contact.y"],
        states["heading"],
        states["lean_angle"],
        states["lean_rate"],
        states["steer_angle"],
        states["speed"],
        states["goal_distance"],
        states["heading_error"],
        states["command_source"],
        *(_at(ride.commands, name, newest) for name in ("torque", "displacement", "pedal_force")),
        *rewards,
    ]


def _at(messages: Mapping[str, NDArray[Any]], name: str, rows: NDArray[np.intp]) -> Numbers:
    """A column at some rows; NaN where there is none."""
    if name not in messages or not len(messages[name]):
        return np.full(len(rows), np.nan)
    return np.where(rows >= 0, messages[name][np.maximum(rows, 0)], np.nan)


def _when(ride: RideLog, time: Numbers, messages: Mapping[str, NDArray[Any]]) -> Numbers:
    """Simulated time of some messages: that of the newest state recorded by then."""
    places = messages["recorded_order"]
    rows = np.searchsorted(ride.states["recorded_order"], places, side="right") - 1
    return time[np.maximum(rows, 0)]


def _goal_marks(ride: RideLog, time: Numbers) -> Iterator[dict[str, Any]]:
    """What became of goals."""
    found = ride.statuses
    if "status" not in found:
        return
    moments = _when(ride, time, found)
    for row, moment in enumerate(moments):
        status = Status(int(found["status"][row]))
        x, y = float(found["position.x"][row]), float(found["position.y"][row])
        if np.isfinite([x, y]).all():
            yield {
                "t": round(float(moment), 3),
                "kind": status.name.lower(),
                "text": str(found["message"][row]),
                "x": x,
                "y": y,
                "remaining": int(found["remaining"][row]),
            }


def _state_marks(ride: RideLog, time: Numbers) -> Iterator[dict[str, Any]]:
    """Falls and resets."""
    fallen = np.asarray(ride.states["fallen"], dtype=bool)
    for row in np.flatnonzero(fallen & ~np.roll(fallen, 1)):
        yield {"t": round(float(time[row]), 3), "kind": "fell", "text": "the bicycle fell"}
    for row in np.flatnonzero(np.diff(ride.segment)) + 1:
        episode = int(ride.states["episode"][row])
        text = f"episode {episode} begins"
        yield {"t": round(float(time[row]), 3), "kind": "reset", "text": text}


def _push_marks(path: Path, ride: RideLog, time: Numbers) -> Iterator[dict[str, Any]]:
    """Pushes from the side."""
    reader = BagReader(path)
    topic = prefix_of(reader) + PUSHED
    if topic not in reader.topics or not reader.counts.get(topic):
        return
    pushes = load(reader, topic)
    for moment, rate in zip(_when(ride, time, pushes), pushes["lean_rate"], strict=True):
        text = f"pushed to the {'right' if rate > 0 else 'left'}, {abs(rate):.2f} rad/s"
        yield {"t": round(float(moment), 3), "kind": "push", "text": text}


def _policies(ride: RideLog, time: Numbers, newest: NDArray[np.intp]) -> list[dict[str, Any]]:
    """From when on which policy rode."""
    if "policy" not in ride.commands or not len(ride.commands["policy"]):
        return []
    names = np.where(newest >= 0, ride.commands["policy"][np.maximum(newest, 0)], "")
    rows = [row for row in range(len(names)) if row == 0 or names[row] != names[row - 1]]
    return [{"t": round(float(time[row]), 3), "name": str(names[row])} for row in rows]
