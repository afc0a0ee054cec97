"""Result of every training episode, and tracks of some: `episodes.csv` and `tracks.csv`.

episodes.csv, a line for each episode in the order in which they ended:

    episode            number, in the order in which they began
    end                environment steps, over all bicycles, when it ended
    steps              until the goal; the step limit where it was not reached
    upright            steps until it ended or the bicycle fell
    return             sum of the rewards (eq. 20); after a fall its last repeats to the limit
    reached, fallen    0 or 1
    lean_angle, lean_rate, lean_acceleration, heading_error     what each term adds to the return
    start_x, start_y, goal_x, goal_y     m
    distance           m from the goal at the end
    speed              m/s, mean while upright

tracks.csv, a line for every `track_step`-th step of every `tracks_every`-th episode:

    episode, step, x, y     of the rear contact, m
    speed                   m/s
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_controller.config.run import RecordConfig
from bicycle_sim.task.task import BicycleTask, Step

EPISODES, TRACKS = "episodes.csv", "tracks.csv"
TERMS = ("lean_angle", "lean_rate", "lean_acceleration", "heading_error")
COLUMNS = (
    *("episode", "end", "steps", "upright", "return", "reached", "fallen"),
    *(*TERMS, "start_x", "start_y", "goal_x", "goal_y", "distance", "speed"),
)
TRACK_COLUMNS = ("episode", "step", "x", "y", "speed")


class EpisodeLog:
    """Accumulates the running episodes of N bicycles; `flush` writes the ended ones to the disk.

    `state_dict` contains the state of the disk and of the running episodes, so that a resumed run
    writes the same bytes as an uninterrupted one.
    """

    def __init__(self, config: RecordConfig, task: BicycleTask) -> None:
        """Start with every bicycle in its current state."""
        count = task.count
        self.config = config
        self.number = np.zeros(count, dtype=np.int64)
        self.begun = 0
        self.upright = np.zeros(count, dtype=np.int64)
        self.terms = np.zeros((count, len(TERMS)))
        self.speed = np.zeros(count)
        self.start = np.zeros((count, 2))
        self.open: dict[int, list[tuple[float, ...]]] = {}
        self.rows: list[list[float]] = []
        self.track_rows: list[tuple[float, ...]] = []
        self.bytes = {EPISODES: 0, TRACKS: 0}
        self.begin(task, np.ones(count, dtype=bool))

    def begin(self, task: BicycleTask, mask: np.ndarray) -> None:
        """Start new episodes of the bicycles of `mask`, bool (N,), in their current state."""
        who = np.flatnonzero(mask)
        self.number[who] = self.begun + np.arange(len(who))
        self.begun += len(who)
        self.upright[who], self.terms[who], self.speed[who] = 0, 0.0, 0.0
        state = task.state
        self.start[who, 0], self.start[who, 1] = state.rear_x[who], state.rear_y[who]
        for index in who:
            if self.config.tracks_every and self.number[index] % self.config.tracks_every == 0:
                self.open[int(index)] = [self._point(task, index)]

    def add(self, task: BicycleTask, step: Step, ended: np.ndarray, steps: int) -> None:
        """Add one step of all; those of `ended`, bool (N,), end with it.

        Args:
            task: after the step, before any restart.
            step: its result.
            ended: bool (N,), whose episode ends.
            steps: environment steps made so far, summed over all bicycles.
        """
        standing = ~step.fallen
        self.upright += standing
        self.speed += np.where(standing, task.state.speed, 0.0)
        terms = np.array([step.terms[name] for name in TERMS]).T
        self.terms += terms
        for index in self.open:
            if standing[index] and task.steps[index] % self.config.track_step == 0:
                self.open[index].append(self._point(task, index))
        if ended.any():
            self._end(task, step, terms, ended, steps)

    def _end(
        self, task: BicycleTask, step: Step, terms: np.ndarray, ended: np.ndarray, steps: int
    ) -> None:
        """Add rows for the episodes that end; a fall's last terms repeat to the step limit."""
        limit = task.scenario.max_steps
        left = np.where(step.fallen, limit - task.steps, 0)
        sums = self.terms + left[:, None] * terms
        distance = task.goal_distance()
        for index in np.flatnonzero(ended):
            reached = bool(step.terminated[index])
            self.rows.append(
                [
                    *(self.number[index], steps, task.steps[index] if reached else limit),
                    *(self.upright[index], sums[index].sum(), reached, step.fallen[index]),
                    *(*sums[index], *self.start[index], task.goal_x[index], task.goal_y[index]),
                    *(distance[index], self.speed[index] / max(int(self.upright[index]), 1)),
                ]
            )
            points = self.open.pop(int(index), None)
            if points is not None:
                if points[-1][1] < task.steps[index] and not step.fallen[index]:
                    points.append(self._point(task, index))
                self.track_rows += points

    def _point(self, task: BicycleTask, index: Any) -> tuple[float, ...]:
        """Return a line of tracks.csv."""
        state = task.state
        where = (float(state.rear_x[index]), float(state.rear_y[index]), float(state.speed[index]))
        return (float(self.number[index]), float(task.steps[index]), *where)

    def flush(self, folder: Path) -> None:
        """Append ended episodes to the files of `folder`, after the part in the checkpoint."""
        for name, columns, rows in (
            (EPISODES, COLUMNS, self.rows),
            (TRACKS, TRACK_COLUMNS, self.track_rows),
        ):
            if name == TRACKS and not self.config.tracks_every:
                continue
            header = "" if self.bytes[name] else ",".join(columns) + "\n"
            text = "".join(",".join(f"{value:.9g}" for value in row) + "\n" for row in rows)
            with (folder / name).open("ab") as file:
                file.truncate(self.bytes[name])
                file.write((header + text).encode())
                file.flush()
                os.fsync(file.fileno())
                self.bytes[name] = file.seek(0, os.SEEK_END)
        self.rows, self.track_rows = [], []

    def state_dict(self) -> dict[str, Any]:
        """Return the running episodes and the files' lengths; complete after `flush`."""
        names = ("number", "upright", "terms", "speed", "start")
        return {name: getattr(self, name).copy() for name in names} | {
            "begun": self.begun,
            "open": {index: list(points) for index, points in self.open.items()},
            "bytes": dict(self.bytes),
            "rows": [*self.rows],
            "track_rows": [*self.track_rows],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`."""
        for name, value in state.items():
            setattr(self, name, value)


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file of numbers by name, each float64 (lines,).

    Raises:
        ValueError: if it cannot be read, or lines differ in length.
    """
    try:
        with path.open() as file:
            names = file.readline().strip().split(",")
            lines = file.read().splitlines()
        values = np.array([line.split(",") for line in lines], dtype=np.float64)
        values = values.reshape(len(lines), len(names))
    except (OSError, ValueError) as error:
        raise ValueError(f"cannot read {path}: {' '.join(str(error).split())}") from error
    return {name: values[:, index] for index, name in enumerate(names)}
