"""Logs from our bags: states, and the commands that led from each to the next."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bicycle_bag.columns import load_topics
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader
from bicycle_bag.steps import runs, steps
from bicycle_common import topic_names
from bicycle_common.validation import require
from bicycle_controller.identification.logs import Log, log_of

STATE, COMMAND, ECHO = (
    topic_names.in_bag(name)
    for name in (topic_names.STATE, topic_names.COMMAND, topic_names.COMMAND_ECHO)
)


def read(path: Path) -> list[Log]:
    """Return a log for each bicycle of a bag.

    Raises:
        ValueError: if the bag cannot be read or lacks states or commands.
    """
    try:
        reader = BagReader(path)
        prefixes = sorted(n[: -len(STATE)] for n in reader.topics if n.endswith(STATE))
        require(bool(prefixes), f"{path}: has no topic {STATE.lstrip('/')}")
        return [_log(reader, prefix, path) for prefix in prefixes]
    except BagError as error:
        raise ValueError(str(error)) from error


def _log(reader: BagReader, prefix: str, path: Path) -> Log:
    names = [prefix + topic for topic in (STATE, ECHO, COMMAND)]
    columns = load_topics(reader, [name for name in names if name in reader.topics])
    states, echoes, commands = (columns.get(name, {}) for name in names)
    require(len(states.get("step", ())) > 1, f"{path}: {names[0]} has no messages")
    table = steps(states, echoes, commands)
    known = table["applied.known"].astype(bool)
    require(bool(known.any()), f"{path}: holds no commands: record {names[2].lstrip('/')}, too")
    # Torque over the step that leaves a state stands beside the next state.
    torque = np.append(table["applied.torque"][1:], np.nan)
    step, episode, run = (np.asarray(c) for c in (table["step"], table["episode"], runs(states)))
    breaks = np.ones(len(step), dtype=bool)
    breaks[1:] = (
        (np.diff(run) != 0)
        | (np.diff(episode.astype(int)) != 0)
        | (np.diff(step.astype(int)) != 1)
    )
    torque[:-1][breaks[1:]] = np.nan
    time = np.asarray(table["header.stamp"], dtype=float)
    fallen = table["fallen"].astype(bool)
    found = {
        "speed": table["speed"].astype(float),
        # In messages lean is positive to the right, steering to the left.
        "lean_rate": np.where(fallen, np.nan, -table["lean_rate"]),
        "steer_angle": table["steer_angle"].astype(float),
        "torque": torque,
    }
    return log_of(f"{path.name}{prefix}", time, found, breaks)
