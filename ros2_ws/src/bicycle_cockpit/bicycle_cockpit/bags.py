"""A bag's ride in the form that the page draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bicycle_bag.errors import BagError
from bicycle_cockpit.arrivals import arrivals
from bicycle_cockpit.followed_paths import followed_paths
from bicycle_cockpit.loop_stats import loop_figures
from bicycle_cockpit.marks import Ridden, marks
from bicycle_cockpit.riders import ListedPolicy, lqr_names, rider, shipped_names
from bicycle_cockpit.samples import COLUMNS, ESTIMATED, plain_column, reward_columns
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.reward import RewardWeights
from bicycle_sim.task.scenario import SCENARIOS, Scenario
from bicycle_tools.ride_log import RideLog, read_ride
from bicycle_tools.summary import dropped_steps, late_steps

DEFAULT_SCENARIO = "random-start-random-goal"
MOST_ROWS = 24_000
"""Largest number of rows of a bag on the page, ten minutes at 40 Hz; longer ones are thinned."""

Numbers = NDArray[np.float64]
Content = TypeVar("Content")


@np.errstate(invalid="ignore", over="ignore")
def session(path: Path) -> dict[str, Any]:
    """Return a ride as the page draws it.

    Returns:
        `columns` (names), `data` (one list per column), `marks`, `arrivals` and `paths` (see
        there), `riders` (the policies that the rows name by number), `loop` (figures of the whole
        bag), `fall_angle` (rad), `goal_radius` (m), `geometry` (of the bicycle, see `Geometry`)
        and `duration` (s of simulated time).

    Raises:
        BagError: if it cannot be read or holds no ride.
    """
    ride = read_ride(path)
    if not len(ride.states["step"]):
        raise BagError(f"{path} holds no state of a bicycle: record a ride with record.sh")
    time = _simulated_time(ride)
    plant, scenario = _setting(ride)
    names = {**shipped_names(), **lqr_names(plant or registry.default())}
    newest = _newest_before(ride.commands, ride.states["recorded_order"])
    riders, numbers = _riders(ride, newest, names)
    table = _table(ride, time, newest, numbers, scenario)
    ridden = Ridden(ride, time, names)
    stride = -(-len(time) // MOST_ROWS)
    timing = [
        np.asarray(ride.timing.get(name, ()), dtype=np.float64)
        for name in ("period", "lateness", "latency")
    ]
    return {
        "columns": list(COLUMNS),
        "data": [plain_column(column[::stride]) for column in table],
        "marks": marks(ridden),
        "arrivals": arrivals(ridden),
        "paths": followed_paths(ridden),
        "riders": [asdict(one) for one in riders],
        "loop": {**loop_figures(*timing), "late": late_steps(ride.timing)}
        | {"dropped": dropped_steps(ride.timing)},
        "fall_angle": scenario.fall_angle if scenario else None,
        "goal_radius": scenario.goal_radius if scenario else 1.0,
        "geometry": asdict((plant or registry.default()).geometry),
        "duration": float(time[-1] - time[0]),
    }


def setting_of(ride: RideLog) -> tuple[Plant[Any], Scenario]:
    """Return bicycle and scenario of a ride; the paper's where the bag does not tell."""
    plant, scenario = _setting(ride)
    return plant or registry.default(), scenario or SCENARIOS[DEFAULT_SCENARIO]


def _setting(ride: RideLog) -> tuple[Plant[Any] | None, Scenario | None]:
    plant = _first(ride, "physics", registry.from_json)
    return plant, _first(ride, "scenario", Scenario.from_json)


def _simulated_time(ride: RideLog) -> Numbers:
    """Return (n,) s since the first state; the time continues over restarts of the simulator."""
    stamp = np.asarray(ride.states["header.stamp"], dtype=np.float64)
    steps = np.diff(stamp, prepend=stamp[:1])
    return np.cumsum(np.where(steps < 0, 0.025, steps))


def _first(ride: RideLog, name: str, read: Callable[[str], Content]) -> Content | None:
    """Read `name` from the first episode; None if the bag has none, or of another version."""
    for text in ride.episodes.get(name, ()):
        try:
            return read(text)
        except (ValueError, TypeError):
            return None
    return None


def _newest_before(
    messages: Mapping[str, NDArray[Any]], places: NDArray[np.int64]
) -> NDArray[np.intp]:
    """Return (n,) rows of the newest message before each place in recorded order, -1 for none."""
    if "recorded_order" not in messages:
        return np.full(len(places), -1)
    return np.searchsorted(messages["recorded_order"], places, side="left") - 1


def _table(
    ride: RideLog,
    time: Numbers,
    newest: NDArray[np.intp],
    riders: Numbers,
    scenario: Scenario | None,
) -> list[Numbers]:
    """Return the columns of `Sample`."""
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
        riders,
        *rewards,
        *_estimated(ride, time),
    ]


def _estimated(ride: RideLog, time: Numbers) -> list[Numbers]:
    """Return the columns of the estimates of the same steps, NaN where there are none."""
    states, found = ride.states, ride.estimates
    rows = np.full(len(time), -1)
    if len(found.get("step", ())):
        of_step = zip(found["episode"].tolist(), found["step"].tolist(), strict=True)
        newest = {key: row for row, key in enumerate(of_step)}
        keys = zip(states["episode"].tolist(), states["step"].tolist(), strict=True)
        rows = np.array([newest.get(key, -1) for key in keys])
    columns = [_at(found, name, rows) for name in ESTIMATED.values()]
    return [time, *columns[1:]]


def _at(messages: Mapping[str, NDArray[Any]], name: str, rows: NDArray[np.intp]) -> Numbers:
    """Return a column at some rows; NaN if there is none."""
    if name not in messages or not len(messages[name]):
        return np.full(len(rows), np.nan)
    return np.where(rows >= 0, messages[name][np.maximum(rows, 0)], np.nan)


def _riders(
    ride: RideLog, newest: NDArray[np.intp], names: Mapping[str, str]
) -> tuple[list[ListedPolicy], Numbers]:
    """Return the policies that rode, in order of first use, and (n,) their index per row."""
    numbers = np.full(len(newest), np.nan)
    if "policy" not in ride.commands or not len(ride.commands["policy"]):
        return [], numbers
    ids = np.where(newest >= 0, ride.commands["policy"][np.maximum(newest, 0)], "")
    known = [str(policy) for policy in dict.fromkeys(ids.tolist()) if policy]
    for number, policy in enumerate(known):
        numbers[ids == policy] = number
    return [rider(policy, names) for policy in known], numbers
