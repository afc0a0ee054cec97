"""Parts bolted to a Whipple bicycle: motor, delay, friction, stop, drive, air, road, rider."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from whipple_maker import benchmark, coast, energy, riding, various

from bicycle_sim.plants.base import Loads
from bicycle_sim.plants.whipple import catalogue, linear, state_space, steady
from bicycle_sim.plants.whipple.parameters import (
    Bicycle,
    Drive,
    Motor,
    Parameters,
    Resistance,
    Road,
    Steering,
)
from bicycle_sim.plants.whipple.plant import WhipplePlant, WhippleState


def plant_with(**parts: Any) -> WhipplePlant:
    """Return the benchmark with something bolted to it."""
    return WhipplePlant(Parameters(benchmark(), **parts))


IDLE = np.zeros(1), np.zeros(1), np.zeros(1)
"""No torque, no displacement, no pedal force, for one bicycle."""


def torques(plant: WhipplePlant, commands: list[float]) -> list[float]:
    """Return the motor's torque after each substep under one command for each control period."""
    state, found = riding(plant, 4.0), []
    zero = np.zeros(1)
    for command in commands:
        trace = plant.trace(state, zero + command, zero, zero)
        found += [float(one.motor_torque[0]) for one in trace]
        state = trace[-1]
    return found


def test_a_perfect_motor_gives_what_is_wanted() -> None:
    assert torques(plant_with(), [3.0, -200.0]) == [3.0] * 10 + [-200.0] * 10


def test_motor_lag_is_first_order() -> None:
    times = 0.0025 * np.arange(1, 21)
    expected = 3.0 * (1.0 - np.exp(-times / 0.03))
    np.testing.assert_allclose(
        torques(plant_with(motor=Motor(lag=0.03)), [3.0, 3.0]), expected, rtol=1e-13
    )


def test_motor_limit_rate_dead_band_and_digits() -> None:
    assert torques(plant_with(motor=Motor(limit=7.0)), [20.0])[-1] == 7.0
    assert torques(plant_with(motor=Motor(dead_band=0.5)), [0.4, 2.0, -2.0])[9::10] == [
        0.0,
        1.5,
        -1.5,
    ]
    stepped = torques(plant_with(motor=Motor(step=0.25)), [0.1, 0.2, -1.3])[9::10]
    assert stepped == [0.0, 0.25, -1.25]
    ramp = torques(plant_with(motor=Motor(rate=100.0)), [3.0, 3.0])
    np.testing.assert_allclose(ramp, np.minimum(0.25 * np.arange(1, 21), 3.0), rtol=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.025, 0.04, 0.06, 0.0625, 0.15])
def test_delay_in_whole_substeps_is_exact(delay: float) -> None:
    found = torques(plant_with(delay=delay), [float(n) for n in range(1, 11)])
    substep = round(delay / 0.0025)
    expected = [0.0] * substep + [float(n) for n in range(1, 11) for _ in range(10)]
    assert found == pytest.approx(expected[:100], abs=1e-9)


def test_delay_within_a_substep_keeps_the_impulse() -> None:
    """The response lies between those for the substep's two ends, by the delay's share of it."""

    def response(delay: float) -> np.ndarray:
        plant = plant_with(delay=delay)
        state = coast(plant, riding(plant, 4.0), 1, torque=np.ones(1))
        state = coast(plant, state, 3)
        return np.array([state.steer_angle[0], state.lean_angle[0]])

    early, between, late = (response(delay) for delay in (0.03, 0.0311, 0.0325))
    share = (0.0311 - 0.03) / 0.0025
    assert np.abs(early / late - 1.0).min() > 0.01
    np.testing.assert_allclose(between, early + share * (late - early), rtol=1e-3)


def test_each_bicycle_has_its_own_delay() -> None:
    delays = np.array([0.0, 0.03, 0.0875, 0.15])
    together = WhipplePlant(Parameters(benchmark(), delay=delays, motor=Motor(lag=0.02)))
    commands = np.random.default_rng(0).normal(size=(12, 1)) * np.ones(4)
    state = riding(together, 4.0, count=4)
    for command in commands:
        state = coast(together, state, 1, torque=command)
    for lane, delay in enumerate(delays):
        alone = WhipplePlant(Parameters(benchmark(), delay=float(delay), motor=Motor(lag=0.02)))
        one = riding(alone, 4.0)
        for command in commands:
            one = coast(alone, one, 1, torque=command[:1])
        assert one.lean_angle[0] == state.lean_angle[lane]
        assert one.motor_torque[0] == state.motor_torque[lane]


