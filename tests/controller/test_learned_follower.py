"""A follower that a network rides: its file, its symmetry, and its training."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from waiting import until

from bicycle_controller.control import followers
from bicycle_controller.control.learned_follower import SCALE, SHIPPED, Network, mirrored
from bicycle_controller.evaluation import course_score
from bicycle_controller.training import path_following
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


def test_a_training_leaves_a_follower_of_its_bicycle(tmp_path: Path) -> None:
    lines: list[str] = []
    out = tmp_path / "run"
    result = path_following.run(WHIPPLE, out, seed=1, steps=640, report=lines.append)
    assert (result.signal, result.steps) == (0, 640)
    assert result.best is not None
    assert len(lines) == 10
    assert (out / "log.csv").read_text().startswith("steps,phase,rms_m")
    file = str(out / path_following.NAME)
    assert followers.make(file, WHIPPLE).policy_id.startswith("learned-follow-")
    with pytest.raises(ValueError, match="another bicycle"):
        followers.make(file, registry.default())
    with pytest.raises(ValueError, match="is not empty"):
        path_following.run(WHIPPLE, out, steps=640)


@pytest.mark.parametrize(
    ("after", "number", "code"),
    [("log.csv", signal.SIGTERM, 143), ("follower.npz", signal.SIGINT, 130)],
)
def test_a_signal_leaves_the_follower_so_far(
    after: str, number: signal.Signals, code: int, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    steps = ["--steps", "64000" if after == "follower.npz" else "100000000"]
    words = ["train", "path-following", *steps, "--json", "--quiet", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "bicycle_controller.cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        until(lambda: (out / after).exists(), process)
        process.send_signal(number)
        said, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert (process.returncode, errors) == (code, "")
    result = json.loads(said)
    assert result["status"] == "interrupted"
    assert (result["rms"] is None) == (after == "log.csv")
    assert followers.make(result["follower"], WHIPPLE).policy_id.startswith("learned-follow-")
