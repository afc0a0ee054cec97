"""The picture of a ride."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
from rides import commands, joined, ride, states, statuses

from bicycle_tools.drawing import ride_time
from bicycle_tools.picture import draw_ride, headline
from bicycle_tools.summary import summarise

GOALS = statuses(
    (1, 1, (10.0, 0.0), 10.0, 0.0), (1, 2, (10.0, 0.0), 1.0, 9.0), (2, 3, (4.0, 4.0), 5.0, 0.0)
)


def test_it_shows_the_track_and_each_goal_in_its_colour(tmp_path: Path) -> None:
    draw_ride(ride(states(200), GOALS, given=commands(199)), tmp_path / "ride.png")
    image = matplotlib.image.imread(tmp_path / "ride.png")
    assert image.shape[:2] == (1020, 1800)
    for colour in ("#0b8457", "#c0392b", "#3a5ba0", "#e08e0b"):
        wanted = np.array(matplotlib.colors.to_rgb(colour))
        assert (np.abs(image[..., :3] - wanted).max(axis=-1) < 0.02).sum() > 20, colour


def test_a_fall_before_the_first_goal_can_be_drawn(tmp_path: Path) -> None:
    log = ride(joined(states(9, fall_at=6), states(1, episode=2)))
    draw_ride(log, tmp_path / "ride.png")
    assert (tmp_path / "ride.png").stat().st_size > 10_000


def test_a_followed_path_is_told_and_its_error_drawn(tmp_path: Path) -> None:
    log = ride(joined(states(5), states(200, episode=2)))
    none = np.full(len(log.segment), np.nan)
    times = {"log_time": 100.0 + ride_time(log), "goal_distance": none}
    log = replace(log, states={**log.states, **times})
    moments = log.states["log_time"][::4]
    count = len(moments)
    numbers = ("length", "rms", "largest", "elapsed", "cross_track")
    path: dict[str, np.ndarray] = {name: np.full(count, 0.25) for name in numbers}
    path |= {
        "log_time": moments,
        "path_id": np.ones(count, int),
        "status": np.ones(count, int),
    }
    path |= {"name": np.full(count, "slalom"), "message": np.full(count, "")}
    log = replace(log, path_statuses=path)
    text = headline(summarise(log))
    assert text.startswith("slalom finished, 0.25 m off (RMS)   ·   no fall")
    assert "goals" not in text
    draw_ride(log, tmp_path / "with.png")
    draw_ride(replace(log, path_statuses={}), tmp_path / "without.png")
    images = [matplotlib.image.imread(tmp_path / f"{name}.png") for name in ("with", "without")]
    dark = [(image[-190:-60, 1100:, :3] < 0.5).all(axis=-1).any(axis=0) for image in images]
    assert dark[0].mean() > 0.5, "a line from end to end"
    assert dark[1].mean() < 0.2


def test_time_goes_on_over_a_reset() -> None:
    time = ride_time(ride(joined(states(5), states(5, episode=2))))
    assert np.allclose(np.diff(time), [0.025] * 4 + [0.0] + [0.025] * 4)
