"""Warning of `bicycle train` about a policy that rides clearly worse than the LQR."""

from __future__ import annotations

from pathlib import Path

import pytest

from bicycle_controller.cli import main
from bicycle_controller.config import loading
from bicycle_controller.evaluation.beside_lqr import lqr_score, warning
from bicycle_controller.evaluation.score import Score

LQR = Score(reach_rate=1.0, fall_rate=0.0, orbit_rate=0.0, median_time_s=27.0)


@pytest.mark.parametrize(
    ("reach", "falls", "time", "warns"),
    [
        (1.0, 0.0, 26.5, False),
        (0.995, 0.005, 29.0, False),
        (0.99, 0.0, 45.9, True),
        (0.98, 0.0, 27.0, True),
        (0.995, 0.02, 27.0, True),
        (0.0, 1.0, None, True),
    ],
)
def test_a_seed_that_learned_badly_is_told(
    reach: float, falls: float, time: float | None, warns: bool
) -> None:
    text = warning(Score(reach, falls, 0.0, time), LQR)
    assert bool(text) == warns
    if warns:
        assert text.startswith(
            "over the same starts the LQR reaches 100.0% of its goals in 27.0 s"
        )
        assert text.endswith("train longer, or try another --seed")


def test_without_an_lqr_nothing_is_compared() -> None:
    assert warning(Score(0.0, 1.0, 0.0, None), None) == ""


def test_the_lqr_rides_the_starts_of_the_run() -> None:
    config = loading.preset("fast", ["scenario=learned-speed", "evaluation.episodes=20"])
    found = lqr_score(config)
    assert found is not None
    assert (found.reach_rate, found.fall_rate) == (1.0, 0.0)
    assert found.near_reach_rate is None


def test_a_run_of_a_moment_is_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = ["evaluation.every=4", "evaluation.episodes=8"]
    words = ["--steps", "8000", *(word for change in changes for word in ("--set", change))]
    assert main.main(["train", "--out", str(tmp_path / "run"), *words, "--quiet"]) == 0
    printed = capsys.readouterr()
    assert "best policy" in printed.out
    (line,) = [line for line in printed.err.splitlines() if "warning" in line]
    assert line.startswith("bicycle: warning: over the same starts the LQR reaches")
