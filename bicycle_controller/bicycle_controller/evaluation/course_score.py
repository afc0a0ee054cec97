"""Score a follower on courses.

The keys of a course's result, as `bicycle evaluate --course NAME --json` prints them:

    course, follower, rides        what was ridden
    rms_m, largest_m               cross-track error of the rear contact's true place: root of the
                                   mean square, and the largest, over all rides
    end_error_m                    the largest at the end of the path
    falls, unfinished              rides
    time_s, distance_m, speed_m_s  mean of the rides
    torque_n_m                     root of the mean squared torque
    peak_lean                      rad, the largest
    radius_m                       of the sharpest turn of the path
    notes                          what was changed of the course's points
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from bicycle_common.progress import ProgressBar
from bicycle_common.validation import require
from bicycle_controller.control import courses, followers
from bicycle_controller.control.courses import Course
from bicycle_controller.control.path import Path, sampled
from bicycle_controller.evaluation.course_rides import CourseRides, Start, Trace, ride_courses
from bicycle_controller.evaluation.sensed_courses import ride_sensed
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors.settings import SensorSettings

RANDOM = "random"
"""Course name that stands for as many random roads as rides."""
ROAD_LENGTH = 150.0
"""m of a random road."""
STEP = 0.02
"""m between the points of a random road."""


def random_road(rng: np.random.Generator, radius: float, length: float = ROAD_LENGTH) -> Path:
    """Return a road of straights and arcs, 4 to 30 m each, with turns as sharp as `radius`, m.

    Its curvature jumps between them, which is harder than a real road.
    """
    bends: list[np.ndarray] = []
    total = 0.0
    while total < length:
        piece = rng.uniform(4.0, 30.0)
        bend = 0.0 if rng.random() < 0.3 else rng.uniform(-1.0, 1.0) / radius
        bends.append(np.full(round(piece / STEP), bend))
        total += piece
    yaw = np.cumsum(np.concatenate(bends)) * STEP + rng.uniform(-math.pi, math.pi)
    return sampled(np.cumsum(np.cos(yaw)) * STEP, np.cumsum(np.sin(yaw)) * STEP)


def chosen(name: str, radius: float) -> list[Course]:
    """Return the courses of a name: all, one, or a file's.

    Raises:
        CourseError: on a name, a file or a path that cannot be.
    """
    return [courses.load(one, radius) for one in (courses.names() if name == "all" else [name])]


def score(
    follower_name: str,
    course_name: str,
    plant: Plant[Any],
    rides: int = 1,
    seed: int = 0,
    speed: float | None = None,
    limits: tuple[float, float] = (2.0, 100.0),
    start: tuple[float, float] = (0.0, 0.0),
    sensors: SensorSettings | None = None,
    progress: bool = False,
) -> tuple[list[dict[str, Any]], list[tuple[Course, Trace]]]:
    """Ride courses and return their results, and the trace of each course's first ride.

    Args:
        follower_name: one of `followers.FOLLOWERS`.
        course_name: all, one of `courses.names`, a file, or random for as many random roads.
        plant: the bicycle.
        rides: of each course; the first begins on the path, all others as `start` says.
        seed: of starts and random roads.
        speed: m/s instead of the course's.
        limits: N m and N, largest |T| and |F|.
        start: m and rad, largest distance from the path's start and from its direction.
        sensors: on the bicycle, for an estimator that the follower sees; None is the truth.
        progress: True to tell it on standard error.

    Raises:
        ValueError: on a number out of range, or a course that cannot be read or ridden.
    """
    require(1 <= rides <= 100_000, f"{rides} rides: choose 1 to 100,000")
    plain = course_name != RANDOM and start == (0.0, 0.0)
    require(
        sensors is None or plain, "sensors ride courses from their start: no random, no --from"
    )
    require(speed is None or 1.0 <= speed <= 8.0, f"a speed of {speed} m/s: choose 1 to 8")
    follower = followers.make(follower_name, plant, *limits)
    radius = followers.tightest(follower)
    rng = np.random.default_rng(seed)
    if course_name == RANDOM:
        roads = [random_road(rng, radius / 0.8) for _ in range(rides)]
        groups = [[Course(RANDOM, road, 3.0) for road in roads]]
    else:
        groups = [[one] * rides for one in chosen(course_name, radius)]
    results, traces = [], []
    for group in ProgressBar(groups, desc="courses", unit="course", shown=progress):
        count = len(group)
        if sensors is not None:
            sensed, trace = ride_sensed(
                follower, plant, group[0], sensors, count, seed, speed, limits
            )
            results.append(_summary(group, follower.policy_id, sensed))
            traces.append((group[0], trace))
            continue
        left, turned = (rng.uniform(-most, most, count) for most in start)
        left[0] = turned[0] = 0.0
        found, ridden = ride_courses(
            follower,
            plant,
            [one.path for one in group],
            [one.speed if speed is None else speed for one in group],
            [one.laps for one in group],
            Start(left, turned),
            limits,
            traced=1,
        )
        results.append(_summary(group, follower.policy_id, found))
        traces.append((group[0], ridden[0]))
    return results, traces


def _summary(group: Sequence[Course], follower: str, rides: CourseRides) -> dict[str, Any]:
    weights = rides.time
    return {
        "course": group[0].name,
        "follower": follower,
        "rides": len(group),
        "rms_m": float(np.sqrt(np.average(rides.rms**2, weights=weights))),
        "largest_m": float(rides.largest.max()),
        "end_error_m": float(np.abs(rides.end_error).max()),
        "falls": int(rides.fallen.sum()),
        "unfinished": int((~rides.finished & ~rides.fallen).sum()),
        "time_s": float(rides.time.mean()),
        "distance_m": float(rides.distance.mean()),
        "speed_m_s": float(rides.distance.sum() / rides.time.sum()),
        "torque_n_m": float(np.sqrt(np.average(rides.torque**2, weights=weights))),
        "peak_lean": float(rides.peak_lean.max()),
        "radius_m": min(1.0 / max(one.path.sharpest, 1e-4) for one in group),
        "notes": list(group[0].path.notes),
    }


COLUMNS = (
    ("course", "course", "{}"),
    ("rides", "rides", "{}"),
    ("rms m", "rms_m", "{:.3f}"),
    ("max m", "largest_m", "{:.3f}"),
    ("falls", "falls", "{}"),
    ("unfinished", "unfinished", "{}"),
    ("time s", "time_s", "{:.1f}"),
    ("speed m/s", "speed_m_s", "{:.2f}"),
    ("torque N m", "torque_n_m", "{:.2f}"),
    ("sharpest m", "radius_m", "{:.1f}"),
)


def as_text(results: Sequence[dict[str, Any]]) -> str:
    """Return a table, one line a course."""
    rows = [[title for title, _, _ in COLUMNS]]
    for item in results:
        rows.append([shape.format(item[key]) for _, key, shape in COLUMNS])
    widths = [max(len(row[i]) for row in rows) for i in range(len(COLUMNS))]
    lines = []
    for row in rows:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  ".join(cells))
    notes = [f"{item['course']}: {note}" for item in results for note in item["notes"]]
    return "\n".join(lines + notes)


def draw(traces: Sequence[tuple[Course, Trace]], title: str, file: FilePath) -> None:
    """Draw each course with its first ride, and the cross-track error along it.

    Args:
        traces: courses and rides.
        title: the picture's title.
        file: where to, PNG.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as pyplot

    from bicycle_common.plot_style import FAINT, STYLE

    with pyplot.rc_context(dict[Any, Any](STYLE)):
        figure, axes = pyplot.subplots(
            len(traces), 2, figsize=(10, 2.6 * len(traces)), squeeze=False
        )
        for (one, trace), (plan, error) in zip(traces, axes, strict=True):
            plan.plot(one.path.x, one.path.y, color=FAINT, linewidth=3, label="path")
            plan.plot(trace.x, trace.y, color="#c0392b", linewidth=1, label="ridden")
            plan.set_aspect("equal", adjustable="datalim")
            plan.set_title(one.name, loc="left")
            plan.set_xlabel("x (m)")
            plan.set_ylabel("y (m)")
            error.plot(trace.along, trace.cross_track, color="#c0392b", linewidth=1)
            error.set_xlabel("along the path (m)")
            error.set_ylabel("cross-track error (m)")
        axes[0][0].legend(frameon=False, loc="best")
        figure.suptitle(title)
        figure.tight_layout()
        figure.savefig(file, dpi=110)
        pyplot.close(figure)
