"""Learning curves of runs and sweeps, and tables of runs and bags."""

from __future__ import annotations

import csv
import json
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bicycle_bag.columns import load
from bicycle_controller.cli.main import main
from bicycle_controller.config import loading
from bicycle_controller.training import logger
from bicycle_controller.training.learning_curves import interval, read

BAG = Path(__file__).parents[1] / "data" / "ride-0.1.0"


def run(folder: Path, seed: int, rates: list[float], preset: str = "fast") -> Path:
    """A run's folder with a log of such reach rates, one each thousand steps."""
    folder.mkdir(parents=True)
    config = loading.preset(preset, [f"seed={seed}"])
    (folder / "config.yaml").write_text(loading.dump(config))
    rows: list[dict[str, Any]] = [{"kind": "train", "step": 500, "critic_loss": 1.5}]
    for number, rate in enumerate(rates, 1):
        row = {"kind": "evaluation", "step": 1000 * number, "updates": number, "reach_rate": rate}
        rows.append(row)
    text = "".join(json.dumps(row) + "\n" for row in rows)
    (folder / "log.jsonl").write_text(text + '{"kind": "evalu')
    return folder


def test_seeds_of_one_configuration_are_one_curve(tmp_path: Path) -> None:
    for seed, last in enumerate([0.2, 0.6, 1.0], 1):
        run(tmp_path / "sweep" / f"seed-{seed}", seed, [0.0, last])
    other = run(tmp_path / "other", 1, [0.5, 0.5, 0.75], preset="paper")
    first, second = read([tmp_path / "sweep", other], "reach_rate", "step")
    assert (first.seeds, second.seeds) == (3, 1)
    np.testing.assert_array_equal(first.at, [1000, 2000])
    np.testing.assert_allclose(first.middle, [0.0, 0.6])
    np.testing.assert_allclose([first.low[-1], first.high[-1]], [0.2, 1.0])
    np.testing.assert_allclose(second.middle, [0.5, 0.5, 0.75])
    assert first.name.startswith("fast ")


@pytest.mark.parametrize("count", [1, 5, 6, 9, 20])
def test_the_band_holds_the_median_with_95_percent(count: int) -> None:
    low, high = interval(count)
    assert high == count - 1 - low
    held = 1.0 - 2.0 * sum(comb(count, k) for k in range(low + 1)) / 2.0**count
    assert held >= 0.95 if count >= 6 else (low, high) == (0, count - 1)


def test_plot_draws_and_tells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [str(run(tmp_path / f"run-{seed}", seed, [0.1, 0.9])) for seed in (1, 2)]
    picture = tmp_path / "out" / "curves.png"
    assert main(["plot", *runs, "--out", str(picture)]) == 0
    printed = capsys.readouterr().out
    assert "2 seeds, reach_rate at the end 0.9 (0.9 to 0.9)" in printed
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["plot", *runs, "--of", "critic_loss", "--out", str(picture), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["curves"][0]["last"] == 1.5
    for words, complaint in (
        ([str(tmp_path / "nothing")], "holds no run"),
        ([*runs, "--of", "reach"], "--of must be one of reach_rate"),
        ([*runs, "--of", "median_time_s"], "no median_time_s has been logged there yet"),
    ):
        assert main(["plot", *words, "--out", str(picture)]) == 2
        error = capsys.readouterr().err
        assert complaint in error
        assert error.count("\n") == 1


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_run_and_a_bag_become_csv(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.csv"
    folder = run(tmp_path / "run", 1, [0.25, 0.5])
    assert main(["export", str(folder), "--csv", str(out)]) == 0
    assert "3 rows" in capsys.readouterr().out
    assert [row["reach_rate"] for row in table(out)] == ["", "0.25", "0.5"]
    assert main(["export", str(BAG), "--csv", str(out)]) == 0
    states = load(BAG, "/bicycle/state")
    rows = table(out)
    assert [float(row["lean_angle"]) for row in rows] == states["lean_angle"].tolist()
    assert [row["fallen"] for row in rows] == [str(fallen) for fallen in states["fallen"].tolist()]
    assert main(["export", str(BAG), "--csv", str(out), "--topic", "bicycle/command"]) == 0
    assert "torque" in table(out)[0]
    capsys.readouterr()
    for words, complaint in (
        ([str(BAG), "--csv", str(out), "--topic", "bicycle/comand"], "did you mean"),
        ([str(tmp_path), "--csv", str(out)], "neither the folder of a run"),
        (["fixed-speed"], "give --to DIR"),
    ):
        assert main(["export", *words]) == 2
        assert complaint in capsys.readouterr().err


def test_progress_is_lines_where_there_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(logger, "BETWEEN_LINES", 0.0)
    with logger.Progress(2000, 0, "lines") as progress:
        progress.show(reach=0.5)
        progress.advance(500)
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith("25% of 2,000 steps, 0 s, ")
    assert line.endswith("s left, reach 0.5")
    with logger.Progress(2000, 0, False) as progress:
        progress.advance(500)
    assert capsys.readouterr().err == ""
