"""The linearised Whipple bicycle against published digits."""

from __future__ import annotations

import csv
from decimal import Decimal, getcontext

import numpy as np
import pytest
from whipple_maker import DATA, benchmark, published, riding

from bicycle_sim.plants.whipple import catalogue, linear, state_space
from bicycle_sim.plants.whipple.parameters import Bicycle, Motor, Parameters, Rider, Steering
from bicycle_sim.plants.whipple.plant import WhipplePlant, WhippleState


def test_matrices_of_the_benchmark() -> None:
    data = published("benchmark_matrices.json")
    found = linear.matrices(benchmark())
    for name, matrix in zip(("M", "C1", "K0", "K2"), found, strict=True):
        assert np.abs(matrix - np.array(data["exact"][name])).max() <= 4.5e-15, name
        # Half of the last digit that was printed.
        assert np.abs(matrix - np.array(data["published"][name])).max() <= 5e-15, name


def test_matrices_of_many_are_those_of_each() -> None:
    names = ("browser", "yellow", "two-mass-skate")
    each = [catalogue.load(name).parameters.bicycle for name in names]
    together = Bicycle(**{name: np.array([vars(b)[name] for b in each]) for name in vars(each[0])})
    for index, b in enumerate(each):
        for one, many in zip(linear.matrices(b), linear.matrices(together), strict=True):
            np.testing.assert_allclose(many[index], one, rtol=1e-15, atol=1e-15)


