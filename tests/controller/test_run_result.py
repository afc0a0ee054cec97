"""The lines that train and learn print at the end of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bicycle_controller.cli import run_result
from bicycle_controller.evaluation.score import Score


@dataclass(frozen=True)
class Ended:
    status: str = "finished"
    best: Score | None = None
    wall_s: float = 12.4
    cpu_s: float = 9.6


def test_a_run_without_a_policy_is_one_line() -> None:
    text = run_result.as_text(Ended(), "5000 steps", "bicycle train", Path("runs/a"))
    assert text == "finished after 5000 steps in 12 s (10 s of processor time)"


def test_an_interrupted_run_names_the_command_that_goes_on() -> None:
    text = run_result.as_text(
        Ended(status="interrupted"), "7 updates", "bicycle learn", Path("runs/a")
    )
    assert text.splitlines()[-1] == "go on with: bicycle learn --resume --out runs/a"


def test_the_best_policy_stands_with_its_score() -> None:
    best = Score(reach_rate=0.975, fall_rate=0.01, orbit_rate=0.0, median_time_s=8.84)
    text = run_result.as_text(Ended(best=best), "1 step", "bicycle train", Path("a"))
    assert text.splitlines()[1] == (
        "best policy: a/best.safetensors: 97.5% reached, 1.0% fell, median 8.8 s"
    )
    never = Score(reach_rate=0.0, fall_rate=1.0, orbit_rate=0.0, median_time_s=None)
    text = run_result.as_text(Ended(best=never), "1 step", "bicycle train", Path("a"))
    assert text.endswith("100.0% fell, no goal")
