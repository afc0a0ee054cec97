"""`bicycle identify`: parameters from logs; simulated rides, real ones, and input that is none."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from bicycle_bag.columns import load_topics
from bicycle_bag.reader import BagReader
from bicycle_controller.cli.main import main
from bicycle_controller.identification import read_bag, read_csv, ride_model, windows
from bicycle_controller.identification.logs import resampled
from bicycle_sim.plants.whipple import catalogue
from bicycle_sim.plants.whipple.parameters import Parameters
from bicycle_sim.plants.whipple.plain_parameters import from_dict
from bicycle_sim.plants.whipple.plant import WhipplePlant

DATA = Path(__file__).parents[1] / "data" / "real_bicycles"
HEADER = ["speed", "lean_angle", "lean_rate", "fork_angle", "fork_rate", "command_fork"]


def ride(
    parameters: Parameters,
    speed: float,
    seconds: float,
    seed: int,
    shaken: float = 0.08,
    noise: float = 1.0,
) -> np.ndarray:
    """Return (n, 7) of a ride at 100 Hz: time and the columns of HEADER, with noise.

    A linear regulator keeps the bicycle upright while a random torque shakes it.
    """
    a, b = ride_model.system(parameters, ride_model.matrices(parameters), speed)
    found = solve_continuous_are(a, b[:, None], np.diag([10.0, 1.0, 1.0, 1.0]), np.eye(1))
    law = -b @ found
    random = np.random.default_rng(seed)
    plant = WhipplePlant(replace(parameters, time_step=0.01, substeps=2))
    state = plant.initial(np.zeros(1), np.zeros(1), np.zeros(1), np.array([speed]))
    shake, rows = 0.0, []
    for step in range(round(seconds * 100)):
        rate = float(state.lean_rate[0]) + noise * 0.01 * random.normal()
        angle = float(state.steer_angle[0])
        shake += 0.01 * (-3.0 * shake) + shaken * random.normal()
        seen = (float(state.lean_angle[0]), angle, rate, float(state.steer_rate[0]))
        torque = float(law @ seen) + shake
        rows.append(
            [
                0.01 * step,
                float(state.speed[0]),
                float(state.lean_angle[0]),
                rate,
                angle + noise * 0.001 * random.normal(),
                float(state.steer_rate[0]) + 0.05 * random.normal(),
                torque,
            ]
        )
        held = (np.array([speed - 0.01]), np.array([speed + 0.01]))
        state = plant.step(state, np.array([torque]), np.zeros(1), np.zeros(1), held)
    return np.array(rows)


def weave(p: Parameters, speed: float) -> complex:
    """Return the free weave."""
    return ride_model.weave(p, ride_model.matrices(p), speed, 0.0)


def write(path: Path, header: list[str], rows: np.ndarray) -> Path:
    """Write a log as CSV."""
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(header)
        table.writerows([[f"{value:.6g}" for value in row] for row in rows])
    return path


@pytest.mark.slow
def test_a_simulated_ride_gives_its_bicycle_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Starting from another bicycle's numbers, 120 s of noisy ride give modes within 2 %."""
    truth = catalogue.load("browser-rider").parameters
    truth = replace(truth, motor=replace(truth.motor, lag=0.02), delay=0.02)
    b = truth.bicycle
    wrong = replace(
        b, mB=b.mB * 0.95, IBxx=b.IBxx * 1.3, IBzz=b.IBzz * 0.7, IHzz=b.IHzz * 1.3, c=b.c + 0.01,
        zB=b.zB * 1.05, IFyy=b.IFyy * 1.1,
    )  # fmt: skip
    prior = tmp_path / "prior.yaml"
    prior.write_text(json.dumps({"bicycle": {k: float(v) for k, v in vars(wrong).items()}}))
    logs = []
    for number, speed in enumerate((3.5, 5.0, 6.5)):
        rows = ride(truth, speed, 40.0, number)
        logs.append(write(tmp_path / f"ride-{number}.csv", ["time", *HEADER], rows))
    out = tmp_path / "found.yaml"
    words = ["identify", *map(str, logs), "--bicycle", str(prior), "--out", str(out), "--json"]
    assert main(words) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["fitted_to"] == "the whole ride"
    assert "rR" in data["not_determined"]
    assert 0 < data["determined_combinations"]["count"] < data["determined_combinations"]["of"]
    assert data["held_out"]["explained_ahead"] > 0.3
    found = catalogue.load(out).parameters
    assert found.motor.lag == pytest.approx(0.02, abs=0.004)
    assert found.delay == pytest.approx(0.02, abs=0.004)
    for speed in (3.5, 4.0, 5.0, 6.0):
        true, got = weave(truth, speed), weave(found, speed)
        before = weave(catalogue.load(prior).parameters, speed)
        assert abs(got - true) < 0.02 * abs(true), speed
        assert abs(before - true) > 0.03 * abs(true), speed
    turned = ride(truth, 5.0, 20.0, 1)
    turned[:, [4, 6]] *= -1.0
    logs = [write(tmp_path / "turned.csv", ["time", *HEADER], turned)]
    assert main(["identify", str(logs[0]), "--bicycle", str(prior)]) == 2
    assert "add --steer-left" in capsys.readouterr().err


