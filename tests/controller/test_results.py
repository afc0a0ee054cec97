from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from busy_machine import UNHURRIED
from hypothesis import given
from hypothesis import strategies as st

from bicycle_controller.evaluation.evaluate import wilson
from bicycle_controller.reproduce import experiment as experiments
from bicycle_controller.reproduce import summary
from bicycle_controller.reproduce.experiment import MODES
from bicycle_controller.reproduce.result import collect
from bicycle_controller.reproduce.results import PAGES, render, render_pages
from bicycle_controller.reproduce.summary_fields import filled
from bicycle_controller.reproduce.tables import interval, read_table, share

ROOT = Path(__file__).parent.parent.parent
COMMITTED = ROOT / "docs" / "results" / "reproduction"


def test_interval_worked_by_hand() -> None:
    # Of 27 samples one is 1, 1, 1, which is more than 2.5 % of them.
    assert interval([1.0, 2.0, 3.0]) == [2.0, 1.0, 3.0]
    # Of 256 samples one has the mean 0, four 0.25, and 2.5 % of them are 6.4.
    assert interval([0.0, 1.0, 2.0, 3.0]) == [1.5, 0.5, 2.5]
    assert interval([5.0]) == [5.0, None, None]
    assert interval([]) == [None, None, None]


@UNHURRIED
@given(st.lists(st.integers(0, 40), min_size=1, max_size=8), st.floats(-1e3, 0.0))
def test_no_interval_leaves_what_there_can_be(hits: list[int], least: float) -> None:
    mean, low, high = share(hits, [40] * len(hits))
    assert 0.0 <= low <= mean <= high <= 1.0
    returns = [least * hit for hit in hits]
    for end in interval(returns):
        assert end is None or min(returns) - 1e-6 <= end <= max(returns) + 1e-6


def test_a_share_knows_how_its_runs_differ() -> None:
    # Three runs of 1,000 rides: pooled, Wilson's interval would be 16.1 to 18.8 %.
    assert share([507, 15, 0], [1000] * 3) == pytest.approx([0.174, 0.0, 0.507], abs=1e-12)
    # Where they do not differ, that none in 40 is not never.
    assert share([0, 0], [20, 20]) == pytest.approx([0.0, *wilson(0, 40)])
    with pytest.raises(ValueError, match="no run"):
        share([], [])


FOLDERS = [
    COMMITTED / name / mode
    for name in (*experiments.names(), *experiments.causes())
    for mode in MODES
    if (COMMITTED / name / mode / "run.json").exists()
]


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_every_committed_summary_follows_from_its_raw_data(folder: Path) -> None:
    assert json.loads((folder / "summary.json").read_text()) == summary.summarise(folder)
    run = json.loads((folder / "run.json").read_text())
    assert run["physics"] == folder.name
    assert run["commit"] != "unknown"
    assert not run["commit"].endswith("+")
    assert {"command", "wall_s", "cpu_s", "seeds"} <= run.keys()
    trained = {entry["arm"] for entry in run["training"] if entry["status"] == "finished"}
    rows = read_table(folder / "curves.csv")
    assert trained == {row["arm"] for row in rows}
    # Nothing stands there twice.
    keys = [(row["arm"], row["variant"], row["seed"], row["at"]) for row in rows]
    assert len(set(keys)) == len(keys)
    ridden = read_table(folder / "rides.csv")
    keys = [(row["rider"], row["variant"], row["seed"], 0) for row in ridden]
    assert len(set(keys)) == len(keys)
    # The environment steps that a run reports are those that its episodes add up to.
    for entry in run["training"]:
        mine = [
            row["at"]
            for row in rows
            if all(row[key] == entry[key] for key in ("arm", "variant", "seed"))
        ]
        result = max(mine) * run["experiment"]["limit"]
        assert entry["steps"] * 0.9 <= result <= entry["steps"]


def test_results_md_follows_from_the_committed_data() -> None:
    assert len(collect(COMMITTED)) == len(FOLDERS) > 0
    assert (ROOT / "RESULTS.md").read_text() == render(COMMITTED, ROOT)
    pages = render_pages(COMMITTED, ROOT)
    assert {path.name for path in (ROOT / PAGES).glob("*.md")} == pages.keys()
    for name, text in pages.items():
        assert (ROOT / PAGES / name).read_text() == text
        for link in re.findall(r"\]\(([^)#]*)\)", text):
            assert (ROOT / PAGES / link).exists(), (name, link)


def test_no_interval_on_a_page_leaves_what_there_can_be() -> None:
    number = r"(−?[0-9][0-9,.]*)"
    pattern = re.compile(rf"{number}( %| s|) \({number} to {number}\)")
    count = 0
    for text in render_pages(COMMITTED, ROOT).values():
        for match in pattern.finditer(text):
            found = (match[1], match[3], match[4])
            value, low, high = (float(x.replace(",", "").replace("−", "-")) for x in found)
            assert low <= value <= high, match[0]
            if match[2] == " %":
                assert 0.0 <= low <= high <= 100.0, match[0]
            elif match[2] == " s":
                assert low > 0.0, match[0]
            count += 1
    assert count > 600


def test_a_mean_over_runs_says_so() -> None:
    for name, text in render_pages(COMMITTED, ROOT).items():
        for line in text.splitlines():
            cells = line.split(" | ")
            if len(cells) > 5 and re.match(r"[0-9−,]+ \(", cells[2] + cells[4]):
                assert re.match(r"[0-9]+ × ", cells[1]), (name, line)


def test_no_number_of_results_md_is_written_by_hand() -> None:
    """Times and settings are, as `10 s` and `±0.003`: what came out has a share or a sign."""
    text = re.sub(r"\{[^}]*\}", "", (COMMITTED / "summary.md").read_text())
    assert not re.search(r"[0-9] ?%|−[0-9]|of [0-9]", text)


def test_results_md_begins_with_a_page_to_read() -> None:
    text = (ROOT / "RESULTS.md").read_text()
    lines, table = text.split("| figure, ", 1)
    assert len(re.findall(r"^[0-9]+\. ", lines, re.MULTILINE)) == 10
    table, why = table.split("| why | ", 1)
    rows = [len(re.findall(r"^\| \[", part, re.MULTILINE)) for part in (table, why)]
    causes = sum(folder.parent.name.startswith("why-") for folder in FOLDERS)
    assert rows == [len(FOLDERS) - causes, causes]


def test_a_field_that_asks_for_nothing_is_named(tmp_path: Path) -> None:
    results = collect(COMMITTED)
    assert filled("{10 faithful lqr reached} {10 faithful verdict}", results, tmp_path)
    for field in ("{10 faithful lqr}", "{99 faithful verdict}", "{10 faithful me reached}", "{x}"):
        with pytest.raises(ValueError, match=r"summary\.md: the results hold nothing"):
            filled(field, results, tmp_path / "summary.md")