def test_eigenvalues_of_the_benchmark() -> None:
    with (DATA / "benchmark_eigenvalues.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 34
    for row in rows:
        found = linear.eigenvalues(benchmark(), float(row["v"]))
        exact = complex(float(row["exact_re"]), float(row["exact_im"]))
        assert np.abs(found - exact).min() < 1e-12, row
        rounded = complex(float(row["published_re"]), float(row["published_im"]))
        assert np.abs(found - rounded).min() < 1e-12, row


def polished(root: complex, coefficients: list[Decimal]) -> complex:
    """Return a root of a polynomial by Newton's method with 50 digits."""
    getcontext().prec = 50
    x, y = Decimal(root.real), Decimal(root.imag)
    for _ in range(4):
        value, slope = (Decimal(0), Decimal(0)), (Decimal(0), Decimal(0))
        for c in reversed(coefficients):
            slope = (
                slope[0] * x - slope[1] * y + value[0],
                slope[0] * y + slope[1] * x + value[1],
            )
            value = value[0] * x - value[1] * y + c, value[0] * y + value[1] * x
        size = slope[0] ** 2 + slope[1] ** 2
        x -= (value[0] * slope[0] + value[1] * slope[1]) / size
        y -= (value[1] * slope[0] - value[0] * slope[1]) / size
    return complex(float(x), float(y))


def test_eigenvalues_between_the_published_speeds() -> None:
    """The reference is the polynomial of the exact matrices, with roots in 50 digits."""
    exact = published("benchmark_matrices.json")["exact"]
    m, c, k0, k2 = (
        [[Decimal(value) for value in row] for row in exact[name]]
        for name in ("M", "C1", "K0", "K2")
    )
    for tenth in range(101):
        v = Decimal(tenth) / 10
        stiffness = [
            [Decimal("9.81") * k0[i][j] + v * v * k2[i][j] for j in (0, 1)] for i in (0, 1)
        ]
        entries = [[[stiffness[i][j], v * c[i][j], m[i][j]] for j in (0, 1)] for i in (0, 1)]
        coefficients = [Decimal(0)] * 5
        for a in range(3):
            for b in range(3):
                coefficients[a + b] += entries[0][0][a] * entries[1][1][b]
                coefficients[a + b] -= entries[0][1][a] * entries[1][0][b]
        for root in linear.eigenvalues(benchmark(), tenth / 10):
            assert abs(root - polished(root, coefficients)) < 1e-12 * max(1.0, abs(root))


def test_critical_speeds_of_the_benchmark() -> None:
    critical = linear.critical_speeds(benchmark())
    (double_root,) = linear.double_roots(benchmark())
    for which, tolerance in (("exact", 1e-13), ("published", 1e-12)):
        expected = published("benchmark_critical_speeds.json")[which]
        assert double_root[0] == pytest.approx(expected["v_double_root"], abs=tolerance)
        assert double_root[1] == pytest.approx(expected["lambda_double_root"], abs=tolerance)
        assert critical.weave == pytest.approx([expected["v_weave"]], abs=tolerance)
        assert critical.capsize == pytest.approx([expected["v_capsize"]], abs=tolerance * 10)
        weave = linear.modes(benchmark(), np.array([critical.weave[0]]))["weave"][0, 0]
        assert weave.imag == pytest.approx(expected["omega_weave"], abs=1e-12)
    assert critical.stable == (critical.weave + critical.capsize,)


def test_modes_have_the_names_of_the_literature() -> None:
    with (DATA / "benchmark_eigenvalues.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["mode"] != "real"]
    for row in rows:
        modes = linear.modes(benchmark(), np.array([float(row["v"])]))
        found = modes[row["mode"].split()[0]].ravel()[0]
        assert abs(found - complex(float(row["exact_re"]), float(row["exact_im"]))) < 1e-12


def test_self_stable_speeds_of_measured_bicycles() -> None:
    """The sets are BicycleParameters' rounded ones; it found the speeds on a 0.01 m/s grid."""
    data = published("rounded_bicycles.json")
    assert len(data["sets"]) == 12
    for name, values in data["sets"].items():
        low, high = data["self_stable"][name]
        (found,) = linear.critical_speeds(Bicycle(**values)).stable
        assert found[0] == pytest.approx(low, abs=0.01), name
        assert min(found[1], 15.0) == pytest.approx(high, abs=0.01 + 1e-9), name


def test_the_two_mass_skate_balances_itself_above_2_8_m_s() -> None:
    """Kooijman et al. 2011 (10.1126/science.1201959) found this, though nothing in it spins."""
    skate = catalogue.load("two-mass-skate").parameters.bicycle
    (stable,) = linear.critical_speeds(skate).stable
    assert stable[0] == pytest.approx(2.8, abs=0.05)
    assert stable[1] == np.inf


def leaning_rider() -> Parameters:
    """Return the bicycle and the limp rider that the published matrices are of."""
    p = catalogue.load("browser-leaning-rider").parameters
    assert p.rider is not None
    rider = Rider(**{**vars(p.rider), "frequency": 0.0})
    return Parameters(p.bicycle, rider=rider)


def test_matrices_with_a_leaning_rider() -> None:
    data = published("rider_lean.json")
    order = ["lean_angle", "steer_angle", "rider_lean", "lean_rate", "steer_rate", "rider_rate"]
    for entry in data["speeds"]:
        found = state_space.model(leaning_rider(), entry["v"])
        index = [found.states.index(name) for name in order]
        assert np.abs(found.a[np.ix_(index, index)] - entry["A"]).max() < 1e-9
        steer_torque = np.array(entry["B"])[:, 1]
        assert np.abs(found.b[index, 0] - steer_torque).max() < 1e-9


def test_the_model_is_that_of_the_matrices() -> None:
    """Once from the closed form of 2007, once from the nonlinear equations' derivatives."""
    for name in catalogue.names():
        p = catalogue.load(name).parameters
        if p.rider is not None:
            continue
        for speed in (0.5, 3.0, 8.0):
            found = state_space.model(p, speed)
            index = [0, 2, 1, 3]
            expected = linear.state_matrix(p.bicycle, speed)
            scale = np.abs(expected).max()
            assert np.abs(found.a[np.ix_(index, index)] - expected).max() < 1e-11 * scale


CASES = {
    "plain": Parameters(benchmark()),
    "lag": Parameters(benchmark(), motor=Motor(lag=0.03)),
    "delay": Parameters(benchmark(), delay=0.075),
    "part of a step": Parameters(benchmark(), delay=0.0375, motor=Motor(lag=0.02)),
    "damping": Parameters(benchmark(), steering=Steering(damping=0.4)),
    "rider": catalogue.load("browser-leaning-rider").parameters,
    "rider and delay": Parameters(
        benchmark(),
        rider=catalogue.load("browser-leaning-rider").parameters.rider,
        delay=0.03,
        motor=Motor(lag=0.02),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_discrete_model_is_the_jacobian_of_a_step(case: str) -> None:
    plant = WhipplePlant(CASES[case])
    model = plant.linearize(4.0, discrete=True)
    tiny = 1e-5
    fields = ["heading" if name == "heading_error" else name for name in model.states]

    def columns(state: WhippleState) -> np.ndarray:
        rows = []
        for name in fields:
            base, _, age = name.partition("[-")
            if age:
                place = 3 * (int(age[:-1]) - 1) + ("torque", "displacement").index(base)
                rows.append(state.commands[:, place])
            else:
                rows.append(getattr(state, name))
        return np.array(rows)

    count = 2 * (len(fields) + len(model.inputs))
    state = riding(plant, 4.0, count=count)
    inputs = {name: np.zeros(count) for name in ("torque", "displacement")}
    for column, name in enumerate([*fields, *model.inputs]):
        for lane, change in ((2 * column, tiny), (2 * column + 1, -tiny)):
            base, _, age = name.partition("[-")
            if age:
                place = 3 * (int(age[:-1]) - 1) + ("torque", "displacement").index(base)
                state.commands[lane, place] = change
            elif column < len(fields):
                getattr(state, name)[lane] = change
            else:
                inputs[name][lane] = change
    after = columns(plant.step(state, inputs["torque"], inputs["displacement"], np.zeros(count)))
    found = (after[:, ::2] - after[:, 1::2]) / (2.0 * tiny)
    expected = np.hstack([model.a, model.b])
    assert model.time_step == plant.time_step
    assert np.abs(found - expected).max() < 2e-6 * max(1.0, np.abs(expected).max())


def test_models_of_many_are_those_of_each() -> None:
    first, second = (catalogue.load(name).parameters for name in ("browser", "pista"))
    both = Bicycle(
        **{
            name: np.array([vars(first.bicycle)[name], vars(second.bicycle)[name]])
            for name in vars(first.bicycle)
        }
    )
    for discrete in (False, True):
        together = state_space.model(Parameters(both, delay=0.03), 3.0, discrete)
        for index, p in enumerate((first, second)):
            alone = state_space.model(Parameters(p.bicycle, delay=0.03), 3.0, discrete)
            np.testing.assert_allclose(together.a[index], alone.a, rtol=0, atol=1e-11)
            np.testing.assert_allclose(together.b[index], alone.b, rtol=0, atol=1e-11)


def test_exponential_of_a_matrix() -> None:
    angle = 7.3
    turn = state_space.exponential(np.array([[0.0, -angle], [angle, 0.0]]))
    expected = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    np.testing.assert_allclose(turn, expected, rtol=0, atol=1e-14)
