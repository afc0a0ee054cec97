"""Each row of the errata table (`docs/errata.md`) that can be tested, by its number; here 1 to 22.

Rows 23 to 40 are in test_errata_task.py.

Elsewhere, as they concern networks and training:

- 27, 28, 30: tests/controller/test_networks.py.
- 28 to 31, 35, 36: tests/controller/test_config.py, the presets `paper` and `authors`;
  31 also tests/controller/test_exploration_noise.py;
  25 and 36 also tests/controller/test_collector.py.

Nothing to test: 32, 33 (misprints in formulas that every DDPG has right), 37, 38 (the paper's
prose). Row 10's brackets are part of row 8's test.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from state_maker import riding

from bicycle_common import geometry
from bicycle_sim.plants.choi import dynamics
from bicycle_sim.plants.choi.dynamics import State
from bicycle_sim.plants.choi.linear import continuous, eigenvalues
from bicycle_sim.plants.choi.parameters import Constants, Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS, named
from bicycle_sim.task.task import BicycleTask

FAITHFUL, CORRECTED = Physics(), Physics.named("corrected")
K = Constants()
TEN_KM_H = 10.0 / 3.6


def step(
    state: State,
    torque: float = 0.0,
    displacement: float = 0.0,
    force: float = 0.0,
    physics: Physics = FAITHFUL,
) -> State:
    one = np.ones_like(state.speed)
    return dynamics.step(state, torque * one, displacement * one, force * one, physics)


def steered(angle: float, heading: float, seconds: float, physics: Physics) -> tuple[State, float]:
    """Return an upright bicycle after its steering was held, and the angle of its turn (rad)."""
    state, zero, turn = riding(heading=heading), np.zeros(1), 0.0
    for _ in range(round(seconds / K.time_step)):
        held = {"steer_angle": zero + angle, "steer_rate": zero}
        before = replace(state, lean_angle=zero, lean_rate=zero, **held)
        state = step(before, physics=physics)
        turn += geometry.wrap_angle(state.heading - before.heading).item()
    return state, turn


def test_row_01_the_front_radius_is_the_larger() -> None:
    front, rear, _ = dynamics.curvatures(np.array([0.5]), K)
    assert 1.0 / front == pytest.approx(1.11 / math.sin(0.5))
    assert 1.0 / rear == pytest.approx(1.11 / math.tan(0.5))
    assert front < rear  # The front contact runs on the larger circle.


@pytest.mark.parametrize(
    ("heading", "along", "yaw"),
    [
        (0.0, (0.0, 1.0), math.pi / 2),
        (math.pi / 2, (-1.0, 0.0), math.pi),
        (math.pi, (0.0, -1.0), -math.pi / 2),
        (-math.pi / 2, (1.0, 0.0), 0.0),
    ],
)
def test_row_02_heading_is_from_y_counter_clockwise(
    heading: float, along: tuple[float, float], yaw: float
) -> None:
    end = step(riding(heading=heading))
    travel = TEN_KM_H * K.time_step
    assert (end.rear_x.item(), end.rear_y.item()) == pytest.approx(
        (travel * along[0], travel * along[1]), abs=1e-12
    )
    assert geometry.heading_to_yaw(np.array([heading])).item() == pytest.approx(yaw)
    assert geometry.yaw_to_heading(np.array([yaw])).item() == pytest.approx(heading)


def test_row_03_heading_follows_from_the_contacts() -> None:
    end, _ = steered(0.3, 0.2, 1.0, FAITHFUL)
    assert end.heading.item() > 0.5
    line = math.atan2((end.rear_x - end.front_x).item(), (end.front_y - end.rear_y).item())
    assert end.heading.item() == line


def test_row_04_rear_contact_restores_the_wheelbase() -> None:
    straight = riding(front_y=K.wheelbase + 0.02)
    end = step(straight)
    assert (end.front_y - end.rear_y).item() == pytest.approx(K.wheelbase, abs=1e-12)
    # The front contact went its way, the rear made up for it.
    assert end.front_y.item() == pytest.approx(K.wheelbase + 0.02 + TEN_KM_H * K.time_step)
    tolerated = riding(front_y=K.wheelbase + 0.009)
    end = step(tolerated)
    assert (end.front_y - end.rear_y).item() == pytest.approx(K.wheelbase + 0.009)


def test_row_05_the_table_s_measured_turns() -> None:
    for heading, faithful in ((-1.5, 2.457), (0.3, 2.408)):
        assert steered(0.5, heading, 2.0, FAITHFUL)[1] == pytest.approx(faithful, abs=5e-4)
        assert steered(0.5, heading, 2.0, CORRECTED)[1] == pytest.approx(2.408, abs=5e-4)


def test_row_06_old_radii_and_new_steering() -> None:
    # From theta = 0 the half chord is zero, the direction of the front contact the new theta's.
    end = step(riding(heading=0.3, steer_rate=2.0))
    theta = end.steer_angle.item()
    assert theta == pytest.approx(0.05)
    start, travel = riding(heading=0.3), TEN_KM_H * K.time_step
    moved = (end.front_x - start.front_x).item(), (end.front_y - start.front_y).item()
    assert moved == pytest.approx(
        (-travel * math.sin(0.3 + theta), travel * math.cos(0.3 + theta))
    )


def test_row_07_theta_of_zero_is_finite_and_as_the_large_constant() -> None:
    zero = dynamics.curvatures(np.zeros(1), K)
    np.testing.assert_array_equal(zero, np.zeros((3, 1)))
    near = dynamics.curvatures(np.array([1e-12]), K)
    assert np.isfinite(near).all()
    np.testing.assert_allclose(near, 0.0, atol=1e-11)


def lean_torque(**values: float) -> float:
    """Return the bracket of equation 5 plus gravity, N m, of a bicycle with such a state."""
    state = replace(riding(), **{name: np.array([value]) for name, value in values.items()})
    turn = dynamics.curvatures(state.steer_angle, K)
    found = dynamics.lean_equation(state, np.zeros(1), state.speed, turn, K)
    return found.item() * K.lean_inertia


def test_row_08_and_10_gyroscopic_torque_has_the_wheel_rate() -> None:
    spin = 1.7 * 0.34**2 * (TEN_KM_H / 0.34)
    assert spin / (1.7 * 0.34**2) == pytest.approx(8.17, abs=5e-3)
    assert lean_torque(steer_rate=1.0) == pytest.approx(-spin)
    # cos(phi) stands before the whole bracket.
    gravity = 75.0 * 0.94 * 9.82 * math.sin(0.4)
    leaning = lean_torque(steer_rate=1.0, lean_angle=0.4)
    assert leaning == pytest.approx(gravity - math.cos(0.4) * spin)


def test_row_09_and_11_centrifugal_torque_has_mass_times_height() -> None:
    theta = 0.2
    radii = 1.11 / math.sin(theta), 1.11 / math.tan(theta)
    r_cm = math.sqrt((1.11 - 0.66) ** 2 + 1.11**2 / math.tan(theta) ** 2)
    turning = 1.7 * 0.34 / radii[0] + 1.7 * 0.34 / radii[1] + 75.0 * 0.94 / r_cm
    assert K.mass == 75.0
    assert lean_torque(steer_angle=theta) == pytest.approx(-(TEN_KM_H**2) * turning)
    assert lean_torque(steer_angle=-theta) == pytest.approx(TEN_KM_H**2 * turning)


def test_row_12_tyre_inertias() -> None:
    assert K.tyre_spin_inertia == pytest.approx(1.7 * 0.34**2)
    assert K.tyre_lean_inertia == pytest.approx(1.5 * 1.7 * 0.34**2)
    assert K.tyre_steer_inertia == pytest.approx(0.5 * 1.7 * 0.34**2)


def test_row_13_sign_and_inertia_of_the_gyroscopic_steering() -> None:
    state = riding(lean_rate=1.0)
    wheel = TEN_KM_H / 0.34
    found = [
        dynamics.steer_equation(state, np.zeros(1), state.speed, physics).item()
        for physics in (FAITHFUL, Physics(gyroscopic_correction=True))
    ]
    assert found[0] == pytest.approx(-3.0 * wheel)  # -I_dv / I_dl: away from the fall.
    assert found[1] == pytest.approx(2.0 * wheel)  # +I_dc / I_dl: into the fall.


@pytest.mark.parametrize(
    ("speed", "pole"), [(1.0, 2.49), (2.0, 3.63), (TEN_KM_H, 4.71), (4.0, 6.52), (5.0, 8.04)]
)
def test_row_13_unstable_pole_grows_with_speed(speed: float, pole: float) -> None:
    poles = eigenvalues(speed, FAITHFUL)
    assert poles[0].real == pytest.approx(pole, abs=5e-3)
    assert poles[0].imag == 0.0
    assert poles[1] == pytest.approx(0.0, abs=1e-12)  # Steering has no restoring moment.
    assert (poles[2:].real < 0).all()


def test_row_13_unstable_pair_when_corrected() -> None:
    poles = eigenvalues(TEN_KM_H, CORRECTED)
    assert poles[0].real == pytest.approx(2.09, abs=5e-3)
    assert abs(poles[0].imag) == pytest.approx(2.94, abs=5e-3)
    assert poles[1] == np.conj(poles[0])
    speeds = np.linspace(0.5, 15.0, 30)
    assert all(eigenvalues(speed, CORRECTED)[0].real > 0 for speed in speeds)


@pytest.mark.parametrize(
    ("speed", "tilt", "small", "large", "kick"),
    [
        (1.0, 18, 1.2, 12, 33),
        (2.0, 34, 1.2, 12, 43),
        (TEN_KM_H, 38, 1.2, 12, 38),
        (4.0, 42, 1.2, 12, 29),
        (5.0, 43, 1.2, 12, 25),
    ],
)
def test_row_13_what_can_be_recovered(
    speed: float, tilt: float, small: float, large: float, kick: float
) -> None:
    # An input of size u holds the unstable mode w'x while |w'x| < |w'b| u / pole.
    a, b = continuous(speed, FAITHFUL)
    values, vectors = np.linalg.eig(a[:4, :4].T)
    index = int(np.argmax(values.real))
    mode, pole = vectors[:, index].real, values[index].real
    by_torque, by_displacement = np.abs(mode @ b[:4]) / pole
    assert math.degrees(2.0 * by_torque / abs(mode[0])) == pytest.approx(tilt, abs=0.5)
    assert math.degrees(2.0 * by_torque / abs(mode[1])) == pytest.approx(kick, abs=0.5)
    assert math.degrees(0.02 * by_displacement / abs(mode[0])) == pytest.approx(small, abs=0.05)
    assert math.degrees(0.20 * by_displacement / abs(mode[0])) == pytest.approx(large, abs=0.5)


def test_row_14_inertia_as_printed() -> None:
    assert K.lean_inertia == pytest.approx(149.69, abs=5e-3)
    frame, rider = 0.94 - 60 * 0.3 / 75, 0.94 + 15 * 0.3 / 75
    assert (frame, rider) == pytest.approx((0.70, 1.00))
    point_masses = 15 * frame**2 + 60 * rider**2
    assert K.lean_inertia / point_masses == pytest.approx(2.2, abs=0.05)


def test_row_15_displacement_tilts_by_atan_of_d_over_h() -> None:
    upright = riding()
    turn = dynamics.curvatures(upright.steer_angle, K)
    moved = dynamics.lean_equation(upright, np.array([0.2]), upright.speed, turn, K)
    leaning = riding(lean_angle=math.atan(0.2 / 0.94))
    still = dynamics.lean_equation(leaning, np.zeros(1), leaning.speed, turn, K)
    assert moved.item() == pytest.approx(still.item(), rel=1e-12)


def test_row_16_pedal_gain() -> None:
    assert (K.pedal_crank, K.chain_wheel, K.sprocket, K.drive_wheel) == (0.136, 0.068, 0.034, 0.34)
    assert K.pedal_gain == pytest.approx(0.2)


def test_row_17_driven_mass() -> None:
    assert K.driven_mass == pytest.approx(76.7)
    acceleration = (step(riding(), force=100.0).speed.item() - TEN_KM_H) / K.time_step
    assert acceleration == pytest.approx(0.26, abs=1e-3)
    assert 1.0 / acceleration == pytest.approx(3.8, abs=0.05)  # s from 2 to 1 m/s


def test_row_18_speed_first_and_clamped_only_by_option() -> None:
    # The step that accelerates already travels at the new speed.
    end = step(riding(speed=2.0), force=100.0)
    assert end.rear_y.item() == pytest.approx(end.speed.item() * K.time_step)
    slow = np.array([0.001])
    force = np.array([-100.0])
    assert dynamics.accelerate(slow, force, K).item() < 0.0
    assert dynamics.accelerate(slow, force, K, (1.0, 5.0)).item() == 1.0
    assert dynamics.accelerate(np.array([4.9999]), -force, K, (1.0, 5.0)).item() == 5.0
    learned, turning = named("learned-speed"), named("learning-to-turn")
    assert (learned.start_speed, turning.start_speed) == (2.0, 2.5)
    assert learned.speed_limits == turning.speed_limits == (1.0, 5.0)


def test_row_19_time_step() -> None:
    assert K.time_step == 0.025
    quick = Physics(constants=Constants(time_step=0.01))
    end = step(riding(), physics=quick)
    assert end.rear_y.item() == pytest.approx(TEN_KM_H * 0.01)


def test_row_20_limits_by_scenario() -> None:
    assert {s.torque_limit for s in SCENARIOS.values()} == {2.0}
    assert named("random-start-random-goal").action_limits.tolist() == [2.0, 0.2, 0.0]
    assert named("learned-speed").action_limits.tolist() == [2.0, 0.02, 100.0]
    free = BicycleTask(named("learned-speed"), rng=np.random.default_rng(1))
    asked = BicycleTask(named("learned-speed"), rng=np.random.default_rng(1))
    free.step(np.array([[9.0, -1.0, 1e4]]))
    asked.step(np.array([[2.0, -0.02, 100.0]]))
    np.testing.assert_array_equal(free.observation(), asked.observation())


def test_row_21_noise_on_the_displacement_is_an_option() -> None:
    def acceleration(noise: float) -> np.ndarray:
        physics = Physics(displacement_noise=noise)
        scenario = named("random-start-random-goal")
        task = BicycleTask(scenario, ChoiPlant(physics), 500, np.random.default_rng(2))
        return task.step(np.zeros((500, 3))).observation[:, 4]

    assert not acceleration(0.0).any()
    noisy = acceleration(0.02)
    largest = (
        K.mass * K.mass_height * K.gravity * math.sin(math.atan(0.02 / 0.94)) / K.lean_inertia
    )
    assert np.abs(noisy).max() <= largest
    assert np.abs(noisy).max() > 0.95 * largest
    assert noisy.min() < 0.0 < noisy.max()


def test_row_22_steering_stops_at_80_degrees() -> None:
    assert math.degrees(K.steer_stop) == pytest.approx(80.0, abs=5e-3)
    start = riding(steer_angle=1.39, steer_rate=5.0)
    faithful, corrected = step(start, torque=1.0), step(start, torque=1.0, physics=CORRECTED)
    assert faithful.steer_angle.item() == corrected.steer_angle.item() == K.steer_stop
    assert faithful.steer_rate.item() > 5.0  # It is kept, and grows.
    assert corrected.steer_rate.item() == 0.0
    away = step(replace(corrected, lean_rate=np.zeros(1)), torque=-1.0, physics=CORRECTED)
    assert away.steer_angle.item() < K.steer_stop
