"""Sensors: that they measure what the motion is, that errors are of the size asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.reading import FIELDS, Reading
from bicycle_sim.sensors.suite import GRAVITY, SensorSuite

PERIOD = 0.025


def ride(
    preset: str, count: int = 3, seconds: float = 2.0, seed: int = 5, **changed: Any
) -> tuple[list[Reading], list[Any], SensorSuite]:
    """Readings of a ride with a push, and the true states at the control periods' ends."""
    plant = registry.named("whipple", "browser-rider")
    zero = np.zeros(count)
    state = plant.initial(zero, zero, zero, np.full(count, 6.0))
    found = sensors.load(preset)
    data = found.to_dict()
    for name, values in changed.items():
        data[name] = {**data[name], **values} if isinstance(values, dict) else values
    suite = SensorSuite(sensors.from_dict(data), plant, count, seed)
    readings = suite.rest(state)
    state = plant.pushed(state, 0.3)
    suite.begin(state)
    states = []
    for _ in range(round(seconds / PERIOD)):
        trace = plant.trace(state, zero, zero, zero)
        readings += suite.advance(trace, PERIOD)
        state = trace[-1]
        states.append(state)
    return readings, states, suite


def of(readings: list[Reading], sensor: str) -> list[Reading]:
    return [reading for reading in readings if reading.sensor == sensor]


def test_perfect_sensors_measure_the_motion() -> None:
    readings, states, _ = ride("perfect")
    at = {round(reading.stamp * 1000): reading for reading in of(readings, "imu")}
    steer = {round(reading.stamp * 1000): reading for reading in of(readings, "steer")}
    wheel = {round(reading.stamp * 1000): reading for reading in of(readings, "wheel")}
    for index, state in enumerate(states):
        key = round((index + 1) * PERIOD * 1000)
        gyro = at[key].values[:, :3]
        assert np.allclose(gyro[:, 0], -state.lean_rate, atol=3e-3)
        assert np.allclose(gyro[:, 2], state.yaw_rate * np.cos(state.lean_angle), atol=3e-3)
        assert np.allclose(steer[key].values[:, 0], state.steer_angle)
        assert np.allclose(wheel[key].values[:, 0], state.speed)


def test_accelerometer_feels_gravity_at_rest_and_the_turn_while_riding() -> None:
    readings, states, _ = ride("perfect", seconds=4.0, rest=1.0)
    force = np.array([reading.values[0, 3:] for reading in of(readings, "imu")])
    assert np.allclose(force[:200], (0.0, 0.0, GRAVITY))
    # Differences of the velocity of the frame's point, against its place, differenced twice.
    state = states[-1]
    lean, turn = state.lean_angle[0], state.yaw_rate[0]
    expected = state.speed[0] * turn * np.cos(lean) - GRAVITY * np.sin(lean)
    assert force[-1, 1] == pytest.approx(expected, abs=0.6)
    assert abs(force[:, 1]).max() < 3.0


def test_seed_gives_the_same_readings_and_another_seed_others() -> None:
    first, again, other = (ride("mpu6050-rtk", seed=seed)[0] for seed in (1, 1, 2))
    assert len(first) == len(again)
    for one, two in zip(first, again, strict=True):
        assert one.stamp == two.stamp
        assert np.array_equal(one.values, two.values)
        assert np.array_equal(one.arrival, two.arrival)
        assert np.array_equal(one.lost, two.lost)
    assert not np.array_equal(first[0].values, other[0].values)


def test_one_sensors_settings_change_no_others_noise() -> None:
    plain, changed = ride("mpu6050")[0], ride("mpu6050", wheel={"rate": 20.0, "ticks": 32.0})[0]
    for one, two in zip(of(plain, "imu"), of(changed, "imu"), strict=True):
        assert np.array_equal(one.values, two.values)


def test_bicycles_have_errors_of_their_own() -> None:
    readings, _, suite = ride("mpu6050", count=2000, seconds=0.025)
    still = np.array([reading.values for reading in of(readings, "imu") if reading.stamp < 5.0])
    bias = still.mean(axis=0)
    assert np.std(bias[:, 0]) == pytest.approx(0.05, rel=0.1)
    assert still[:, :, 0].std(axis=0).mean() == pytest.approx(1.5e-3, rel=0.1)
    assert still[:, :, 3].std(axis=0).mean() == pytest.approx(0.026, rel=0.1)
    assert suite.count == 2000


