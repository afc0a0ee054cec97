"""Tables of what the shipped actors do, against the files that they name."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGE = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
LIMITS = json.loads((ROOT / "tests" / "benchmarks" / "results" / "limits.json").read_text())
CONDITIONS = {
    "action late by 25 ms": "--action-delay 1",
    "by 50 ms": "--action-delay 2",
    "by 75 ms": "--action-delay 3",
    "by 100 ms": "--action-delay 4",
    "start at 1 m/s": "--speed 1",
    "at 2 m/s": "--speed 2",
    "at 2.5 m/s": "--speed 2.5",
    "at 4 m/s": "--speed 4",
    "at 5 m/s": "--speed 5",
    "a push of 0.35 rad/s": "--roll-kick 0.35",
    "of 0.5 rad/s": "--roll-kick 0.5",
    "of 0.75 rad/s": "--roll-kick 0.75",
    "noise of 0.1 (rad, rad/s, rad/s²) on all six observations": "--observation-noise 0.1",
    "the corrected physics": "--physics corrected",
}
"""Rows of the table, by the options of `bicycle evaluate` that they were ridden with."""
ACTORS = ("fixed-speed", "small-displacement", "learned-speed", "naf", "ppo")
"""Actors in the order of the table's columns."""
AGAINST = {
    "fixed-speed": "lqr-20cm",
    "small-displacement": "lqr-displacement",
    "learned-speed": "lqr-displacement-pedal",
}


def cells(label: str) -> list[str]:
    """Return the cells of the row that begins with a label."""
    (found,) = re.findall(rf"^\| {re.escape(label)} \|(.*)\|$", PAGE, re.MULTILINE)
    return [cell.strip() for cell in found.split("|")]


def ridden(condition: str, rider: str, actor: str) -> dict[str, Any]:
    scenario = LIMITS["actors"][actor]["scenario"]
    found: dict[str, Any] = LIMITS["conditions"][condition][f"{rider} in {scenario}"]
    return found


@pytest.mark.parametrize("label", CONDITIONS)
def test_what_the_actors_cannot_do_is_what_was_measured(label: str) -> None:
    for actor, cell in zip(ACTORS, cells(label), strict=True):
        numbers = [float(number) for number in re.findall(r"\d+(?:\.\d+)?", cell)]
        own = ridden(CONDITIONS[label], actor, actor)
        lqr = ridden(CONDITIONS[label], LIMITS["actors"][actor]["lqr"], actor)
        shares = [own["fall_rate"], lqr["fall_rate"]]
        if "never arrive" in cell:
            shares.append(own["timeout_rate"])
        assert numbers == pytest.approx([100.0 * share for share in shares], abs=0.5), actor
        assert own["timeout_rate"] < 0.3 or "never arrive" in cell, actor


SURE = json.loads((ROOT / "tests" / "benchmarks" / "results" / "limits_sure.json").read_text())
"""The actor that was trained on harder rides, under the same conditions and more."""


@pytest.mark.parametrize("condition", SURE["conditions"])
def test_what_the_surer_actor_does_is_what_was_measured(condition: str) -> None:
    rows = SURE["conditions"][condition], LIMITS["conditions"].get(condition, {})
    names = ("sure-fixed-speed", "fixed-speed", "lqr-20cm")
    cells_of_row = cells(f"`{condition}`")
    assert len(cells_of_row) == len(names)
    for name, cell in zip(names, cells_of_row, strict=True):
        found = next((row[key] for row in rows for key in row if key.startswith(f"{name} ")), None)
        if found is None:
            assert cell == ""
            continue
        shares = [100.0 * found["reach_rate"], 100.0 * found["fall_rate"]]
        assert [float(number) for number in cell.split(", ")] == pytest.approx(shares, abs=0.06)


def test_rides_that_are_sooner_as_soon_and_later_are_all_rides() -> None:
    counts = cells("rides in which the actor is sooner / as soon / later")
    saved = cells("time saved in the median ride")
    for (actor, lqr), count, less in zip(AGAINST.items(), counts, saved, strict=True):
        file = ROOT / "docs" / "results" / actor / f"against-{lqr}.json"
        found = json.loads(file.read_text())["comparison"]
        differ = found["both_reach"] - found["same_time"]
        sooner = round(found["faster_share"] * differ)
        expected = [sooner, found["same_time"], differ - sooner]
        assert [int(number.replace(",", "")) for number in count.split(" / ")] == expected
        assert sum(expected) == found["both_reach"]
        assert float(less.removesuffix(" %")) == pytest.approx(
            100.0 * (1.0 - found["time_ratio"]), abs=0.006
        )


