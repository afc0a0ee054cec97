from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from run_compare import after
from training_maker import small_run

from bicycle_controller.data.replay_buffer import ReplayBuffer
from bicycle_controller.training import online
from bicycle_controller.training.collector import Collector
from bicycle_controller.training.episode_log import COLUMNS, TERMS, TRACK_COLUMNS, read_columns

ON = ("record.episodes=true", "record.tracks_every=3", "record.track_step=4")
LIMIT = 60


class Still:
    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.zeros((len(observation), 2))


class Lean:
    """Falls, sooner or later."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.full((len(observation), 2), 0.6)


def logged(folder: Path, steps: int, agent: object, *overrides: str) -> dict[str, np.ndarray]:
    """Return the episodes of some steps of two bicycles."""
    config = small_run("bicycles=2", "warm_up=0", "noise.kind=none", *ON, *overrides)
    collector = Collector(config, ReplayBuffer(10_000, 2))
    for _ in range(steps):
        collector.step(agent)  # type: ignore[arg-type]
    folder.mkdir()
    collector.flush(folder)
    return read_columns(folder / "episodes.csv")


def test_an_episode_counts_the_same_whether_a_fall_freezes_or_ends_it(tmp_path: Path) -> None:
    frozen = logged(tmp_path / "a", 40, Lean(), "ddpg.fall=frozen")
    absorbed = logged(tmp_path / "b", 39, Lean(), "ddpg.fall=absorbing")
    assert list(frozen) == list(COLUMNS)
    assert frozen["fallen"].tolist() == [1.0, 1.0]
    assert frozen["end"].tolist() == [80.0, 80.0]
    assert frozen["steps"].tolist() == [40.0, 40.0]
    assert frozen["upright"].max() < 39
    first = {name: values[:2] for name, values in absorbed.items()}
    assert first["end"].max() < 80.0
    for name in ("episode", "steps", "upright", "return", "fallen", "speed", *TERMS):
        assert np.allclose(np.sort(first[name]), np.sort(frozen[name]), rtol=1e-7), name


def test_the_terms_add_up_to_the_return_that_the_collector_counts(tmp_path: Path) -> None:
    config = small_run("bicycles=3", "warm_up=0", "noise.kind=none", *ON)
    collector = Collector(config, ReplayBuffer(10_000, 2))
    for _ in range(120):
        collector.step(Still())
    collector.flush(tmp_path)
    found = read_columns(tmp_path / "episodes.csv")
    assert len(found["return"]) == 9
    total = collector.metrics()
    assert found["return"].mean() == pytest.approx(total["return"], rel=1e-7)
    assert np.allclose(sum(found[name] for name in TERMS), found["return"], rtol=1e-7)
    assert found["speed"] == pytest.approx(np.full(9, 10.0 / 3.6))
    straight = np.hypot(found["goal_x"] - found["start_x"], found["goal_y"] - found["start_y"])
    ridden = 10.0 / 3.6 * 0.025 * found["upright"]
    assert (np.abs(straight - found["distance"]) <= 1.01 * ridden).all()


def test_a_reached_goal_ends_the_count_of_steps(tmp_path: Path) -> None:
    goal = ["scenario.goal.low=[0, 0]", "scenario.goal.high=[0.1, 0.1]"]
    goal += ["scenario.start.low=[0, 1.5]", "scenario.start.high=[0.1, 1.6]"]
    found = logged(tmp_path / "a", 400, Still(), *goal, "scenario.heading_spread=3.14")
    reached = found["reached"] == 1
    assert reached.any()
    assert (found["steps"][reached] < 40).all()
    assert (found["distance"][reached] <= 1.0).all()
    assert (found["steps"][~reached] == 40).all()


def test_tracks_are_those_of_every_third_episode(tmp_path: Path) -> None:
    episodes = logged(tmp_path / "a", 125, Still())
    tracks = read_columns(tmp_path / "a" / "tracks.csv")
    assert list(tracks) == list(TRACK_COLUMNS)
    assert set(tracks["episode"]) == {0.0, 3.0}
    mine = tracks["episode"] == 3.0
    assert tracks["step"][mine][0] == 0.0
    assert (np.diff(tracks["step"][mine]) <= 4).all()
    (row,) = np.flatnonzero(episodes["episode"] == 3.0)
    assert tracks["x"][mine][0] == pytest.approx(episodes["start_x"][row])
    moved = np.hypot(np.diff(tracks["x"][mine]), np.diff(tracks["y"][mine]))
    assert moved == pytest.approx(10.0 / 3.6 * 0.025 * np.diff(tracks["step"][mine]), rel=0.01)


@pytest.mark.parametrize("fall", ["frozen", "absorbing"])
def test_a_resumed_run_writes_the_same_bytes(fall: str, tmp_path: Path) -> None:
    config = small_run(*ON, f"ddpg.fall={fall}", "starts.ride_on=0.5")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    online.run(config, whole)
    online.run(config, parts, stop=after(70))
    for name in ("episodes.csv", "tracks.csv"):
        with (parts / name).open("a") as file:  # what a killed run wrote after its checkpoint
            file.write("7,7,7\n")
    online.resume(parts, stop=after(61))
    online.resume(parts)
    for name in ("episodes.csv", "tracks.csv"):
        assert (parts / name).read_bytes() == (whole / name).read_bytes()
        assert (whole / name).read_text().count("\n") > 10


def test_recording_changes_no_number_and_is_off_by_default(tmp_path: Path) -> None:
    online.run(small_run(), tmp_path / "plain")
    online.run(small_run(*ON), tmp_path / "recorded")
    assert not (tmp_path / "plain" / "episodes.csv").exists()
    policies = [(tmp_path / name / "last.safetensors") for name in ("plain", "recorded")]
    from bicycle_controller.policy.policy import load_policy

    one, other = (load_policy(path).tensors for path in policies)
    assert all(np.array_equal(one[key], other[key]) for key in one)


def test_a_broken_file_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n3\n")
    with pytest.raises(ValueError, match=r"cannot read .*a\.csv"):
        read_columns(path)