def test_friction_holds_the_steering_until_it_is_overcome() -> None:
    plant = plant_with(steering=Steering(friction=0.3, stiction=0.5))
    zero = np.zeros(1)
    state = riding(plant, 4.0)
    state = coast(plant, state, 10, torque=zero + 0.49)
    assert state.steer_angle[0] == 0.0
    assert state.steer_rate[0] == 0.0
    state = coast(plant, state, 1, torque=zero + 0.51)
    assert state.steer_rate[0] > 0.0
    # Once it slides, friction is less than what held it: 0.51 - 0.3 N m accelerate it.
    model = state_space.model(Parameters(benchmark()), 4.0)
    assert state.steer_rate[0] == pytest.approx(0.21 * model.b[3, 0] * 0.025, rel=0.2)


def test_friction_stops_the_steering_at_rest() -> None:
    """It brings a turning steering to rest exactly, never past it, and takes energy."""
    plant = plant_with(steering=Steering(friction=12.0))
    state = riding(plant, 3.0)
    state = replace(state, steer_rate=np.array([0.8]))
    before = energy(plant, plant.pushed(state, 0.0))
    rates = []
    for one in plant.trace(state, *IDLE):
        rates.append(float(one.steer_rate[0]))
        after = energy(plant, one)
        assert after[0] <= before[0] + 1e-9
        before = after
    assert rates[-1] == 0.0
    assert np.all(np.diff(np.abs(rates)) <= 0.0)
    assert min(rates) == 0.0


def test_viscous_friction_takes_its_power() -> None:
    plant = plant_with(steering=Steering(damping=0.5))
    state = riding(plant, 4.6, 0.3)
    lost, begun = 0.0, energy(plant, state)
    for _ in range(40):
        trace = [state, *plant.trace(state, *IDLE)]
        power = [0.5 * float(one.steer_rate[0]) ** 2 for one in trace]
        lost += 0.0025 * (sum(power) - 0.5 * (power[0] + power[-1]))
        state = trace[-1]
    assert lost > 0.01
    assert begun[0] - energy(plant, state)[0] == pytest.approx(lost, rel=1e-4)


def test_the_stop_stops() -> None:
    plant = plant_with(steering=Steering(stop=0.3))
    state = riding(plant, 1.0)
    energies, angles = [], []
    for _ in range(12):
        for one in plant.trace(state, np.array([8.0]), np.zeros(1), np.zeros(1)):
            angles.append(float(one.steer_angle[0]))
            state = one
        energies.append(float(energy(plant, state)[0]))
    assert max(angles) == 0.3
    assert angles[-1] == 0.3
    assert state.steer_rate[0] == 0.0
    # Held by the stop it still falls, and it leaves the stop when it is pulled away.
    assert abs(state.lean_rate[0]) > 0.1
    state = coast(plant, state, 2, torque=np.array([-20.0]))
    assert state.steer_angle[0] < 0.3


def test_gear_power_and_brake() -> None:
    b = benchmark()
    mass = b.mass + b.IRyy / b.rR**2 + b.IFyy / b.rF**2

    def gained(plant: WhipplePlant, speed: float, pedal: float, steps: int = 1) -> float:
        state = coast(plant, riding(plant, speed), steps, pedal_force=np.array([pedal]))
        return float(state.speed[0]) - speed

    assert gained(plant_with(), 4.0, 100.0) == pytest.approx(20.0 / mass * 0.025, rel=1e-12)
    assert gained(plant_with(drive=Drive(gear=1.0)), 4.0, 100.0) == pytest.approx(
        2.5 / mass, rel=1e-9
    )
    weak = plant_with(drive=Drive(power=40.0))
    assert gained(weak, 4.0, 100.0) == pytest.approx(10.0 / mass * 0.025, rel=1e-3)
    assert gained(plant_with(drive=Drive(brake=10.0)), 4.0, -100.0) == pytest.approx(
        -10.0 / mass * 0.025, rel=1e-9
    )
    assert plant_with().step(riding(plant_with(), 4.0), *IDLE).speed[0] == 4.0
    # A brake ends at rest instead of driving backwards.
    stopping = coast(plant_with(), riding(plant_with(), 0.5), 200, pedal_force=np.array([-2000.0]))
    assert 0.0 <= stopping.speed[0] < 1e-3


