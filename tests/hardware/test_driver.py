"""The driver's frames and commands, without ROS; then against the simulated board."""

from __future__ import annotations

import math

import pytest

from bicycle_common.types import Command, CommandSource
from bicycle_hardware.driver import ControlPeriod, Driver, DriverConfig, Heard, SensorReading
from bicycle_hardware.frames import (
    Actuators,
    Arm,
    AskTime,
    DriverState,
    Imu,
    Message,
    Mode,
    Period,
    Steer,
    Stop,
    TimeIs,
    Wheel,
)


class Wire:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.sent: list[Message] = []

    def send(self, message: Message) -> int:
        self.sent.append(message)
        return len(self.sent)


def make_driver(**settings: object) -> tuple[Driver, Wire]:
    wire = Wire()
    given: dict[str, object] = {"rest": 0.05, "pc_clock": False, **settings}
    return Driver(wire, DriverConfig(**given)), wire  # type: ignore[arg-type]


def command(step: int, episode: int = 1, torque: float = 1.5) -> Command:
    return Command(episode, step, torque, 0.0, 10.0, None, 0, "me", "lqr")


def beat(number: int, sequence: int = 0, mode: Mode = Mode.RIDING, start: int = 0) -> Period:
    return Period(1_000_000 + 25_000 * (number - start), number, mode, 0.0, 0.0, sequence)


def steps(found: list[Heard]) -> list[tuple[int, int]]:
    return [(one.episode, one.step) for one in found if isinstance(one, ControlPeriod)]


def test_readings_carry_their_own_stamps() -> None:
    driver, _ = make_driver()
    found = driver.take(
        [
            Imu(1_250_000, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
            Steer(1_260_000, 0.1, 0.7),
            Wheel(1_240_000, 3.0),
        ],
        0.0,
    )
    assert found == [
        SensorReading("imu", 1.25, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        SensorReading("steer", 1.26, (0.1, 0.7)),
        SensorReading("wheel", 1.24, (3.0,)),
    ]


def test_steps_are_counted_from_the_end_of_the_rest() -> None:
    driver, wire = make_driver()
    found = driver.take([beat(40 + number) for number in range(5)], 0.0)
    assert steps(found) == [(1, -2), (1, -1), (1, 0), (1, 1), (1, 2)]
    assert sum(isinstance(one, AskTime) for one in wire.sent) == 5
    again = driver.again()
    assert again is not None
    assert (again.step, again.time) == (2, found[-1].time)  # type: ignore[union-attr]


def test_a_command_answers_its_step_once_and_is_echoed() -> None:
    driver, wire = make_driver(valid_ms=80, gear=0.25)
    driver.take([beat(number) for number in range(3)], 0.0)
    assert driver.command(command(0))
    sent = wire.sent[-1]
    assert sent == Actuators(1_050_000, 1.5, 2.5, 80)
    assert not driver.command(command(0))
    assert not driver.command(command(7))
    assert not driver.command(command(1, episode=2))
    assert driver.stale == 3
    sequence = len(wire.sent)
    fresh, held, none, other = (
        one.applied
        for one in driver.take(
            [
                beat(3, sequence),
                beat(4, sequence),
                beat(5, sequence, Mode.FALLBACK),
                beat(6, 9999),
            ],
            0.0,
        )
        if isinstance(one, ControlPeriod)
    )
    assert (fresh.source, fresh.controller) == (CommandSource.FRESH, "me")
    assert (held.source, held.command) == (CommandSource.HELD, fresh.command)
    assert none.source is other.source is CommandSource.ZERO


def test_a_bicycle_that_is_not_armed_was_moved_by_nothing() -> None:
    driver, _ = make_driver()
    found = driver.take([beat(number, mode=Mode.DISARMED) for number in range(8)], 0.0)
    sources = {one.applied.source for one in found if isinstance(one, ControlPeriod)}
    assert sources == {CommandSource.INITIAL}


def test_nothing_is_sent_on_a_silent_controller_s_behalf() -> None:
    driver, wire = make_driver()
    driver.take([beat(number) for number in range(3)], 0.0)
    driver.command(command(0))
    driver.take([beat(number) for number in range(3, 30)], 1.0)
    driver.idle(5.0)
    assert sum(isinstance(one, Actuators) for one in wire.sent) == 1


def test_a_microcontroller_that_begins_anew_begins_an_episode() -> None:
    driver, _ = make_driver()
    first = driver.take([beat(number) for number in range(10)], 0.0)
    second = driver.take([beat(number) for number in range(4)], 1.0)
    assert steps(second) == [(2, -2), (2, -1), (2, 0), (2, 1)]
    times = [one.time for one in [*first, *second] if isinstance(one, ControlPeriod)]
    assert times == sorted(set(times))
    assert not driver.command(command(5))


def test_it_asks_for_the_time_of_a_silent_board_and_keeps_the_pc_s() -> None:
    driver, wire = make_driver(pc_clock=True)
    driver.idle(100.0)
    assert wire.sent == [AskTime(100_000_000_000)]
    driver.take([TimeIs(100_000_000_000, 1_001_000)], 100.002)
    found = driver.take([beat(0)], 100.01)
    assert found[0].time == pytest.approx(100.0)  # type: ignore[union-attr]
    assert driver.round_trip == pytest.approx(0.002)


def test_arming_and_stopping_are_sent_and_only_in_simulation_by_itself() -> None:
    ready = DriverState(0, Mode.DISARMED, 0, 0.0, 0.0, 24.0, 0, 0, 0)
    driver, wire = make_driver()
    driver.take([ready], 0.0)
    assert wire.sent == []
    driver.arm(True)
    driver.stop()
    assert wire.sent == [Arm(1), Stop()]
    driver, wire = make_driver(arms_itself=True)
    driver.take([DriverState(0, Mode.DISARMED, 32, 0.0, 0.0, 24.0, 0, 0, 0)], 0.0)
    assert wire.sent == []
    driver.take([ready], 0.0)
    assert wire.sent == [Arm(1)]


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="make no sense"):
        DriverConfig(rest=math.nan)
