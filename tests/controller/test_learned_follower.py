"""A follower that a network rides: its file, its symmetry, and its training."""

from __future__ import annotations

import itertools
import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from run_compare import after, rows, same, state_of
from train_process import bicycle_train, start, struck, went_on
from waiting import until

from bicycle_controller.cli import main
from bicycle_controller.control import followers
from bicycle_controller.control.learned_follower import SCALE, SHIPPED, Network, mirrored
from bicycle_controller.evaluation import course_score
from bicycle_controller.training import path_following
from bicycle_controller.training.run_folder import PATH_CONFIG, RunFolder
from bicycle_sim.plants import registry

WHIPPLE = registry.named(plant="whipple", bicycle="browser-rider")


def test_left_is_the_mirror_image_of_right() -> None:
    network, rng = Network.load(SHIPPED), np.random.default_rng(0)
    seen = rng.normal(size=(5, len(SCALE)))
    assert network.act(mirrored(seen)) == pytest.approx(-network.act(seen))


def test_the_shipped_one_follows_a_circle() -> None:
    (found,), _ = course_score.score("learned", "circle-20", WHIPPLE)
    assert found["falls"] == found["unfinished"] == 0
    assert found["rms_m"] < 0.3


RUN = path_following.PathRun(WHIPPLE, steps=640, save_every=0.0)
"""Ten rounds, each with a score."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run without interruption."""
    out = tmp_path_factory.mktemp("paths") / "run"
    result = path_following.run(RUN, out)
    assert (result.status, result.signal, result.steps, result.updates) == ("finished", 0, 640, 80)
    assert result.best is not None
    return out


def test_a_training_leaves_a_follower_of_its_bicycle(whole: Path) -> None:
    found = rows(whole)
    assert [row["step"] for row in found] == list(range(64, 641, 64))
    assert [row["phase"] for row in found] == 3 * ["imitation"] + 7 * ["ddpg"]
    about = json.loads((whole / "run.json").read_text())
    assert about["seed"] == 1
    assert path_following.PathRun.load(whole / "path-following.json") == RUN
    file = str(whole / path_following.NAME)
    assert followers.make(file, WHIPPLE).policy_id.startswith("learned-follow-")
    with pytest.raises(ValueError, match="another bicycle"):
        followers.make(file, registry.default())
    with pytest.raises(ValueError, match="holds a run already: go on with --resume"):
        path_following.run(RUN, whole)
    with pytest.raises(ValueError, match="is not empty"):
        path_following.run(RUN, whole.parent)


def assert_same_follower(one: Path, other: Path) -> None:
    assert rows(one) == rows(other)
    assert same(state_of(one), state_of(other))
    mine, theirs = (Network.load(folder / path_following.NAME) for folder in (one, other))
    assert same(list(mine.weights), list(theirs.weights))
    assert same(list(mine.biases), list(theirs.biases))


def test_a_resumed_run_gives_the_same_numbers_to_the_bit(whole: Path, tmp_path: Path) -> None:
    parts = tmp_path / "parts"
    result = path_following.run(RUN, parts, stop=after(3))
    assert (result.status, result.steps) == ("interrupted", 4 * 64)
    assert path_following.resume(parts, stop=after(1)).status == "interrupted"
    assert path_following.resume(parts).status == "finished"
    assert_same_follower(whole, parts)


def test_a_run_that_signals_end_goes_on_to_the_same_end(whole: Path, tmp_path: Path) -> None:
    parts = tmp_path / "parts"
    RunFolder(parts, PATH_CONFIG).path.mkdir()
    RunFolder(parts, PATH_CONFIG).begin(RUN.dump(), RUN.seed)
    words = bicycle_train(parts, "path-following", "--resume")
    said = struck(words, parts, 2, signal.SIGINT)
    assert f"go on with: bicycle train path-following --resume --out {parts}" in said
    struck(words, parts, 6, signal.SIGKILL)
    assert "finished after 640 steps and 80 updates" in went_on(words)
    assert_same_follower(whole, parts)


def test_a_score_that_a_signal_ends_is_made_again(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scored = path_following.score
    calls = itertools.count()

    def interrupted(*args: Any) -> path_following.RoadScore:
        if next(calls) == 2:
            signal.raise_signal(signal.SIGINT)
        return scored(*args)

    monkeypatch.setattr(path_following, "score", interrupted)
    result = path_following.run(RUN, tmp_path / "run")
    assert (result.status, result.signal, result.steps) == ("interrupted", signal.SIGINT, 192)
    assert len(rows(tmp_path / "run")) == 2
    assert path_following.resume(tmp_path / "run").status == "finished"
    assert_same_follower(whole, tmp_path / "run")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--resume"], "holds a run of path-following: bicycle train path-following --resume"),
        (["path-following", "--resume", "--steps", "1280"], "steps cannot change"),
        (["path-following", "--resume", "--seed", "2"], "seed cannot change"),
        (["path-following", "--resume", "--bicycle", "benchmark"], "plant cannot change"),
        (["path-following", "--preset", "fast"], "--preset does not go with path-following"),
        (["path-following", "--set", "ddpg.tau=1"], "--set does not go with path-following"),
    ],
)
def test_a_run_says_what_does_not_go_with_it(
    words: list[str], line: str, whole: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["train", *words, "--out", str(whole)]) == 2
    said = capsys.readouterr().err
    assert line in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('{"steps": 640}', "it names no plant"),
        (f'{{"plant": {WHIPPLE.to_json()}, "steps": 1}}', "1 steps: choose 640"),
        (
            f'{{"plant": {WHIPPLE.to_json()}, "step": 1}}',
            r"has no field 'step' \(did you mean 'steps'\?\)",
        ),
        ('{"plant": 3}', "cannot read"),
        ("{", "cannot read"),
    ],
)
def test_a_damaged_configuration_is_one_line(text: str, line: str, tmp_path: Path) -> None:
    file = tmp_path / "path-following.json"
    file.write_text(text)
    with pytest.raises(ValueError, match=line) as caught:
        path_following.PathRun.load(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("after_file", "number", "code"),
    [("log.jsonl", signal.SIGTERM, 143), ("follower.npz", signal.SIGINT, 130)],
)
def test_a_signal_leaves_the_follower_so_far(
    after_file: str, number: signal.Signals, code: int, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    steps = ["--steps", "64000" if after_file == "follower.npz" else "100000000"]
    process = start(bicycle_train(out, "path-following", *steps, "--json"))
    try:
        until(lambda: (out / after_file).exists(), process)
        process.send_signal(number)
        said, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert (process.returncode, errors) == (code, "")
    result = json.loads(said)
    assert result["status"] == "interrupted"
    assert (result["rms"] is None) == (after_file == "log.jsonl")
    assert followers.make(result["follower"], WHIPPLE).policy_id.startswith("learned-follow-")