def test_limits_hold_the_speed() -> None:
    plant = plant_with(resistance=Resistance(drag_area=0.6, rolling=0.006))
    falling = riding(plant_with(), 2.0, 0.6)
    free = coast(plant_with(), falling, 14)
    held = coast(plant_with(), falling, 14, speed_limits=(2.0, 2.0))
    assert free.speed[0] > 2.1
    assert held.speed[0] == pytest.approx(2.0, abs=0.1)
    assert held.speed[0] - 2.0 < 0.75 * (free.speed[0] - 2.0)
    cruising = coast(plant, riding(plant, 5.0), 200, speed_limits=(5.0, 5.0))
    assert cruising.speed[0] == pytest.approx(5.0, abs=0.05)
    inside = coast(plant_with(), riding(plant_with(), 3.0), 4, speed_limits=(1.0, 5.0))
    assert inside.speed[0] == 3.0


def test_air_and_rolling_resistance_slow_it() -> None:
    b = benchmark()
    mass = b.mass + b.IRyy / b.rR**2 + b.IFyy / b.rF**2
    air = Resistance(drag_area=0.5, air_density=1.2, rolling=0.005)
    headwind = Road(wind_y=-2.0)
    state = coast(plant_with(resistance=air, road=headwind), riding(plant_with(), 5.0), 1)
    force = 0.5 * 1.2 * 0.5 * 7.0**2 + 0.005 * b.mass * 9.81
    assert state.speed[0] - 5.0 == pytest.approx(-force / mass * 0.025, rel=1e-3)
    assert state.lean_rate[0] == 0.0


def test_a_hill() -> None:
    b = benchmark()
    mass = b.mass + b.IRyy / b.rR**2 + b.IFyy / b.rF**2
    plant = plant_with(road=Road(grade_y=0.05))
    state = coast(plant, riding(plant, 5.0), 1)
    along = 9.81 * 0.05 / math.sqrt(1.0 + 0.05**2)
    assert state.speed[0] - 5.0 == pytest.approx(-along * b.mass / mass * 0.025, rel=1e-9)
    # Across the hill it falls to the low side: heading +y, the road rises towards +x, the right.
    tilted = plant_with(road=Road(grade_x=0.05))
    assert coast(tilted, riding(tilted, 5.0), 4).lean_angle[0] > 1e-4


def test_the_hill_does_not_know_the_compass() -> None:
    """Ridden along any direction, a hill that rises to the left is the same hill."""
    ends = []
    for heading in (0.0, 1.0, -2.5):
        road = Road(grade_x=-0.05 * math.cos(heading), grade_y=-0.05 * math.sin(heading))
        plant = plant_with(road=road)
        zero = np.zeros(1)
        state = plant.initial(zero, zero, zero + heading, zero + 4.0)
        ends.append(coast(plant, state, 20))
    for end in ends[1:]:
        assert end.lean_angle[0] == pytest.approx(ends[0].lean_angle[0], rel=1e-9)
        assert end.speed[0] == pytest.approx(ends[0].speed[0], rel=1e-12)


def test_a_push_is_a_torque_of_the_linear_bicycle() -> None:
    """Lean and steer acceleration under a force at a point are M^-1 times its partial work."""
    b = benchmark()
    plant = WhipplePlant(Parameters(b, time_step=1e-4, substeps=1))
    loads = Loads(lateral_force=50.0, force_height=1.1, force_forward=0.7, roll_torque=3.0)
    state = coast(plant, riding(plant, 0.0), 1, loads=loads)
    yaw_per_steer = b.c / b.w * math.cos(b.lam)
    torque = [50.0 * 1.1 + 3.0, 50.0 * 0.7 * yaw_per_steer]
    expected = np.linalg.solve(linear.matrices(b).mass, torque)
    assert state.lean_rate[0] / 1e-4 == pytest.approx(expected[0], rel=1e-4)
    assert state.steer_rate[0] / 1e-4 == pytest.approx(expected[1], rel=1e-4)


def test_side_wind_pushes_to_leeward() -> None:
    plant = plant_with(resistance=Resistance(side_area=0.8))
    gust = Loads(wind_x=8.0)
    state = coast(plant, riding(plant, 4.0), 4, loads=gust)
    assert state.lean_rate[0] < 0.0  # towards +x, the right
    assert coast(plant, riding(plant, 4.0), 4).lean_rate[0] == 0.0


