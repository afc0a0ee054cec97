"""Falls and kicks of the actors for any bicycle on the page of bicycles: those of the files."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from bicycle_controller.policy.policy import load_policy

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "bicycles.md").read_text()
RESULTS = ROOT / "tests" / "benchmarks" / "results"
NOISY = {
    "any-bicycle": json.loads((RESULTS / "noisy_rides.json").read_text()),
    "sure-any-bicycle": json.loads((RESULTS / "noisy_rides_sure.json").read_text()),
    "lqr": json.loads((RESULTS / "noisy_rides.json").read_text()),
    "teachers-true": json.loads((RESULTS / "noisy_rides_teachers.json").read_text()),
}
"""Files with the falls of each controller."""
LABELS = {
    "any-bicycle": "`any-bicycle`", "sure-any-bicycle": "`sure-any-bicycle`", "lqr": "LQR",
    "teachers-true": "its teachers, true state",
}  # fmt: skip
KICKS = json.loads((ROOT / "docs" / "results" / "sure-any-bicycle" / "kicks.json").read_text())


def falls(name: str) -> dict[float, list[int]]:
    """Return falls by delay in s, in the order of the speeds."""
    found: dict[float, list[int]] = {}
    for cell in NOISY[name]["cells"]:
        if cell["controller"] == name:
            found.setdefault(cell["delay_s"], []).append(cell["falls"])
    return found


@pytest.mark.parametrize("name", LABELS)
def test_the_falls_on_the_page_are_those_that_were_counted(name: str) -> None:
    counted = falls(name)
    assert counted
    for delay, numbers in counted.items():
        start = re.escape(f"| {LABELS[name]} | {1000 * delay:.0f} ms |")
        row = re.search(rf"^{start}(.*)\|$", PAGE, re.MULTILINE)
        assert row is not None, (name, delay)
        assert [int(cell) for cell in row[1].split("|")] == numbers


def test_the_kicks_on_the_page_are_those_that_were_caught() -> None:
    table = PAGE.partition("<!-- kicks of sure-any-bicycle -->")[2]
    told = dict(re.findall(r"^\| (\S+ \| \d+ ms) \|(.*)\|$", table, re.MULTILINE)[:6])
    measured: dict[str, list[float]] = {}
    for row in KICKS["kicks"]:
        if row["motor lag (s)"] != 0.0:
            caught = row["caught"]
            key = f"{row['bicycle']} | {1000 * row['delay (s)']:.0f} ms"
            share = caught["sure-any-bicycle"] / caught["best of the grid"]
            measured.setdefault(key, []).append(share)
    assert told.keys() == measured.keys()
    for key, shares in measured.items():
        cells = [float(cell) for cell in told[key].split("|")]
        assert cells == pytest.approx(shares, abs=0.0051), key


def test_the_seeds_on_the_page_are_those_that_were_ridden() -> None:
    file = ROOT / "docs" / "results" / "sure-any-bicycle" / "seeds.json"
    seeds = json.loads(file.read_text())["seeds"]
    fallen = ", ".join(str(sum(row["falls_of_1440"])) for row in seeds)
    names = ", ".join(str(row["seed"]) for row in seeds)
    assert f"of 10,080 rides each: {fallen} (seeds {names};" in PAGE
    assert seeds[0]["policy"] == load_policy("sure-any-bicycle").policy_id


def test_the_measured_actor_is_the_shipped_one() -> None:
    policy = load_policy("sure-any-bicycle")
    rides = NOISY["sure-any-bicycle"]
    assert rides["policies"]["sure-any-bicycle"] == KICKS["network"] == policy.policy_id


def test_the_falls_from_sensors_are_those_that_were_counted() -> None:
    """Rides of the surer actor from sensors, of five bicycles and of the ten others."""
    page = (ROOT / "docs" / "real-bicycle.md").read_text()
    folder = ROOT / "docs" / "results" / "hardware"
    counted = {}
    for name in ("everything", "others", "calm"):
        file = {"others": "others-{}-wind-2", "calm": "others-{}-wind-1"}.get(name, name + "-{}")
        found = json.loads((folder / f"{file.format('sure-any-bicycle')}.json").read_text())
        assert found["controller"] == "sure-any-bicycle"
        rows = found["rows"]
        counted[name] = sum(row["falls"] for row in rows), sum(row["rides"] for row in rows)
    fallen, rides = counted["everything"]
    assert f"{fallen} fall in {rides:,} rides, on `steer-by-wire`" in page
    assert f"in {counted['others'][0]} by `sure-any-bicycle`" in page
    assert counted["others"][1] == counted["calm"][1] == 3000
    assert counted["calm"][0] == 0
