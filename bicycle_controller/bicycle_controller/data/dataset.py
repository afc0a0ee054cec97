"""Recorded rides as training data: find, read, check and arrange them for the memory."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common.observation import ACTION_FIELDS
from bicycle_controller.data.bag_transitions import EPISODE, bicycles, extract
from bicycle_controller.data.transition_builder import Transitions
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario

if TYPE_CHECKING:
    from bicycle_bag.reader import BagReader
    from bicycle_controller.config.algorithms import DdpgConfig

LEAST = 5_000
"""Fewest transitions, about two minutes of riding: fewer do not suffice for learning."""
LANES = 256
"""Number of pursuits that are summed in parallel."""
WITHIN = 1.0 + 1e-9
"""Tolerance of rounding for actions at their limits."""


@dataclass(frozen=True)
class Source:
    """Origin of a part of the data set."""

    path: str
    transitions: int
    recorded: bool
    """True if the bag contained transitions; False if they were built from states and commands."""


@dataclass(frozen=True)
class Dataset:
    """All transitions of some bags, and the scenario and plant that they were ridden in."""

    transitions: Transitions
    scenario: Scenario
    plant: Plant[Any]
    sources: tuple[Source, ...]
    lost: dict[str, int]
    """Number of messages missing in the bags, by kind."""
    load_s: float
    """Time spent on reading, s."""


def load(paths: Sequence[Path | str], scenario: Scenario | None = None) -> Dataset:
    """Read every bag of `paths`.

    Args:
        paths: bags, or folders that hold bags at any depth.
        scenario: of bags that do not name theirs; of all bags by default.

    Raises:
        ValueError: one line with the remedy, when a bag cannot be read, holds no ride, or was
            ridden in another scenario or on another bicycle than the others.
        ModuleNotFoundError: without the package `bicycle_bag`.
    """
    from bicycle_bag.errors import BagError

    started = time.monotonic()
    parts: list[Dataset] = []
    try:
        for bag in [bag for path in paths for bag in find_bags(Path(path))]:
            parts += _read(bag, scenario)
    except BagError as error:
        raise ValueError(str(error)) from None
    _check_alike(parts)
    lost: dict[str, int] = {}
    for part in parts:
        for name, count in part.lost.items():
            lost[name] = lost.get(name, 0) + count
    return replace(
        parts[0],
        transitions=Transitions.join([part.transitions for part in parts]),
        sources=tuple(source for part in parts for source in part.sources),
        lost=lost,
        load_s=time.monotonic() - started,
    )


def find_bags(path: Path) -> list[Path]:
    """Return the bag at `path`, or all bags below it.

    Raises:
        ValueError: if there is none.
    """
    if path.is_file() or any(path.glob("*.mcap")):
        return [path]
    if not path.is_dir():
        raise ValueError(f"there is no bag {path}: name a bag directory or a folder of bags")
    found = sorted({file.parent for file in path.rglob("*.mcap")})
    if not found:
        raise ValueError(f"{path} holds no bag: name a folder that record.sh or ride.sh made")
    return found


def _read(path: Path, scenario: Scenario | None) -> list[Dataset]:
    """Read one data set per bicycle of a bag."""
    from bicycle_bag.reader import BagReader

    reader = BagReader(path)
    there = bicycles(reader)
    if not there:
        raise ValueError(f"{path} holds no bicycle: record bicycle/state")
    parts = []
    for prefix in there:
        ridden, plant = _setting(reader, prefix, scenario)
        found = extract(reader, prefix, ridden)
        source = Source(str(path), len(found.transitions), found.recorded)
        parts.append(Dataset(found.transitions, ridden, plant, (source,), found.lost, 0.0))
    return parts


def _setting(
    reader: BagReader, prefix: str, known: Scenario | None
) -> tuple[Scenario, Plant[Any]]:
    """Scenario and plant of a bicycle's episodes, which must all have the same."""
    from bicycle_bag.columns import load_topics

    topic = prefix + EPISODE
    if not reader.counts.get(topic, 0):
        if known is None:
            raise ValueError(
                f"{reader.path} does not say what was ridden (no {topic}): name it with --scenario"
            )
        return known, registry.default()
    columns = load_topics(reader, [topic])[topic]
    pairs = set(zip(columns["scenario"], columns["physics"], strict=True))
    if len(pairs) > 1:
        raise ValueError(f"{reader.path} holds rides in {len(pairs)} settings: record each alone")
    scenario, physics = pairs.pop()
    try:
        return Scenario.from_json(scenario), registry.from_json(physics)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{reader.path} is of another version: {error}") from None