def test_the_rider_moves_the_centre_of_mass_by_what_is_wanted() -> None:
    p = catalogue.load("browser-leaning-rider").parameters
    assert p.rider is not None
    plant = WhipplePlant(p)
    state = riding(plant, 6.0)
    for _ in range(30):
        state = plant.step(state, np.zeros(1), np.array([0.02]), np.zeros(1), (6.0, 6.0))
    arm = p.rider.mG * (p.rider.zP - p.rider.zG) / (p.bicycle.mass + p.rider.mG)
    # The bicycle begins to fall meanwhile, which the muscle does not foresee.
    assert arm * math.sin(state.rider_lean[0]) == pytest.approx(0.02, rel=0.15)
    with pytest.raises(ValueError, match="no leaning rider"):
        plant_with().step(riding(plant_with(), 4.0), np.zeros(1), np.array([0.01]), np.zeros(1))
    assert plant.input_names == ("torque", "displacement", "pedal_force")
    assert plant_with().input_names == ("torque", "pedal_force")


WILD: dict[str, Callable[[int], np.ndarray]] = {
    "pulled over": lambda step: np.full(64, 60.0),
    "shaken": lambda step: np.full(64, 500.0 if step % 2 else -500.0),
    "torn": lambda step: np.full(64, 1e6),
}


@pytest.mark.parametrize("how", WILD)
@pytest.mark.parametrize("substeps", [1, 2, 10])
def test_nothing_makes_it_anything_but_a_number(how: str, substeps: int) -> None:
    """It stops for good where it lies or its geometry ends, before any division by zero."""
    p = replace(various(64, 5, rider=True), substeps=substeps, motor=Motor())
    plant = WhipplePlant(p)
    rng = np.random.default_rng(6)
    state = riding(plant, rng.uniform(0.0, 9.0, 64), 3.0 * rng.normal(size=64), 64)
    for step in range(60):
        after = plant.step(state, WILD[how](step), np.zeros(64), np.zeros(64))
        for name, values in vars(after).items():
            assert np.isfinite(values).all(), name
        lay = state.stopped != 0.0
        for name in ("lean_angle", "steer_angle", "rear_x", "heading", "pitch", "speed"):
            assert np.array_equal(getattr(after, name)[lay], getattr(state, name)[lay])
        state = after
    assert (state.stopped != 0.0).mean() > 0.9
    assert plant.fallen(state, math.pi / 6)[state.stopped != 0.0].all()


def test_beyond_88_degrees_of_steering_it_rests() -> None:
    """A front wheel across the bicycle could turn it no more."""
    plant = WhipplePlant(Parameters(benchmark(), steering=Steering(stop=math.radians(85.0))))
    state = riding(plant, 2.0, count=2)
    lean, steer = np.array([1.2, 1.0]), np.radians([80.0, 75.0])
    pitch, r = steady.on_the_road(plant.constants, lean, steer)
    assert r.yaw_lever[0] < 0.0 < plant.constants.turn_limit < r.yaw_lever[1]
    state = replace(state, steer_angle=steer, lean_angle=lean, pitch=pitch)
    after = coast(plant, state, 1)
    assert after.stopped[0] == 1.0
    assert (after.lean_angle[0], after.steer_angle[0]) == (lean[0], steer[0])
    assert after.stopped[1] == 0.0 or after.lean_angle[1] != lean[1]
    assert all(np.isfinite(values).all() for values in vars(after).values())


def test_heading_stays_within_a_turn() -> None:
    plant = plant_with()
    state = riding(plant, 2.0, count=1)
    state = replace(state, heading=np.array([3.1]))
    turned = 0.0
    for _ in range(60):
        after = coast(plant, state, 1, torque=np.array([-0.3 - 40.0 * float(state.lean_rate[0])]))
        change = float(after.heading[0] - state.heading[0])
        turned += (change + math.pi) % (2.0 * math.pi) - math.pi
        assert -math.pi < after.heading[0] <= math.pi
        state = after
    assert abs(turned) > 0.05


