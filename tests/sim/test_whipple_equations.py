"""The nonlinear Whipple bicycle against a published state and against laws of mechanics."""

from __future__ import annotations

import numpy as np
import pytest
from whipple_maker import benchmark, coast, energy, published, riding, various

from bicycle_sim.plants.whipple import catalogue, linear, steady
from bicycle_sim.plants.whipple.constants import constants
from bicycle_sim.plants.whipple.equations import Forces, motion
from bicycle_sim.plants.whipple.kinematics import Pose, front_contact, front_height, rolling
from bicycle_sim.plants.whipple.parameters import Parameters, Road
from bicycle_sim.plants.whipple.plant import WhipplePlant
from bicycle_sim.plants.whipple.trigonometry import decay, sine_cosine, sine_cosine_of_turn

SHIPPED = Parameters(benchmark()).substeps


def test_lengths_of_the_published_bicycle() -> None:
    expected = published("nonlinear_benchmark.json")["moore_constants"]
    k = constants(Parameters(benchmark()))
    found = (k.axis_forward, k.axis_down, k.fork_offset, k.rear_mass, k.front_mass)
    masses = [expected[f"m_{end}_frame"] + expected[f"m_{end}_wheel"] for end in ("rear", "front")]
    assert found == pytest.approx([*(expected[f"d{n}"] for n in (1, 2, 3)), *masses], rel=1e-14)
    assert k.rear_x == pytest.approx(85.0 * expected["l1"], rel=1e-13)
    assert k.front_z == pytest.approx(4.0 * expected["l4"], rel=1e-13)


def test_accelerations_of_the_published_state() -> None:
    """Basu-Mandal et al. 2007, their signs: angles to the right, wheels turn by -y."""
    data, b = published("nonlinear_benchmark.json"), benchmark()
    k = constants(Parameters(b))
    _, _, _, lean, pitch, _, steer, _ = data["q"]
    _, _, yaw_rate, lean_rate, pitch_rate, rear_spin, steer_rate, front_spin = data["u"]
    _, _, yaw_up, lean_up, pitch_up, rear_up, steer_up, front_up = data["udot"]
    found, r = steady.on_the_road(k, lean, steer)
    assert found + b.lam == pytest.approx(pitch, abs=1e-12)
    assert abs(front_height(k, r)) < 1e-15
    speed = -b.rR * (pitch_rate + rear_spin)
    m = motion(k, Pose(lean, found, steer, lean_rate, steer_rate, speed), Forces(), r)
    assert m.yaw_rate == pytest.approx(yaw_rate, abs=1e-12)
    assert m.pitch_rate == pytest.approx(pitch_rate, abs=1e-12)
    assert -m.front_spin / b.rF == pytest.approx(front_spin, abs=1e-12)
    assert m.lean == pytest.approx(lean_up, rel=1e-12)
    assert m.steer == pytest.approx(steer_up, rel=1e-12)
    assert -m.speed / b.rR == pytest.approx(rear_up + pitch_up, rel=1e-12)
    # Yaw, pitch and front wheel's accelerations, from rates a moment later and before.
    step = 1e-5
    ends = []
    for sign in (-step, step):
        later = Pose(
            lean + sign * lean_rate + 0.5 * sign**2 * lean_up,
            0.0,
            steer + sign * steer_rate + 0.5 * sign**2 * steer_up,
            lean_rate + sign * lean_up,
            steer_rate + sign * steer_up,
            speed + sign * m.speed,
        )
        there, r = steady.on_the_road(k, later.lean, later.steer)
        ends.append(motion(k, later._replace(pitch=there), Forces(), r))
    rates = [(one.yaw_rate, one.pitch_rate, -one.front_spin / b.rF) for one in ends]
    ups = (np.array(rates[1]) - np.array(rates[0])) / (2.0 * step)
    assert ups == pytest.approx([yaw_up, pitch_up, front_up], rel=1e-6)


def test_wheel_loads_of_the_published_bicycle() -> None:
    g, expected = (
        WhipplePlant(Parameters(benchmark())).geometry,
        published("nonlinear_benchmark.json")["static_normal_force_N"],
    )
    front = 9.81 * g.mass * g.mass_forward / g.wheelbase
    assert front == pytest.approx(expected["front"], rel=1e-12)
    assert 9.81 * g.mass - front == pytest.approx(expected["rear"], rel=1e-12)