def _check_alike(parts: list[Dataset]) -> None:
    first = parts[0]
    for part in parts:
        if (part.scenario, part.plant) != (first.scenario, first.plant):
            one, other = first.sources[0].path, part.sources[0].path
            raise ValueError(
                f"{other} ({part.scenario.name}) was ridden in another scenario or on "
                f"another bicycle than {one} ({first.scenario.name}): learn from each alone"
            )


def check(data: Dataset, least: int = LEAST) -> list[str]:
    """Refuse data from which nothing can be learned.

    Returns:
        Warnings.

    Raises:
        ValueError: on too few transitions, numbers that are not finite, or actions beyond the
            scenario's limits; one line with the remedy.
    """
    found, limits = data.transitions, data.scenario.action_limits
    if len(found) < least:
        raise ValueError(
            f"{len(found)} transitions are too few to learn from, at least {least} are needed:"
            f" record {_minutes(data, least)} minutes or more, with goals"
        )
    for name in ("observation", "action", "reward", "next_observation"):
        bad = ~np.isfinite(getattr(found, name).reshape(len(found), -1)).all(axis=1)
        if bad.any():
            raise ValueError(f"{bad.sum()} transitions hold a {name} that is not finite")
    beyond = (np.abs(found.action) > limits * WITHIN).any(axis=0)
    if beyond.any():
        name = ACTION_FIELDS[int(np.argmax(beyond))]
        limit = limits[int(np.argmax(beyond))]
        raise ValueError(
            f"actions are beyond the limits of {data.scenario.name} ({name} within {limit:g}):"
            " a simulator refuses such commands, so record the ride again"
        )
    warnings = []
    if not found.fallen.any():
        warnings.append(
            "no falls in the data: the critic cannot know what they cost; record with more noise"
        )
    if not found.terminated.any():
        warnings.append("no goals in the data: record rides that reach some")
    return warnings


def _minutes(data: Dataset, steps: int) -> str:
    return f"{steps * data.plant.time_step / 60.0:.1g}"


def memory_rows(data: Dataset, ddpg: DdpgConfig) -> np.ndarray:
    """Return the data as n-step transitions, (M, width) float32, for `ReplayBuffer.add`.

    Whole pursuits are laid end to end in lanes that pass through `NStepAccumulator` in parallel.

    Raises:
        ValueError: unless falls absorb: a bag ends with the fall and has no frozen steps.
    """
    from bicycle_controller.data.replay_buffer import NStepAccumulator, RewardShaping

    if ddpg.fall != "absorbing":
        raise ValueError("bags hold no steps after a fall: set ddpg.fall=absorbing")
    found, limits = data.transitions, data.scenario.action_limits
    driven = np.flatnonzero(limits > 0)
    action = np.clip(found.action[:, driven] / limits[driven], -1.0, 1.0)
    lanes = lanes_of(found.ended)
    returns = NStepAccumulator(lanes.shape[1], len(driven), RewardShaping.of(ddpg))
    parts = []
    for rows in lanes:
        there = rows >= 0
        flags = (found.terminated[rows], found.truncated[rows] | ~there, found.fallen[rows])
        # A lane's padding is NaN, which identifies it in the output.
        seen = np.where(there[:, None], found.observation[rows], np.nan)
        out = returns.push(
            seen, action[rows], found.reward[rows], found.next_observation[rows], *flags
        )
        parts.append(out[np.isfinite(out[:, 0])])
    return np.concatenate(parts)


def lanes_of(ended: np.ndarray, count: int = LANES) -> np.ndarray:
    """Return the rows of whole pursuits in at most `count` lanes of similar length.

    Args:
        ended: bool (M,), the last row of each pursuit.
        count: largest number of lanes.

    Returns:
        (L, lanes) row numbers, -1 after a lane's end.
    """
    last = np.flatnonzero(ended)
    first = np.concatenate([[0], last[:-1] + 1])
    target = -(-len(ended) // count)
    lane = np.minimum(first // target, count - 1)
    _, lane = np.unique(lane, return_inverse=True)
    lengths = np.bincount(lane, weights=last + 1 - first).astype(np.int64)
    table = np.full((lengths.max(), len(lengths)), -1)
    ends = np.cumsum(lengths)
    for column, (end, length) in enumerate(zip(ends, lengths, strict=True)):
        table[:length, column] = np.arange(end - length, end)
    return table
