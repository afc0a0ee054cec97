"""Bag as shown on the page: the ride, the bag's contents, and its repairs."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_bag.errors import BagError
from bicycle_bag.folder import visible
from bicycle_bag.metadata import BagMetadata
from bicycle_bag.reader import BagReader, bag_in
from bicycle_bag.repair import repair
from bicycle_bag.steps import states_name_commands
from bicycle_tools.drawing import LARGEST, Floats, ride_time
from bicycle_tools.outcomes import GoalOutcome, outcomes, unknown
from bicycle_tools.ride_log import (
    ECHO,
    EXPECTED,
    GOAL_STATUS,
    READ,
    RIDDEN,
    STATE,
    Columns,
    RideLog,
    load_ride,
    no_bicycle,
)
from bicycle_tools.summary import RideSummary, summarise


@dataclass(frozen=True)
class RidePage:
    """One bag, read and summed up.

    Attributes:
        name: its name on the page.
        path: of the bag, as the user named it.
        log: the ride; without states if the bag has none.
        summary: the ride in numbers.
        outcomes: outcomes of its goals.
        contents: contents of the bag.
        start: s, log time of its first message.
        notes: one line for each fact about the bag that the reader must know.
    """

    name: str
    path: Path
    log: RideLog
    summary: RideSummary
    outcomes: list[GoalOutcome]
    contents: BagMetadata
    start: float
    notes: tuple[str, ...]

    @property
    def has_states(self) -> bool:
        """True if there is a bicycle to draw."""
        return len(self.log.segment) > 0

    @cached_property
    def state_time(self) -> Floats:
        """Simulated time of each state since the start, (n,) s."""
        return ride_time(self.log)

    def time_of(self, columns: Columns) -> Floats:
        """Return when messages were recorded, on the page's time axis.

        Args:
            columns: of m messages, with `recorded_order` and `log_time`.

        Returns:
            (m,) s of simulated time, of the newest state recorded by then; since the bag's start
            by the recording's clock if it has no states.
        """
        if not self.has_states:
            logged: NDArray[Any] = columns.get("log_time", np.empty(0))
            return np.asarray(logged, dtype=np.float64) - self.start
        places: NDArray[Any] = columns.get("recorded_order", np.empty(0))
        rows = np.searchsorted(self.log.states["recorded_order"], places, side="right") - 1
        return self.state_time[np.clip(rows, 0, None)]

    def ends_of(self, goals: Sequence[GoalOutcome]) -> Floats:
        """Return when the last status of each goal was recorded, see `time_of`."""
        places = np.array([goal.place for goal in goals], dtype=np.int64)
        logged = np.array([goal.known_at for goal in goals], dtype=np.float64)
        return self.time_of({"recorded_order": places, "log_time": logged})

    def step_time(self, columns: Columns) -> Floats:
        """Return when the steps of messages were made; more exact than the time of recording.

        Args:
            columns: of messages with `episode` and `step`.

        Returns:
            One time per message, on the axis of `time_of`, also for steps without a state in the
            bag, and for every step after a restart of the simulator.
        """
        logged = self.time_of(columns)
        keys, wanted = _keys(self.log.states), _keys(columns)
        known, rows = np.unique(keys, return_index=True)
        if len(known) < len(keys) or not len(keys):
            return logged
        place = np.clip(np.searchsorted(known, wanted), 0, len(known) - 1)
        return np.where(known[place] == wanted, self.state_time[rows[place]], logged)


def _keys(columns: Columns) -> NDArray[np.uint64]:
    """Return one number for each step of each episode."""
    episode = np.asarray(columns.get("episode", ())).astype(np.uint64)
    return (episode << np.uint64(40)) + np.asarray(columns.get("step", ())).astype(np.uint64)


def load(path: Path, name: str, namespace: str | None = None) -> RidePage:
    """Read a bag; a damaged one is repaired in a copy.

    Args:
        path: bag directory, MCAP file, or the folder of a run of ride.sh.
        name: its name on the page.
        namespace: of the bicycle, if the bag holds several.

    Raises:
        BagError: if there is no bag, it cannot be repaired, or it holds no bicycle or several.
    """
    bag = bag_in(path)
    try:
        return _load(bag, path, name, namespace, ())
    except BagError as error:
        if "--repair" not in str(error):
            raise
    with tempfile.TemporaryDirectory(prefix="bicycle_report_") as scratch:
        copy = Path(scratch) / bag.name
        try:
            _copy(bag, copy)
            found = repair(copy)
        except OSError as error:
            raise BagError(
                f"{bag} is damaged and {scratch} has no room for a copy ({error.strerror}): "
                "run record.sh --repair on it first"
            ) from None
        lost = "" if not found.kept else str(found).split("; damaged")[0]
        note = f"The bag is not whole; shown is what a repair gets back. {lost}".strip()
        return _load(copy, path, name, namespace, (note,))


def _copy(bag: Path, copy: Path) -> None:
    if bag.is_file():
        shutil.copyfile(bag, copy)
        return
    copy.mkdir()
    for file in visible(bag, ".mcap"):
        shutil.copyfile(file, copy / file.name)


def _load(
    bag: Path, path: Path, name: str, namespace: str | None, notes: tuple[str, ...]
) -> RidePage:
    reader = BagReader(bag)
    log, more = _ride(reader, _prefix(reader, namespace))
    summary = summarise(log)
    contents = reader.metadata
    return RidePage(
        name=name,
        path=path,
        log=log,
        summary=summary,
        outcomes=outcomes(log.statuses),
        contents=contents,
        start=1e-9 * contents.starting_time_ns if contents.message_count else 0.0,
        notes=(*notes, *more),
    )


def _ride(reader: BagReader, prefix: str) -> tuple[RideLog, Sequence[str]]:
    """Return the ride, and what is missing for it.

    Raises:
        BagError: if the topics exist but have other contents.
    """
    try:
        log = load_ride(reader, prefix)
        summarise(log)
    except (KeyError, TypeError, IndexError, ValueError) as error:
        raise BagError(
            f"{reader.path}: its {prefix}{STATE} or the topics beside it are not of this "
            f"stack's types ({error}): choose another bicycle with --namespace"
        ) from None
    empty = [prefix + topic for topic in EXPECTED if not reader.counts.get(prefix + topic)]
    if prefix + ECHO in empty and states_name_commands(reader, prefix + STATE):
        empty.remove(prefix + ECHO)
    if prefix + GOAL_STATUS in empty and log.path_statuses:
        empty.remove(prefix + GOAL_STATUS)  # a course has no goals
    if not any(reader.counts.get(prefix + topic) for topic in RIDDEN):
        raise no_bicycle(reader)
    nothing = [f"Nothing was recorded of {', '.join(empty)}."] if empty else []
    return log, [*nothing, *_left_out(log)]


def _left_out(log: RideLog) -> Iterator[str]:
    """Yield a line about the bag's contents that are not part of its ride."""
    begun = [goal for goal in outcomes(log.statuses) if goal.begun_before]
    if begun:
        places = ", ".join(f"({goal.position[0]:.1f}, {goal.position[1]:.1f})" for goal in begun)
        yield (
            f"The goal at {places} was under way when the recording began: its time and path "
            "count from before."
        )
    if log.old_statuses:
        yield (
            f"{log.old_statuses} messages about goals from before the recording are left out: "
            "those goals were over by then, or the messages came twice."
        )
    if strange := unknown(log.statuses):
        yield (
            f"{strange} messages about goals are left out: their status is none of this release's."
        )
    if undrawn := _undrawn(log.states):
        yield (
            f"{undrawn} states hold numbers that are infinite or beyond {LARGEST:.0e}: these are "
            "not drawn."
        )
    if log.idle_commands:
        yield (
            f"{log.idle_commands} commands are left out: another controller ran beside the one "
            "that drove."
        )


def _undrawn(states: Columns) -> int:
    """Return the number of states with a number that is no bicycle's; NaN means "unknown"."""
    found = np.zeros(len(states["step"]), dtype=bool)
    for name, column in states.items():
        is_time = "time" in name or "stamp" in name
        if column.dtype.kind == "f" and column.ndim == 1 and not is_time:
            found |= np.abs(column) > LARGEST
    return int(found.sum())


def _prefix(reader: BagReader, namespace: str | None) -> str:
    """Return the namespace of the bag's bicycle.

    Raises:
        BagError: if the bag has none, or several of which none is chosen.
    """
    found = sorted(
        {
            name[: -len(topic)]
            for topic in READ
            for name in reader.topics
            if name.endswith(topic) and reader.counts.get(name)
        }
    )
    if not found:
        raise no_bicycle(reader)
    shown = ", ".join(prefix or "/" for prefix in found)
    if namespace is not None:
        wanted = f"/{namespace.strip('/')}".rstrip("/")
        if wanted not in found:
            raise BagError(f"{reader.path} has no bicycle {wanted or '/'}: it has {shown}")
        return wanted
    if len(found) > 1:
        raise BagError(f"{reader.path} holds several bicycles: choose --namespace of {shown}")
    return found[0]
