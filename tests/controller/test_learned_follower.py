"""A follower that a network rides: its file, its symmetry, and its training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
    path_following.run(WHIPPLE, out, seed=1, steps=640, report=lines.append)
    assert len(lines) == 10
    assert (out / "log.csv").read_text().startswith("steps,phase,rms_m")
    file = str(out / path_following.NAME)
    assert followers.make(file, WHIPPLE).policy_id.startswith("learned-follow-")
    with pytest.raises(ValueError, match="another bicycle"):
        followers.make(file, registry.default())
    with pytest.raises(ValueError, match="is not empty"):
        path_following.run(WHIPPLE, out, steps=640)