def column(label: str) -> list[str]:
    """Return the numbers of a row of the page's first table, without what stands in brackets."""
    return [re.match(r"[\d.,]+", cell)[0] for cell in cells(label)]  # type: ignore[index]


def test_the_readme_says_what_the_page_says() -> None:
    rows = re.findall(r"^\| \S.* \| `(\S+)` \|(.*)\|$", README, re.MULTILINE)
    figures_of = {name: [cell.strip() for cell in rest.split("|")] for name, rest in rows}
    reached, falls, times = (
        column(row) for row in ("goals reached", "falls", "time to goal, median")
    )
    for actor, *figures in zip(AGAINST, reached, falls, times, strict=True):
        assert [cell.removesuffix(" s") for cell in figures_of[actor][:3]] == figures


def test_the_readme_is_short_and_its_prose_holds_few_numbers() -> None:
    assert len(README.splitlines()) <= 120
    prose = re.sub(r"^```.*?^```", "", README, flags=re.DOTALL | re.MULTILINE)
    lines = [line for line in prose.splitlines() if not line.startswith("|")]
    words = re.sub(r"\]\([^)]*\)|`[^`]*`|!\[[^\]]*", " ", "\n".join(lines)).split()
    numbers = [word for word in words if re.search(r"\d", word)]
    assert len(numbers) <= 0.04 * len(words), numbers


BENCHMARKS = ROOT / "tests" / "benchmarks"
TRAINING = (ROOT / "docs" / "training.md").read_text(encoding="utf-8")
RL = (ROOT / "docs" / "rl.md").read_text(encoding="utf-8")
GOALS = json.loads((BENCHMARKS / "results" / "goals.json").read_text())
UPDATES = json.loads((BENCHMARKS / "results" / "updates.json").read_text())


def table_program(name: str) -> Any:
    """Return the program of the benchmarks that makes a table."""
    spec = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    assert spec
    assert spec.loader
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)
    return program


def test_the_table_of_peers_is_made_of_its_file() -> None:
    peer_table = table_program("peer_table")
    assert "\n".join(peer_table.rows(GOALS)) in TRAINING
    for sentence in peer_table.sentences(GOALS):
        assert sentence in TRAINING


def test_every_page_has_the_times_of_ours_and_of_the_best_peer() -> None:
    peer_table = table_program("peer_table")
    best = peer_table.best_peer(GOALS)
    medians = {name: f"{peer_table.seconds(GOALS, name):.1f}" for name in ("quick", "fast", best)}
    row = re.search(r"^\| from nothing to 99 % of 1,000 random goals.*$", PAGE, re.MULTILINE)
    assert row
    assert f"| {medians['quick']}, preset `quick`; {medians['fast']}, `fast`," in row[0]
    assert f"| {medians[best]}, " in row[0]
    times = re.search(r"^\| what \| environment steps \|.*?\n\n", RL, re.DOTALL | re.MULTILINE)
    assert times
    told = re.findall(r"^\|.* M \| ([\d.]+) s, ", times[0], re.MULTILINE)
    assert told == list(medians.values())


def test_the_readme_names_the_best_peer() -> None:
    peer_table = table_program("peer_table")
    best = peer_table.best_peer(GOALS)
    assert best in ("ppo-tuned", "ppo-tuned-fast"), "README and docs/rl.md name another peer"
    assert "the quickest peer, stable-baselines3's PPO tuned for this task" in README
    assert "less than a third of the processor time" in README
    assert 3.0 * peer_table.seconds(GOALS, "quick") <= peer_table.seconds(GOALS, best)


def test_updates_beside_peers_are_those_of_their_file() -> None:
    updates_table = table_program("updates_table")
    assert "\n".join(updates_table.rows(UPDATES)) in PAGE
    assert updates_table.sentence(UPDATES) in PAGE
