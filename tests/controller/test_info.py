"""`bicycle info`: what it tells of a bicycle, as text, as JSON and as a chart."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from bicycle_controller.cli import main
from bicycle_sim.plants.whipple import catalogue

DATA = Path(__file__).parent.parent / "data" / "whipple"


def output(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main.main(["info", *arguments]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


def mistake(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    status = main.main(["info", *arguments])
    out, err = capsys.readouterr()
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    return err


def test_it_tells_the_published_figures(capsys: pytest.CaptureFixture[str]) -> None:
    found = json.loads(output(capsys, "benchmark", "--json"))
    assert found["mass"] == pytest.approx(94.0)
    assert found["head_angle"] == pytest.approx(72.0)
    assert (found["trail"], found["wheelbase"]) == (0.08, 1.02)
    exact = json.loads((DATA / "benchmark_critical_speeds.json").read_text())["exact"]
    assert found["critical_speeds"]["weave"] == [pytest.approx(exact["v_weave"], abs=1e-12)]
    assert found["self_stable"] == [
        [pytest.approx(exact["v_weave"]), pytest.approx(exact["v_capsize"])]
    ]
    rows = {row["speed"]: row for row in found["eigenvalues"]}
    assert list(rows) == [float(speed) for speed in range(11)]
    with (DATA / "benchmark_eigenvalues.csv").open() as file:
        for row in csv.DictReader(file):
            if row["mode"] == "real":
                continue
            mode = row["mode"].split()[0]
            expected = rows[float(row["v"])][mode]
            pair = expected[0] if mode == "weave" else expected
            assert pair == pytest.approx(
                [float(row["exact_re"]), float(row["exact_im"])], abs=1e-12
            )


def test_text_holds_what_people_look_for(capsys: pytest.CaptureFixture[str]) -> None:
    text = output(capsys, "benchmark")
    for words in ("94.00 kg", "72.00 deg", "4.2924 m/s", "6.0243 m/s", "4.292 to 6.024 m/s"):
        assert words in text
    assert "-0.775342 ± 4.464868i" in text
    assert "warning" not in text
    assert "from 2.841 m/s on" in output(capsys, "two-mass-skate")
    assert "warning: IFyy" in output(capsys, "steer-by-wire")


def test_it_lists_all_bicycles(capsys: pytest.CaptureFixture[str]) -> None:
    lines = output(capsys).splitlines()
    assert [line.split()[0] for line in lines] == catalogue.names()
    assert [item["name"] for item in json.loads(output(capsys, "--json"))] == catalogue.names()


def test_it_reads_a_file_and_says_what_was_estimated(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "measured: {wheelbase: 1.05, head_angle: 71, rear_radius: 0.34, front_radius: 0.34,\n"
        "  mass: 14.5, trail: 0.06}\n"
    )
    text = output(capsys, str(path), "--to", "8", "--step", "0.5")
    assert "estimated, not measured:" in text
    assert (
        "IBxx: rear frame's radius of gyration about x is 0.258 ± 0.03 m on ten measured" in text
    )
    assert text.count(" ± ") >= 10
    assert json.loads(output(capsys, str(path), "--json"))["estimated"]


@pytest.mark.parametrize("name", ["benchmark", "two-mass-skate", "yellow-reversed"])
def test_it_draws_the_chart(capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str) -> None:
    path = tmp_path / "new" / "chart.png"
    output(capsys, name, "--plot", str(path))
    assert path.read_bytes().startswith(b"\x89PNG")
    drawn = tmp_path / "chart.svg"
    output(capsys, name, "--plot", str(drawn))
    assert "<svg" in drawn.read_text()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["browsr"], "did you mean 'browser'"),
        (["benchmark", "--to", "40"], "--to must be above 0 and at most 30"),
        (["benchmark", "--to", "nan"], "--to must be above 0"),
        (["benchmark", "--step", "0"], "--step must be above 0"),
        (["benchmark", "--step", "1e-7"], "too many rows"),
        (["--plot", "x.png"], "--plot needs a bicycle"),
        (["benchmark", "--plot", "x.bmpx"], "bmpx"),
        (["benchmark", "--plt", "x.png"], "did you mean '--plot'"),
    ],
)
def test_mistakes_are_one_line(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert expected in mistake(capsys, *words)