@pytest.mark.slow
def test_energy_and_the_front_wheel_for_ten_seconds() -> None:
    """Steps of 1 ms after a push at a self-stable speed; lean becomes speed (4.6 to 4.62)."""
    plant = WhipplePlant(Parameters(benchmark(), substeps=25))
    state = riding(plant, 4.6, 0.5)
    begun, drift, height = energy(plant, state), 0.0, 0.0
    for _ in range(400):
        state = coast(plant, state, 1)
        drift = max(drift, abs(float(energy(plant, state)[0] / begun[0]) - 1.0))
        r = rolling(plant.constants, state.lean_angle, state.pitch, state.steer_angle)
        height = max(height, abs(float(front_height(plant.constants, r)[0])))
    assert drift < 1e-12
    assert height < 1e-10
    assert state.speed[0] == pytest.approx(4.62246, abs=1e-4)


def test_energy_of_falling_turning_bicycles_on_a_slope() -> None:
    """Large lean and steering, road rising and tilted: what is lost in height is speed."""
    p = various(40, 3, plain=True)
    rng = np.random.default_rng(4)
    road = Road(*(0.1 * rng.normal(size=(2, 40))))
    plant = WhipplePlant(Parameters(p.bicycle, road=road, substeps=50))
    zero = np.zeros(40)
    state = plant.initial(zero, zero, rng.uniform(-3.0, 3.0, 40), rng.uniform(2.0, 8.0, 40))
    state = plant.pushed(state, rng.normal(size=40))
    begun, turned = energy(plant, state), zero
    for _ in range(16):
        state = coast(plant, state, 1)
        turned = np.maximum(turned, np.abs(state.steer_angle))
    # The stop takes energy, and a bicycle that lies does not move.
    moving = (state.stopped == 0.0) & (turned < 0.99 * p.steering.stop)
    assert moving.sum() > 30
    assert np.abs(state.lean_angle[moving]).max() > 0.5
    np.testing.assert_allclose(energy(plant, state)[moving], begun[moving], rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("name", catalogue.names())
def test_the_shipped_setting_is_exact_enough(name: str) -> None:
    """Below 3e-9 rad after 1 s against steps of 0.25 ms, at 1 to 8 m/s, pushed by 0.1 rad/s."""
    p = catalogue.load(name).parameters
    speeds = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0])
    if name == "two-mass-skate":
        speeds = speeds[3:6]  # its castering root is at -100/s at 10 m/s, of no real bicycle
    ends = []
    for substeps in (SHIPPED, 100):
        plant = WhipplePlant(Parameters(p.bicycle, rider=p.rider, substeps=substeps))
        ends.append(coast(plant, riding(plant, speeds, 0.1, len(speeds)), 40))
    for field in ("lean_angle", "steer_angle"):
        error = np.abs(getattr(ends[0], field) - getattr(ends[1], field))
        assert error.max() < 3e-9, (field, error)


def test_steady_turns_last() -> None:
    plant = WhipplePlant(Parameters(benchmark()))
    steer = np.array([0.05, 0.2, 0.6, -0.3, -0.9])
    speed = np.array([6.0, 3.0, 2.0, 4.0, 1.5])
    turn = steady.turn(plant.constants, steer, speed)
    state = riding(plant, speed, count=5)
    state.lean_angle, state.pitch, state.steer_angle = turn.lean, turn.pitch, steer
    begun = plant.pushed(state, 0.0)
    assert np.sign(begun.yaw_rate) == pytest.approx(np.sign(steer))
    after = coast(plant, begun, 40, torque=turn.steer_torque)
    for name in ("lean_angle", "steer_angle", "speed", "yaw_rate", "pitch"):
        np.testing.assert_allclose(getattr(after, name), getattr(begun, name), rtol=0, atol=1e-12)
    # Both contacts ride on circles about one centre.
    radius = speed / turn.yaw_rate
    for x, y in (("rear_x", "rear_y"), ("front_x", "front_y")):
        one = np.hypot(getattr(begun, x) + radius, getattr(begun, y))
        other = np.hypot(getattr(after, x) + radius, getattr(after, y))
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_wide_turns_are_those_of_the_linear_bicycle() -> None:
    """Lean per steering from K; no steer torque at the capsize speed (Meijaard et al. 2007)."""
    b, small = benchmark(), 1e-4
    k, m = constants(Parameters(b)), linear.matrices(b)
    speed = np.array([2.0, 4.0, 6.0])
    stiffness = 9.81 * m.weight[0, 1] + speed**2 * m.centrifugal[0, 1]
    expected = -stiffness / (9.81 * m.weight[0, 0]) * small
    turn = steady.turn(k, np.full(3, small), speed)
    np.testing.assert_allclose(turn.lean, expected, rtol=1e-6)
    (capsize,) = linear.critical_speeds(b).capsize
    near = steady.turn(k, np.full(3, small), capsize + np.array([-0.01, 0.0, 0.01])).steer_torque
    assert abs(near[1]) < 1e-4 * abs(near[0])
    assert near[0] * near[2] < 0.0