def test_logs_of_three_speeds_foretell_a_real_bicycle_at_another_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Logs at 7.2, 14.4 and 18 km/h predict weave at 10.8 km/h and lean rate after a push."""
    logs = [str(DATA / f"sbw_{speed}kph.csv.gz") for speed in ("7.2", "14.4", "18")]
    held = str(DATA / "sbw_10.8kph_impulses.csv.gz")
    out = tmp_path / "found.yaml"
    words = ["identify", *logs, "--bicycle", "steer-by-wire", "--held-out", held, "--json"]
    chart = tmp_path / "chart.png"
    assert main([*words, "--out", str(out), "--plot", str(chart)]) == 0
    assert chart.read_bytes().startswith(b"\x89PNG")
    data = json.loads(capsys.readouterr().out)
    assert data["fitted_to"] == "modes after pushes"
    assert data["held_out"]["explained_after_pushes"] > 0.7
    rows = json.loads((DATA / "sbw_weave_modes.json").read_text())["3.0"]
    sigma, omega = np.array(rows)[:, :2].mean(axis=0)
    found = catalogue.load(out).parameters
    mode = ride_model.weave(found, ride_model.matrices(found), 3.0, 2.0 * (6.5 - 3.0))
    assert mode.real == pytest.approx(sigma, abs=0.1)
    assert mode.imag == pytest.approx(omega, rel=0.03)
    assert {"IBzz", "damping"} & set(data["parameters"]) - set(data["not_determined"])


@pytest.mark.parametrize(
    ("header", "change", "message"),
    [
        ("speed,lean_rate,fork_angle", None, "lacks the torque: name a column command_fork"),
        ("speed,leen_rate,fork_angle,torque", None, "lacks the lean rate"),
        ("speed [furlongs],lean_rate,fork_angle,torque", None, "unknown unit 'furlongs'"),
        ("speed,speed,lean_rate,fork_angle,torque", None, "two columns are named 'speed'"),
        ("speed,lean_rate,fork_angle,torque", "x", "line 5: 'x' is no number (lean rate)"),
        ("speed,lean_rate,fork_angle,torque", "900", "no SI unit"),
        ("time,speed,lean_rate,fork_angle,torque", None, "the time does not rise at row"),
        ("speed,lean_rate,fork_angle,torque", None, "at least 15 s are needed"),
    ],
)
def test_bad_logs_are_refused_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    header: str,
    change: str | None,
    message: str,
) -> None:
    """Each with the column or the remedy."""
    lines = [["4.0", "0.01", "0.01", "0.1", "0.2"][: header.count(",") + 1] for _ in range(600)]
    for row, line in enumerate(lines):
        if change == "900":
            line[1] = "900"
        if change == "x" and row == 3:
            line[1] = "x"
    path = tmp_path / "bad.csv"
    path.write_text("\n".join([header, *(",".join(line) for line in lines)]))
    assert main(["identify", str(path)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_columns_come_in_any_order_unit_and_rate_with_gaps(tmp_path: Path) -> None:
    """Degrees, km/h, other names, 200 Hz, a missing second and missing values."""
    time = np.delete(0.005 * np.arange(2000), slice(600, 800))
    lean = np.sin(3.0 * time)
    rows = np.column_stack(
        [np.degrees(lean), time, 14.4 + 0.0 * time, np.degrees(0.1 * lean), 2.0 * lean]
    )
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    lines[300] = ",,,,"
    lines[300] = "," + f"{time[300]:.9g}" + ",,,"
    path = tmp_path / "log.csv"
    names = "roll_rate [deg/s],Time (s),Speed (km/h),steer_angle [deg],steer_torque"
    path.write_text("\n".join([names, *lines]))
    log = resampled(read_csv.read(path, 100.0)[0])
    assert [len(piece.speed) for piece in log.pieces] == [150, 149, 600]
    last = log.pieces[2]
    assert last.dt == pytest.approx(0.01)
    assert last.speed == pytest.approx(4.0)
    assert last.lean_rate == pytest.approx(np.sin(3.0 * (4.0 + 0.01 * np.arange(600))), abs=1e-6)
    assert last.steer_angle == pytest.approx(0.1 * last.lean_rate)


def test_a_bag_holds_the_torque_beside_the_states_that_it_leads_to() -> None:
    """The bag's own bicycle explains the ride, unless the torque is reversed or a step late."""
    path = DATA.parent / "whipple-state-2"
    physics = load_topics(BagReader(path), ["/bicycle/episode"])["/bicycle/episode"]["physics"][0]
    parameters = from_dict({k: v for k, v in json.loads(str(physics)).items() if k != "plant"})
    (log,) = read_bag.read(path)
    matrices, noise = ride_model.matrices(parameters), ride_model.OutputNoise(1e-3, 1e-3)
    piece = log.pieces[0]
    (stack,) = windows.stacks([windows.window(0, piece, 0, 40)])

    def left(torque: np.ndarray) -> float:
        rest = ride_model.residuals(parameters, matrices, stack._replace(torque=torque), noise)
        return float(np.sqrt((rest**2).mean()))

    true = left(stack.torque)
    assert true < 1.0
    assert left(-stack.torque) > 5.0 * true
    assert left(np.roll(stack.torque, 1, axis=1)) > 2.0 * true
    assert left(np.roll(stack.torque, -1, axis=1)) > 2.0 * true


def test_rides_in_one_file_are_told_apart(tmp_path: Path) -> None:
    """Column `log_kph` separates rides, as in the file of impulses; a jump of `row` cuts one."""
    lines = [
        f"{kph},{row},{kph / 3.6:.4f},{0.01 * (row % 7)},0.0,0.1"
        for kph, rows in ((7.2, [*range(100), *range(300, 400)]), (18.0, range(50, 150)))
        for row in rows
    ]
    path = tmp_path / "several.csv"
    path.write_text("\n".join(["log_kph,row,speed,lean_rate,fork_angle,command_fork", *lines]))
    found = read_csv.read(path, 100.0)
    assert [log.name for log in found] == ["several.csv 7.2 km/h", "several.csv 18 km/h"]
    assert [len(log.pieces) for log in found] == [2, 1]
    assert found[1].pieces[0].speed == pytest.approx(5.0)


def test_a_missing_file_and_bag_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line each."""
    assert main(["identify", str(tmp_path / "none.csv")]) == 2
    assert "there is no log" in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    assert main(["identify", str(tmp_path / "empty")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
