from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from waiting import until

from bicycle_controller.cli import main
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.policy.policy import load_controller, load_policy
from bicycle_controller.reproduce import evaluate_experiments, formatting, logs, summary, training
from bicycle_controller.reproduce import experiment as experiments
from bicycle_controller.reproduce.experiment import Length, build
from bicycle_controller.reproduce.results import PAGES
from bicycle_controller.reproduce.tables import read_table, write_table
from bicycle_controller.training.episode_log import read_columns
from bicycle_sim.plants.choi.plant import ChoiPlant

TINY = ["--short", "--seeds", "1", "--physics", "faithful", "--quiet"]


def test_there_is_an_experiment_for_every_figure_of_section_5() -> None:
    figures = [f"figure-{number}" for number in range(9, 17)]
    assert experiments.names() == [*figures, "robustness"]
    full = {name: experiments.load(name).full for name in experiments.names()}
    assert (full["figure-10"].seeds, full["figure-10"].episodes) == (3, 5000)
    assert (full["figure-16"].seeds, full["figure-16"].episodes) == (3, 10000)
    assert full["figure-15"].episodes == 10000


def test_each_cause_changes_one_thing_at_a_time() -> None:
    """The first arm is the preset as it is; ours differ from it by what their names say."""
    for name in experiments.causes():
        item = experiments.load(name)
        assert item.picture == "cause"
        if item.arms:
            assert item.arms[0].set == ()
            assert {arm.preset for arm in item.arms} == {item.arms[0].preset}
            assert len({arm.set for arm in item.arms}) == len(item.arms) > 2


def test_the_runs_are_the_paper_s(tmp_path: Path) -> None:
    item = experiments.load("figure-10")
    runs = training.plan(item, tmp_path, "corrected", item.full)
    assert len(runs) == 3 * 5
    for run in runs:
        config = run.job.config
        assert config.steps == 5000 * 400
        assert config.scenario.displacement_limit == 0.2
        assert config.scenario.start_speed == pytest.approx(10.0 / 3.6)
        assert config.physics == ChoiPlant.named("corrected")
    assert {run.job.config.algorithm for run in runs} == {"ddpg", "naf", "ppo"}
    turn = experiments.load("figure-15")
    pedals = {
        run.variant.name: run.job.config.scenario.pedal_limit
        for run in training.plan(turn, tmp_path, "faithful", turn.full)
    }
    assert pedals == {"pedal": 100.0, "no-pedal": 0.0}
    wide = experiments.load("figure-12")
    limits = [wide.ridden(variant).displacement_limit for variant in wide.variants]
    assert limits == [0.0, 0.02, 0.05, 0.1, 0.2]


