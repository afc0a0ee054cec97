from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from bicycle_controller.reproduce.claims import verdict
from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.result import ExperimentResult, collect
from bicycle_controller.reproduce.verdicts import DDPG, FigureVerdict, Part, is_short, training

ROOT = Path(__file__).parent.parent.parent
RESULTS = collect(ROOT / "docs" / "results" / "reproduction")
FAITHFUL = {item.experiment.name: item for item in RESULTS if item.mode == "faithful"}
CLAIMING = [item for item in RESULTS if item.experiment.name.startswith("figure-")]
ARMS = (DDPG, "naf", "ppo")
"""Arms that some claim is about."""


def lengthened(
    item: ExperimentResult, factor: float = 1.0, runs: int | None = None
) -> dict[str, Any]:
    """Return the result's summary, as if all that a claim is about had been run at its length."""
    found = copy.deepcopy(item.summary)
    full = item.experiment.full
    for entry in found["training"]:
        if entry["arm"] in ARMS:
            entry["length"] = entry["longest"] = factor * full.episodes
            entry["runs"] = full.seeds if runs is None else runs
            for part in ("first", "last"):
                entry[part]["return_by_run"] = [-3.0, -1.0, -2.0][: entry["runs"]]
    return found


def decided(experiment: Experiment, summary: dict[str, Any]) -> list[Part]:
    return [part for part in verdict(experiment, summary).parts if part.held is not None]


@pytest.mark.parametrize("item", CLAIMING, ids=lambda i: f"{i.experiment.name}-{i.mode}")
def test_nothing_held_that_was_not_run_at_its_length(item: ExperimentResult) -> None:
    short = any(
        is_short(item.experiment, training(item.summary, arm=arm))
        for arm in (ARMS if item.experiment.name == "figure-10" else (DDPG,))
    )
    found = verdict(item.experiment, item.summary)
    assert found.parts
    if short:
        assert not found.word.startswith("Held")


@pytest.mark.parametrize("item", CLAIMING, ids=lambda i: f"{i.experiment.name}-{i.mode}")
@pytest.mark.parametrize(("factor", "runs"), [(0.98, None), (1.0, 0)])
def test_shorter_or_fewer_runs_leave_a_claim_open(
    item: ExperimentResult, factor: float, runs: int | None
) -> None:
    if runs is not None:
        runs = item.experiment.full.seeds - 1
    found = decided(item.experiment, lengthened(item, factor, runs))
    # Only that NAF "cannot" balance is refuted by one run that does, however short.
    assert all(part.held is False and "NAF" in part.claim for part in found)


@pytest.mark.parametrize("name", ["figure-9", "figure-11", "figure-13", "figure-14", "figure-16"])
def test_runs_at_their_length_decide(name: str) -> None:
    item = FAITHFUL[name]
    found = verdict(item.experiment, lengthened(item))
    assert all(part.held is part.shows is not None for part in found.parts)
    assert not found.word.startswith("Open")


@pytest.mark.parametrize("item", CLAIMING, ids=lambda i: f"{i.experiment.name}-{i.mode}")
def test_ours_and_the_classical_controller_decide_nothing(item: ExperimentResult) -> None:
    alone = {
        key: [e for e in entries if e.get("arm", e.get("rider")) not in ARMS]
        for key, entries in lengthened(item).items()
    }
    for entry in alone["training"]:
        entry["length"], entry["runs"] = item.experiment.full.episodes, item.experiment.full.seeds
    found = verdict(item.experiment, alone)
    assert [part.held for part in found.parts] == [None] * len(found.parts)
    assert any("was not run" in part.shown for part in found.parts)


def test_an_arm_that_never_arrives_is_in_the_verdict() -> None:
    for name in ("figure-9", "figure-10", "figure-11"):
        item = FAITHFUL[name]
        found = copy.deepcopy(item.summary)
        for entry in [*found.get("rides", ()), *found.get("states", ())]:
            if entry["rider"] == DDPG:
                entry["reached"] = False if isinstance(entry["reached"], bool) else [0.0, 0.0, 0.0]
        notes = " ".join(verdict(item.experiment, found).notes)
        assert f"`{DDPG}` never arrives" in notes


def test_a_state_that_does_not_settle_is_told() -> None:
    item = FAITHFUL["figure-11"]
    found = lengthened(item)
    (ride,) = [entry for entry in found["states"] if entry["rider"] == DDPG]
    ride["reached"] = True
    for name in ("steer_angle", "steer_rate", "lean_angle", "lean_rate", "lean_acceleration"):
        ride[name]["end"] = 0.0
    ride["heading_error"]["end"] = 0.05 * 2.0 - 1e-9
    assert verdict(item.experiment, found).word == "Held"
    ride["lean_acceleration"]["end"] = 0.05 * 5.0 + 1e-6
    assert verdict(item.experiment, found).word == "Held in part (1 of 2)"
    ride["reached"] = False
    assert verdict(item.experiment, found).word == "Did not hold"


def test_figure_10_needs_all_three_and_their_spread() -> None:
    item = FAITHFUL["figure-10"]
    found = lengthened(item)
    by_arm = {entry["arm"]: entry for entry in found["training"]}
    ridden = {entry["rider"]: entry for entry in found["rides"]}
    for arm, ends in (
        (DDPG, [-3.0, -3.1, -3.2]),
        ("naf", [-9.0] * 3),
        ("ppo", [-5.0, -9.0, -4.0]),
    ):
        by_arm[arm]["first"]["return_by_run"] = [-20.0, -20.5, -21.0]
        by_arm[arm]["last"]["return_by_run"] = ends
        by_arm[arm]["last"]["return"] = [sum(ends) / 3, min(ends), max(ends)]
    ridden["naf"] |= {"fallen_by_run": [1.0, 0.9, 0.06], "runs": 3}
    assert verdict(item.experiment, found).word == "Held"
    ridden["naf"]["fallen_by_run"] = [1.0, 0.9, 0.04]
    assert verdict(item.experiment, found).word == "Held in part (3 of 4)"
    by_arm["ppo"]["last"]["return_by_run"] = [-4.0, -4.01, -4.02]
    assert [p.held for p in verdict(item.experiment, found).parts] == [True, False, False, False]


def test_the_words_count_the_parts() -> None:
    yes, no = Part("a", True, "x", True), Part("b", False, "y", True)
    so_far, unknown = Part("c", True, "z"), Part("d", None, "none")
    assert FigureVerdict((yes, yes)).word == "Held"
    assert FigureVerdict((no, no)).word == "Did not hold"
    assert FigureVerdict((yes, no, no)).word == "Held in part (1 of 3)"
    assert FigureVerdict((so_far, unknown)).word == "Open (so far 1 of 2)"
    assert FigureVerdict((yes, no, unknown)).word == "Open (so far 1 of 3, 1 held, 1 did not hold)"
    assert FigureVerdict(()).word == "No claim"
    assert [p.text for p in (yes, no, so_far, unknown)] == [
        "a: held; x",
        "b: did not hold; y",
        "c: open (so far yes); z",
        "d: open; none",
    ]