def test_hands_free_circles() -> None:
    """Circles without steer torque (Basu-Mandal et al. 2007): the bicycle stays on them."""
    plant = WhipplePlant(Parameters(benchmark()))
    for steer in (0.02, 0.05, 0.1):
        low, high = 5.0, 7.0
        for _ in range(6):
            speeds = np.linspace(low, high, 401)
            torque = steady.turn(plant.constants, np.full(401, steer), speeds).steer_torque
            index = int(np.argmax(torque >= 0.0))
            low, high = speeds[index - 1], speeds[index]
        turn = steady.turn(plant.constants, np.array([steer]), np.array([low]))
        assert 5.0 < low < 7.0
        state = riding(plant, low)
        state.lean_angle, state.pitch, state.steer_angle = turn.lean, turn.pitch, np.array([steer])
        after = coast(plant, state, 40)
        assert after.lean_angle[0] == pytest.approx(turn.lean[0], abs=1e-9)
        assert after.steer_angle[0] == pytest.approx(steer, abs=1e-9)


def test_front_contact_by_plain_geometry() -> None:
    """The lowest point of a circle in three dimensions, found by rotation matrices."""
    b = benchmark()
    k = constants(Parameters(b))

    def turned(axis: int, angle: float) -> np.ndarray:
        matrix = np.eye(3)
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        matrix[i, i] = matrix[j, j] = np.cos(angle)
        matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
        return matrix

    for lean, steer in ((0.3, 0.5), (-0.4, 0.9), (0.1, -1.2)):
        pitch, r = steady.on_the_road(k, lean, steer)
        frame = turned(0, lean) @ turned(1, pitch + b.lam)
        front = frame @ turned(2, steer)
        rear_centre = turned(0, lean) @ np.array([0.0, 0.0, -b.rR])
        axis = frame @ np.array([k.axis_forward, 0.0, k.axis_down])
        centre = rear_centre + axis + front @ np.array([k.fork_offset, 0.0, 0.0])
        around = np.linspace(0.0, 2.0 * np.pi, 200_001)
        rim = np.array([np.cos(around), 0.0 * around, np.sin(around)]) * b.rF
        points = centre[:, None] + front @ rim
        lowest = points[:, np.argmax(points[2])]
        assert lowest[2] == pytest.approx(0.0, abs=1e-9)
        assert front_contact(k, r) == pytest.approx(lowest[:2], abs=2e-5)


def test_own_functions_are_those_of_the_library() -> None:
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 100_001)
    sine, cosine = sine_cosine(angle)
    assert np.abs(sine - np.sin(angle)).max() < 5e-16
    assert np.abs(cosine - np.cos(angle)).max() < 5e-16
    sine, cosine = sine_cosine_of_turn(2.0 * angle)
    assert np.abs(sine - np.sin(2.0 * angle)).max() < 2e-15
    assert np.abs(cosine - np.cos(2.0 * angle)).max() < 2e-15
    for exponent in (0.0, 1e-9, 0.3, 0.6, 5.0, 40.0, 1000.0, 1e9):
        assert decay(exponent) == pytest.approx(np.exp(-exponent), rel=1e-13, abs=1e-300)