def test_rate_latency_jitter_and_dropouts() -> None:
    changed = {"rate": 200.0, "latency": 0.02, "jitter": 0.004, "dropout": 0.1}
    readings = of(ride("mpu6050", count=500, imu=changed)[0], "imu")
    stamps = np.array([reading.stamp for reading in readings])
    assert np.allclose(np.diff(stamps), 0.005)
    late = np.array([reading.arrival - reading.stamp for reading in readings])
    assert late.min() >= 0.02
    assert late.mean() == pytest.approx(0.02 + 0.004 * np.sqrt(2 / np.pi), rel=0.02)
    assert np.mean([reading.lost.mean() for reading in readings]) == pytest.approx(0.1, rel=0.1)


def test_stuck_and_gone_sensors() -> None:
    readings, _, _ = ride("mpu6050", imu={"stuck_from": 6.0}, wheel={"gone_from": 6.0})
    held = [r.values for r in of(readings, "imu") if r.stamp >= 6.0]
    assert len(held) > 50
    assert all(np.array_equal(values, held[0]) for values in held)
    assert all(r.lost.all() == (r.stamp >= 6.0) for r in of(readings, "wheel") if r.stamp >= 6.0)


def test_wheel_counts_ticks_and_is_late_by_half_its_window() -> None:
    readings, _, _ = ride("mpu6050", wheel={"average": 0.5, "ticks": 32.0})
    tick = 2 * np.pi * 0.34095886 / 32 / 0.5
    speeds = np.array([reading.values[0, 0] for reading in of(readings, "wheel")])
    assert np.allclose(speeds / tick, np.rint(speeds / tick), atol=1e-6)
    assert speeds[-20:].mean() == pytest.approx(6.0, abs=0.15)
    assert np.all(speeds[:240] == 0.0)


def test_mounting_turns_the_readings() -> None:
    level, turned = (
        of(ride("perfect", rest=0.5, seconds=0.025, imu={"mounting": angles})[0], "imu")[5]
        for angles in ((0.0, 0.0, 0.0), (90.0, 0.0, 0.0))
    )
    assert np.allclose(level.values[0, 3:], (0.0, 0.0, GRAVITY))
    assert np.allclose(turned.values[0, 3:], (0.0, GRAVITY, 0.0))


def test_gnss_measures_the_antennas_place() -> None:
    readings, states, _ = ride("perfect", seconds=1.0)
    last, state = of(readings, "gnss")[-1], states[-1]
    ahead = np.array([-np.sin(state.heading[0]), np.cos(state.heading[0])])
    place = np.array([state.rear_x[0], state.rear_y[0]])
    assert np.allclose(last.values[0, :2], place + 0.3 * ahead, atol=0.1)
    assert np.hypot(*last.values[0, 2:]) == pytest.approx(6.0, abs=0.1)


def test_every_preset_loads_and_goes_back_and_forth() -> None:
    for name in sensors.names():
        found = sensors.load(name)
        assert sensors.from_dict(found.to_dict()) == found
        assert found.about
    assert set(FIELDS) == {"imu", "steer", "wheel", "gnss"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("imu: {rat: 5}", "no field 'rat' (did you mean 'rate'?)"),
        ("imu: {rate: -5}", "rate must be zero or more"),
        ("imu: {rate: fast}", "rate must be a number"),
        ("imu: 5", "must be a mapping"),
        ("imu: {rate: [1, 2]}", "rate must be a number"),
        ("imu: {position: 3}", "position must be a list of 3 numbers"),
        ("imu: {position: [1, 2]}", "position must be a list of 3 numbers"),
        ("imu: {mounting: [0, 0, 0, 0]}", "mounting must be a list of 3 numbers"),
        ("imu: {mounting: [0, .nan, 0]}", "mounting must be finite"),
        ("imu: {mounting: [0, true, 0]}", "mounting must be a number"),
        ("imu: {gyro_range: 0}", "gyro_range must be above zero"),
        ("gnss: {latitude: 95}", "latitude must lie within -89.0 and 89.0"),
        ("steer: {dropout: 1.0}", "dropout must be below 1"),
        ("- 5", "must be a mapping"),
        ("rest: 900", "rest must be 0 to 60 s"),
        ("imu: {", "no YAML"),
    ],
)
def test_bad_files_are_told_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match="mine") as error:
        sensors.load(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="did you mean 'mpu6050'"):
        sensors.load("mpu605")