def test_figures_9_and_10_share_their_runs(tmp_path: Path) -> None:
    folders = []
    for name in ("figure-9", "figure-10"):
        item = experiments.load(name)
        runs = training.plan(item, tmp_path, "faithful", item.full, ["authors"])
        folders.append([run.job.folder for run in runs])
    assert folders[0] == folders[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [item.removeprefix("figure-") for item in (*experiments.names(), *experiments.causes())],
)
def test_every_short_form_makes_its_data_and_its_picture(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main.main(["reproduce", name, "--out", str(out), *TINY, "--json"]) == 0
    (item,) = experiments.find(name)
    folder = out / item.name / "faithful"
    assert json.loads(capsys.readouterr().out)[str(folder)] == summary.summarise(folder)
    picture = imread(folder / "figure.png")
    assert picture.shape[1] > 800
    assert float(picture[..., :3].std()) > 0.02
    run = json.loads((folder / "run.json").read_text())
    assert run["physics"] == "faithful"
    assert run["short"] is True
    assert {entry["status"] for entry in run["training"]} <= {"finished"}
    riders = {row["rider"] for row in read_table(folder / "rides.csv")}
    assert riders == {a.name for a in item.arms} | {r.name for r in item.riders}
    assert item.reports
    table = (out / "RESULTS.md").read_text()
    assert f"{PAGES.as_posix()}/{item.name}.md" in table
    page = out / PAGES / f"{item.name}.md"
    text = page.read_text()
    assert f"`bicycle reproduce {name}`" in text
    assert (page.parent / re.findall(r"!\[.*\]\((.*)\)", text)[0]).samefile(folder / "figure.png")
    assert item.paper in text
    (folder / "figure.png").unlink()
    assert main.main(["reproduce", name, "--out", str(out), "--draw-only"]) == 0
    assert np.array_equal(imread(folder / "figure.png"), picture)
    assert (out / "RESULTS.md").read_text() == table
    assert page.read_text() == text


MANY = 100_000
"""Episodes that no machine has made before it is told to stop."""


@pytest.mark.slow
def test_a_stopped_reproduction_goes_on_and_a_longer_one_too(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "bicycle_controller.cli.main", "reproduce", "11"]
    command += ["--out", str(out), "--arms", "authors", *TINY, "--episodes"]
    run = out / "runs" / "faithful" / "fixed-start-fixed-goal" / "authors" / "seed-1"
    going = subprocess.Popen([*command, str(MANY)], start_new_session=True)
    episodes = run / "episodes.csv"
    until(lambda: episodes.exists() and episodes.read_bytes().count(b"\n") > 3, going)
    os.kill(going.pid, signal.SIGINT)
    assert going.wait() == 130
    result = len(read_columns(run / "episodes.csv")["end"])
    assert 2 < result < MANY
    assert not (run / "result.json").exists()
    longer = result + 3
    (run / "config.yaml").write_text(
        (run / "config.yaml").read_text().replace(f"steps: {400 * MANY}", f"steps: {400 * longer}")
    )
    subprocess.run([*command, str(longer)], check=True, capture_output=True)
    assert json.loads((run / "result.json").read_text())["steps"] == 400 * longer
    subprocess.run([*command, str(longer + 2)], check=True, capture_output=True)
    assert json.loads((run / "result.json").read_text())["steps"] == 400 * (longer + 2)
    ends = read_columns(run / "episodes.csv")["end"]
    assert (np.diff(ends) > 0).all()
    assert ends[-1] > 400 * longer
    subprocess.run([*command, "3"], check=True, capture_output=True)
    assert json.loads((run / "result.json").read_text())["steps"] == 400 * (longer + 2)
    (curve,) = summary.summarise(out / "figure-11" / "faithful")["training"]
    assert curve["length"] == pytest.approx(ends[-1] / 400)


@pytest.mark.slow
def test_killed_while_two_run_it_goes_on_to_the_same_numbers(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "bicycle_controller.cli.main", "reproduce", "11", "--short"]
    command += ["--seeds", "2", "--episodes", "3", "--arms", "authors"]
    command += ["--physics", "faithful", "--quiet", "--out"]
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    seeds = Path("runs", "faithful", "fixed-start-fixed-goal", "authors")
    going = subprocess.Popen([*command, str(killed), "--parallel", "2"], start_new_session=True)
    logs = (killed / seeds).glob
    until(lambda: len(list(logs("seed-*/log.jsonl"))) == 2, going)
    going.kill()
    going.wait()
    subprocess.run([*command, str(killed)], check=True, capture_output=True)
    subprocess.run([*command, str(whole)], check=True, capture_output=True)
    for seed in ("seed-1", "seed-2"):
        result, expected = (out / seeds / seed for out in (killed, whole))
        assert (result / "episodes.csv").read_bytes() == (expected / "episodes.csv").read_bytes()
        tensors = [load_policy(folder).tensors for folder in (result, expected)]
        for name, values in tensors[1].items():
            assert np.array_equal(tensors[0][name], values), (seed, name)


def test_a_run_of_another_kind_is_refused(tmp_path: Path) -> None:
    item = experiments.load("figure-10")
    length = Length(1, 3, 5)
    (run,) = training.plan(item, tmp_path, "faithful", length, ["authors"])
    run.job.folder.mkdir(parents=True)
    from bicycle_controller.config import loading

    other = loading.changed(run.job.config, ["ddpg.tau=0.5"])
    (run.job.folder / "config.yaml").write_text(loading.dump(other))
    with pytest.raises(ValueError, match="other settings"):
        training.plan(item, tmp_path, "faithful", length)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["17"], "unknown figure '17'"),
        (["robustnes"], "'robustness'"),
        (["10", "--physics", "correct"], "'corrected'"),
        (["10", "--arms", "author"], "'authors'"),
        (["10", "--episodes", "0"], "--episodes"),
        (["10", "--seeds", "0"], "--seeds"),
        (["10", "--only-seeds", "2,x"], "--only-seeds takes"),
        (["10", "--only-seeds", "0"], "--only-seeds takes"),
        (["10", "--only-seeds", "2,7"], "give --seeds 7"),
        (["10", "--draw-only"], "no data"),
    ],
)
def test_mistakes(
    words: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["reproduce", *words, "--out", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert expected in err


def test_a_mistake_in_an_experiment_s_file_is_named() -> None:
    tree: dict[str, Any] = {"title": "t", "picture": "terms", "scenario": "learned-speed"}
    tree |= {"paper": "p", "differs": "d"}
    tree |= {key: {"seeds": 1, "episodes": 1, "rides": 1} for key in ("full", "short")}
    assert build("x", tree).title == "t"
    with pytest.raises(ValueError, match="did you mean 'riders'"):
        build("x", tree | {"rider": []})
    with pytest.raises(ValueError, match="unknown picture"):
        build("x", tree | {"picture": "pie"})


def test_tables_read_back_what_was_written(tmp_path: Path) -> None:
    rows = [{"name": "a", "x": 1.5, "n": 3, "none": None}]
    rows.append({"name": "b", "x": 2, "n": 0, "none": 1})
    write_table(tmp_path / "t.csv", rows)
    assert read_table(tmp_path / "t.csv") == rows
    assert read_table(tmp_path / "absent.csv") == []


def test_training_summary_worked_by_hand() -> None:
    rows = []
    for seed, shift in ((1, 0.0), (2, 2.0)):
        for at in range(1, 11):
            about = {"arm": "a", "role": "authors", "variant": "all", "seed": seed}
            values = dict.fromkeys((*summary.MEASURES, *summary.TERMS), -float(at) + shift)
            rows.append(about | {"at": float(at), "episodes": 4} | values)
    (found,) = summary.training(rows)
    assert (found["runs"], found["length"], found["longest"]) == (2, 10.0, 10.0)
    assert formatting.lengths(found) == "10"
    assert formatting.lengths({"length": 150.0, "longest": 5000.0}) == "150 to 5,000"
    assert found["first"]["return"][0] == pytest.approx(0.0)
    assert found["last"]["return"][0] == pytest.approx(-9.0)


def test_a_trace_is_the_ride_that_is_scored() -> None:
    item = experiments.load("figure-14")
    controller, physics = load_controller("fixed-speed"), ChoiPlant()
    scenario = item.ridden(item.variants[0])
    result = evaluate_experiments.trace(controller, scenario, physics, 20)
    scored = evaluate(controller, scenario, physics, 20, evaluate_experiments.SEED).rides
    assert result.length.tolist() == scored.steps.tolist()
    assert result.reached.tolist() == scored.reached.tolist()
    moved = np.hypot(np.diff(result.x, axis=0), np.diff(result.y, axis=0))
    for ride, length in enumerate(result.length):
        assert moved[:length, ride].sum() == pytest.approx(scored.path[ride], rel=1e-9)


def test_curves_average_every_episode_once(tmp_path: Path) -> None:
    item = experiments.load("figure-10")
    (run,) = training.plan(item, tmp_path, "faithful", Length(1, 10, 5), ["ppo"])
    training.make([run], 5, None, 1, False)
    log = read_columns(run.job.folder / "episodes.csv")
    rows = logs.curves(run, 400)
    weights = np.array([row["episodes"] for row in rows])
    assert weights.sum() == len(log["end"])
    means = np.array([row["return"] for row in rows])
    assert np.average(means, weights=weights) == pytest.approx(log["return"].mean())
    assert rows[-1]["at"] == pytest.approx(log["end"].max() / 400)


@pytest.mark.slow
def test_runs_made_elsewhere_stay_in_the_data(tmp_path: Path) -> None:
    """One machine trains `authors`, another `ppo`: the CSVs alone travel between them."""
    out = tmp_path / "out"
    command = ["reproduce", "10", "--out", str(out), *TINY, "--arms"]
    assert main.main([*command, "authors"]) == 0
    folder = out / "figure-10" / "faithful"
    before = {name: read_table(folder / name) for name in ("curves.csv", "rides.csv")}
    entries = json.loads((folder / "run.json").read_text())["training"]
    shutil.rmtree(out / "runs")
    assert main.main([*command, "ppo"]) == 0
    assert {row["arm"] for row in read_table(folder / "curves.csv")} == {"authors", "ppo"}
    rows = read_table(folder / "rides.csv")
    assert [row["rider"] for row in rows if row["seed"]] == ["authors", "ppo"]
    for name, old in before.items():
        column = "rider" if name == "rides.csv" else "arm"
        kept = [row for row in read_table(folder / name) if row[column] == "authors"]
        assert kept == [row for row in old if row[column] == "authors"]
    run = json.loads((folder / "run.json").read_text())
    assert [entry["arm"] for entry in run["training"]] == ["authors", "ppo"]
    assert run["training"][0] == entries[0]
    # The same run made again takes the place of what was kept; another kind stays no longer.
    assert main.main([*command, "authors", "--episodes", "4"]) == 0
    assert len({row["seed"] for row in read_table(folder / "rides.csv")}) == 2
    run = json.loads((folder / "run.json").read_text())
    assert (run["training"][0]["arm"], run["training"][0]["steps"]) == ("authors", 1600)
    shutil.rmtree(out / "runs")
    run["experiment"]["arms"] = [a | {"set": ["x"]} for a in run["experiment"]["arms"]]
    (folder / "run.json").write_text(json.dumps(run))
    assert main.main([*command, "ppo"]) == 0
    assert {row["arm"] for row in read_table(folder / "curves.csv")} == {"ppo"}


@pytest.mark.slow
def test_the_seeds_of_a_figure_are_shared_out_to_machines(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ["reproduce", "10", "--out", str(out), *TINY, "--seeds", "2", "--arms", "authors"]
    assert main.main([*command, "--only-seeds", "2"]) == 0
    made = [path.parent.name for path in out.rglob("result.json")]
    assert made == ["seed-2"]
    shutil.rmtree(out / "runs")
    assert main.main([*command, "--only-seeds", "1"]) == 0
    rows = read_table(out / "figure-10" / "faithful" / "rides.csv")
    assert [row["seed"] for row in rows if row["rider"] == "authors"] == [1, 2]


@pytest.mark.slow
def test_one_of_several_variants_made_again_takes_its_own_place(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ["reproduce", "12", "--out", str(out), *TINY, "--arms", "fast"]
    assert main.main(command) == 0
    runs = out / "runs" / "faithful"
    plain = runs / "fixed-start-fixed-goal"
    for folder in set(runs.iterdir()) - {plain}:
        shutil.rmtree(folder)
    assert main.main([*command, "--no-train"]) == 0
    rows = read_table(out / "figure-12" / "faithful" / "rides.csv")
    item = experiments.load("figure-12")
    trained = [row["variant"] for row in rows if row["rider"] == "fast"]
    assert trained == [variant.name for variant in item.variants]