def test_position_follows_speed_and_heading() -> None:
    plant = plant_with()
    state = riding(plant, 5.0, 0.4)
    trace = [state]
    for _ in range(20):
        trace += plant.trace(trace[-1], *IDLE)
    for x, y, heading, speed in (("rear_x", "rear_y", "heading", "speed"),):
        path = np.array([[getattr(s, x)[0], getattr(s, y)[0]] for s in trace])
        headings = np.array([getattr(s, heading)[0] for s in trace])
        speeds = np.array([getattr(s, speed)[0] for s in trace])
        velocity = np.stack([-np.sin(headings), np.cos(headings)], 1) * speeds[:, None]
        expected = 0.0025 * (velocity[:-1] + velocity[1:]) / 2.0
        np.testing.assert_allclose(np.diff(path, axis=0), expected, rtol=0, atol=1e-7)
    wheel = np.diff([s.rear_wheel_angle[0] for s in trace])
    assert wheel.sum() * benchmark().rR == pytest.approx(5.0 * 0.5, rel=1e-2)
    apart = [math.hypot(s.front_x[0] - s.rear_x[0], s.front_y[0] - s.rear_y[0]) for s in trace]
    assert apart == pytest.approx([1.02] * len(apart), abs=0.02)


def test_lean_acceleration_is_the_mean_of_the_period() -> None:
    plant = plant_with()
    state = riding(plant, 4.0, 0.2)
    after = coast(plant, state, 1, torque=np.array([1.0]))
    change = float(after.lean_rate[0] - state.lean_rate[0])
    assert after.lean_acceleration[0] == pytest.approx(change / 0.025, rel=1e-12)


def test_mirrored_rides_are_mirror_images() -> None:
    plant = plant_with(motor=Motor(lag=0.02, dead_band=0.1), steering=Steering(friction=0.2))
    commands = np.random.default_rng(2).normal(size=40) * 2.0
    left, right = riding(plant, 4.0, 0.3), riding(plant, 4.0, -0.3)
    for command in commands:
        left = coast(plant, left, 1, torque=np.array([command]))
        right = coast(plant, right, 1, torque=np.array([-command]))
    for name in ("lean_angle", "steer_angle", "heading", "yaw_rate", "rear_x", "motor_torque"):
        assert getattr(left, name)[0] == -getattr(right, name)[0], name
    for name in ("speed", "pitch", "rear_y", "front_wheel_angle"):
        assert getattr(left, name)[0] == getattr(right, name)[0], name


def state_bits(state: WhippleState) -> list[bytes]:
    return [np.ascontiguousarray(values).tobytes() for values in vars(state).values()]


def test_different_bicycles_ride_together_as_they_ride_alone() -> None:
    p = various(13, 7, rider=True)
    plant = WhipplePlant(p)
    rng = np.random.default_rng(8)
    speed, push = rng.uniform(2.0, 6.0, 13), 0.3 * rng.normal(size=13)
    torque, moved = rng.normal(size=(10, 13)), 0.02 * rng.normal(size=(10, 13))
    together = riding(plant, speed, push, 13)
    for step in range(10):
        together = coast(plant, together, 1, torque=torque[step], displacement=moved[step])
    for lane in range(13):
        keep = np.arange(13) == lane
        alone_plant = plant.take(keep)
        alone = riding(alone_plant, speed[keep], push[keep], 1)
        for step in range(10):
            alone = coast(
                alone_plant, alone, 1, torque=torque[step][keep], displacement=moved[step][keep]
            )
        for name, values in vars(alone).items():
            if name != "commands":  # as long as the longest delay that is still there
                assert values[0] == getattr(together, name)[lane], name
    with pytest.raises(ValueError, match="13 bicycles"):
        plant.step(riding(alone_plant, 4.0), *IDLE)


def test_parameters_refuse_what_no_bicycle_has() -> None:
    good = vars(benchmark())
    for name, value, words in (
        ("mB", 0.0, "mB must be above zero kg, not 0"),
        ("zB", 0.9, "zB must be below zero m"),
        ("lam", 1.3, "lam must lie between"),
        ("w", math.nan, "w must be finite, not nan"),
        ("IBxz", 40.0, "the square of IBxz"),
        ("rR", 0.0, "IRyy must be zero where rR is"),
        ("c", "long", "c must be a number, not 'long'"),
        ("mH", np.array([4.0, -1.0]), "mH must be above zero kg, not -1"),
    ):
        with pytest.raises(ValueError, match=words):
            Bicycle(**{**good, name: value})
    with pytest.raises(ValueError, match="substeps must be a whole number"):
        Parameters(benchmark(), substeps=2.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="delay must be at most"):
        Parameters(benchmark(), delay=3.0)
    with pytest.raises(ValueError, match="give one number or N"):
        _ = Parameters(
            Bicycle(**{**good, "w": np.array([1.0, 1.1])}), delay=np.array([0.0, 0.1, 0.2])
        ).count
