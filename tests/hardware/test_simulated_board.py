"""The firmware's core as a process: arming, riding, and all that may go wrong on the wire."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from board_rig import Rig

from bicycle_common import native_library
from bicycle_hardware.frames import (
    Actuators,
    Arm,
    AskTime,
    Imu,
    Mode,
    Period,
    RefusalReason,
    Steer,
    TimeIs,
    Wheel,
    encode,
    words,
)
from bicycle_hardware.simulated_board import BoardHeard, build


@pytest.fixture(scope="module")
def program() -> Path:
    return build()


@pytest.fixture
def rig(program: Path) -> Iterator[Rig]:
    rig = Rig(program)
    yield rig
    rig.close()


def test_nothing_moves_before_arming(rig: Rig) -> None:
    for _ in range(150):
        rig.command(torque=5.0, drive=100.0)
        out = rig.tick()
        assert (out.torque, out.drive, out.mode) == (0.0, 0.0, Mode.DISARMED)
    rig.line.send(Arm(1))
    rig.command(torque=5.0, drive=100.0)
    out = rig.tick()
    assert (out.torque, out.drive, out.mode) == (5.0, 100.0, Mode.RIDING)


def mode(rig: Rig) -> Mode:
    return rig.outputs.mode


def _refused(rig: Rig) -> RefusalReason:
    rig.line.send(Arm(1))
    out = rig.tick()
    assert out.mode is Mode.DISARMED
    assert out.torque == out.drive == 0.0
    return RefusalReason(out.reasons)


def test_arming_is_refused_while_the_gyro_turns(rig: Rig) -> None:
    rig.frozen = ("imu",)
    for index in range(150):
        rig.inputs.imu_us = rig.now_us
        rig.inputs.gyro = (0.2 * math.sin(index), 0.0, 0.0)
        rig.command()
        rig.tick()
    rig.inputs.imu_us = rig.now_us
    rig.inputs.gyro = (0.2, 0.0, 0.0)
    rig.tick()
    rig.inputs.imu_us = rig.now_us
    rig.inputs.gyro = (-0.2, 0.0, 0.0)
    assert RefusalReason.MOVES in _refused(rig)


def test_arming_is_refused_uncalibrated(rig: Rig) -> None:
    rig.tick(50)
    assert RefusalReason.UNCALIBRATED in _refused(rig)


@pytest.mark.parametrize(
    ("sensor", "reason"),
    [
        ("imu", RefusalReason.NO_IMU),
        ("steer", RefusalReason.NO_STEER),
        ("wheel", RefusalReason.NO_WHEEL),
    ],
)
def test_arming_is_refused_with_old_readings(rig: Rig, sensor: str, reason: RefusalReason) -> None:
    for index in range(160):
        if index == 120:
            rig.frozen = (sensor,)
        rig.command()
        rig.tick()
    assert _refused(rig) == reason


def test_arming_is_refused_with_an_imu_that_repeats_itself(rig: Rig) -> None:
    for index in range(160):
        if index == 120:
            rig.frozen = ("imu",)
        if index >= 120:
            rig.inputs.imu_us = rig.now_us  # it still comes
        rig.command()
        rig.tick()
    assert _refused(rig) == RefusalReason.NO_IMU
    rig.frozen = ()
    rig.command()
    rig.tick(2)
    rig.line.send(Arm(1))
    assert rig.tick().mode is Mode.RIDING


def test_arming_is_refused_when_the_stop_is_pressed_at_that_moment(rig: Rig) -> None:
    for _ in range(120):
        rig.command()
        rig.tick()
    rig.inputs.stopped = True
    assert _refused(rig) == RefusalReason.STOPPED


def test_arming_is_refused_without_a_second_of_commands(rig: Rig) -> None:
    rig.tick(150)
    assert _refused(rig) == RefusalReason.NO_COMMANDS
    for _ in range(80):
        rig.command()
        rig.tick()
    assert _refused(rig) == RefusalReason.NO_COMMANDS
    # The same frame again and again does not advance the sequence.
    frame = encode(Actuators(0, 0.0, 0.0, 100), 77)
    for _ in range(150):
        os.write(rig.line.file, frame)
        rig.tick()
    assert _refused(rig) == RefusalReason.NO_COMMANDS


def test_arming_is_refused_while_rolling(rig: Rig) -> None:
    for _ in range(120):
        rig.command()
        rig.tick()
    rig.frozen = ("wheel",)
    rig.inputs.wheel = 1.5
    rig.inputs.wheel_us = rig.now_us
    rig.command()
    rig.tick()
    assert RefusalReason.TOO_FAST in _refused(rig)


def test_arming_is_refused_while_the_stop_is_pressed(rig: Rig) -> None:
    for _ in range(120):
        rig.command()
        rig.tick()
    rig.inputs.stopped = True
    rig.tick()
    assert _refused(rig) == RefusalReason.STOPPED
    rig.inputs.stopped = False
    rig.command()
    rig.tick()
    rig.line.send(Arm(1))
    assert rig.tick().mode in (Mode.ARMED, Mode.RIDING)


def test_every_reason_has_words() -> None:
    assert len(RefusalReason) == 8
    assert all(words(reason) for reason in RefusalReason)
    assert words(0) == ""


def test_stop_ends_the_drive_within_20_ms_and_keeps_the_bicycle_upright(rig: Rig) -> None:
    rig.arm()
    rig.place(3.0)
    rig.ride(2.0)
    rig.command(drive=100.0)
    assert rig.tick().drive == 100.0
    rig.inputs.stopped = True
    rig.command(drive=100.0)
    out = rig.tick()  # one period of 10 ms
    assert (out.drive, out.mode) == (0.0, Mode.ESTOP)
    assert rig.ride(5.0) < math.radians(20.0)
    assert rig.outputs.drive == 0.0
    # Released, it does not ride on by itself.
    rig.inputs.stopped = False
    rig.steer()
    assert rig.tick().mode is Mode.ESTOP


@pytest.mark.parametrize("speed", [1.5, 2.5, 4.0])
def test_pc_is_lost_and_the_bicycle_stays_upright(rig: Rig, speed: float) -> None:
    rig.arm()
    rig.place(speed)
    rig.state = rig.plant.pushed(rig.state, 0.05)
    assert rig.ride(2.0) < math.radians(15.0)
    assert mode(rig) == Mode.RIDING
    largest = rig.ride(10.0, pc=False)
    assert mode(rig) == Mode.FALLBACK
    assert largest < math.radians(20.0)
    # Commands again: it obeys them again.
    assert rig.ride(1.0) < math.radians(20.0)
    assert mode(rig) == Mode.RIDING


def test_an_armed_bicycle_that_is_left_at_rest_is_disarmed(rig: Rig) -> None:
    rig.arm()
    rig.tick(30)
    assert mode(rig) is Mode.FALLBACK
    rig.tick(460)
    assert mode(rig) is Mode.FALLBACK
    rig.tick(40)
    assert mode(rig) is Mode.DISARMED
    assert rig.outputs.torque == 0.0


def test_command_is_valid_for_its_time_only(rig: Rig) -> None:
    rig.arm()
    rig.command(torque=1.0, valid_ms=50)
    modes = [rig.tick().mode for _ in range(10)]
    assert modes[:5] == [Mode.RIDING] * 5
    assert set(modes[7:]) == {Mode.FALLBACK}
    rig.command(torque=1.0, valid_ms=60000)
    modes = [rig.tick().mode for _ in range(40)]
    assert modes[25] is Mode.FALLBACK  # the board's own longest time is 200 ms


@pytest.mark.parametrize("late", [0.05, 0.08, 0.11, 0.2, 1.0])
@pytest.mark.parametrize("speed", [2.0, 4.0])
def test_a_pc_that_always_answers_late_is_no_worse_than_the_fallback(
    rig: Rig, late: float, speed: float
) -> None:
    rig.arm()
    rig.place(speed)
    rig.state = rig.plant.pushed(rig.state, 0.1)
    waiting: list[tuple[int, float]] = []
    largest, obeyed = 0.0, 0
    for tick in range(1000):
        if tick % 2 == 0:
            waiting.append((rig.now_us, rig.answer()))
        while waiting and rig.now_us - waiting[0][0] >= 1e6 * late:
            rig.command(waiting[0][1], stamp=waiting[0][0])
            del waiting[0]
        rig.tick()
        obeyed += mode(rig) == Mode.RIDING
        largest = max(largest, abs(float(rig.state.lean_angle[0])))
    assert largest < math.radians(20.0)
    assert (obeyed > 20) == (late < 0.1)


@pytest.mark.parametrize("used", [5, 400, 1500])
def test_a_pc_that_begins_anew_is_obeyed_at_once(rig: Rig, used: int) -> None:
    rig.arm()
    rig.line.sequence = used
    rig.command(torque=1.0)
    assert rig.tick().mode is Mode.RIDING
    rig.tick(30)
    assert mode(rig) is Mode.FALLBACK
    rig.line.sequence = 0  # counts from the start, as after a cable was put back
    rig.command(torque=2.0)
    assert (rig.tick().mode, rig.outputs.torque) == (Mode.RIDING, 2.0)


def test_a_repeated_frame_is_not_obeyed_while_commands_come(rig: Rig) -> None:
    rig.arm()
    old = encode(Actuators(rig.now_us, -5.0, 0.0, 200), 200)
    rig.line.sequence = 1999
    rig.command(torque=1.0)
    rig.tick()
    for _ in range(3):
        os.write(rig.line.file, old)  # far behind, and the board's clock says still valid
        assert (rig.tick().mode, rig.outputs.torque) == (Mode.RIDING, 1.0)


def test_an_old_command_stays_old_when_the_clock_wraps(rig: Rig) -> None:
    rig.arm()
    rig.command(torque=3.0, drive=90.0)
    rig.tick()
    assert rig.outputs.drive == 90.0
    for _ in range(30):  # handled now and then, so that it is not disarmed at rest
        rig.inputs.wheel = 1.0
        rig.frozen = ("wheel",)
        rig.tick()
    assert mode(rig) is Mode.FALLBACK
    stamp = rig.now_us
    while rig.now_us - stamp < 2**32 + 100_000:
        rig.now_us += 40_000_000 if rig.now_us - stamp < 2**32 - 50_000_000 else 10_000
        if 2**32 - 50_000_000 <= rig.now_us - stamp < 2**32 - 600_000:
            rig.now_us = stamp + 2**32 - 600_000
        out = rig.tick()
        assert (out.mode, out.drive) == (Mode.FALLBACK, 0.0)


@pytest.mark.parametrize("rate", [-2.0, 2.0])
def test_the_fallback_forgets_a_steer_rate_whose_encoder_is_gone(rig: Rig, rate: float) -> None:
    rig.arm()
    rig.frozen = ("steer", "imu", "wheel")
    for index in range(40):
        rig.inputs.imu_us = rig.inputs.wheel_us = rig.now_us
        rig.inputs.gyro = (1e-4 * (index % 2), 0.0, 0.0)
        rig.inputs.wheel = 2.0
        if index < 20:  # it turns, then nothing comes any more
            rig.inputs.steer_us = rig.now_us
            rig.inputs.steer = 0.01 * rate * index
        rig.tick()
        if index == 19:
            assert rig.outputs.torque == pytest.approx(-1.5 * rate, abs=0.5)
    assert mode(rig) is Mode.FALLBACK
    assert rig.outputs.torque == pytest.approx(0.0, abs=0.5)  # the gyro's bias is left


def test_bytes_lost_flipped_and_delayed_are_no_worse_than_the_fallback(rig: Rig) -> None:
    rig.arm()
    rig.place(3.0)
    rng = np.random.default_rng(4)
    late: list[bytes] = []
    sequence = 1000
    for index in range(800):
        if index % 2 == 0:
            s = rig.state
            o = (s.steer_angle, s.steer_rate, s.lean_angle, s.lean_rate)
            seen = np.array([*o, s.lean_acceleration, s.heading]).T
            torque = float(rig.controller.act(seen, s.speed)[0, 0])
            sequence += 1
            frame = bytearray(encode(Actuators(rig.now_us, torque, 0.0, 100), sequence))
            luck = rng.random()
            if luck < 0.2:
                del frame[rng.integers(len(frame))]
            elif luck < 0.4:
                frame[rng.integers(len(frame))] ^= 1 << rng.integers(8)
            elif luck < 0.5:
                late.append(bytes(frame))
                frame = bytearray()
            os.write(rig.line.file, bytes(frame))
            if late and rng.random() < 0.1:
                os.write(rig.line.file, late.pop(0))
        out = rig.tick()
        assert abs(out.torque) <= 7.0
        assert abs(float(rig.state.lean_angle[0])) < math.radians(20.0)
    assert rig.driver is not None
    assert rig.driver.bad_frames > 50


def test_noise_on_the_line_moves_nothing(rig: Rig) -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        os.write(rig.line.file, rng.integers(0, 256, 300, dtype=np.uint8).tobytes())
        out = rig.tick()
        assert (out.torque, out.drive, out.mode) == (0.0, 0.0, Mode.DISARMED)


def test_not_a_number_is_no_command(rig: Rig) -> None:
    rig.arm()
    rig.command(torque=math.nan, valid_ms=200)
    rig.tick(3)
    assert rig.outputs.torque == rig.outputs.torque
    rig.command(torque=1e30, drive=-1e30)
    assert rig.tick().torque == 7.0


def test_readings_state_and_time_are_sent(rig: Rig) -> None:
    rig.line.send(AskTime(123456789012345))
    rig.tick(100)
    kinds = [type(message).__name__ for message in rig.heard]
    # A reading is sent once, when it has come.
    assert 95 <= kinds.count("Imu") <= 100
    assert 95 <= kinds.count("Steer") <= 100
    assert 45 <= kinds.count("Wheel") <= 51
    stamps = [message.stamp_us for message in rig.heard if isinstance(message, Imu)]
    assert stamps == sorted(set(stamps))
    assert 18 <= kinds.count("DriverState") <= 21
    answer = next(message for message in rig.heard if isinstance(message, TimeIs))
    assert answer.pc == 123456789012345
    imu = [message for message in rig.heard if isinstance(message, Imu)]
    assert np.mean([message.force_z for message in imu]) == pytest.approx(9.8, abs=0.3)
    assert any(isinstance(message, Steer | Wheel) for message in rig.heard)
    beats = [message for message in rig.heard if isinstance(message, Period)]
    assert [beat.number for beat in beats] == list(range(40))
    assert {b.stamp_us - a.stamp_us for a, b in pairwise(beats)} == {20_000, 30_000}
    assert rig.line.splitter.bad == rig.line.splitter.missing == 0


def heard(rig: Rig) -> BoardHeard:
    return rig.board.wait(1, 2**32 - 1, 0)


def beats(rig: Rig, count: int) -> list[int]:
    """Tick until periods ended; return their stamps."""
    before = len(rig.heard)
    while True:
        rig.tick()
        found = [one.stamp_us for one in rig.heard[before:] if isinstance(one, Period)]
        if len(found) == count:
            return found


def test_the_age_of_each_command_is_that_of_the_period_that_it_answers(rig: Rig) -> None:
    begun = time.monotonic_ns()
    stamps = beats(rig, 2)
    time.sleep(0.02)
    rig.command(stamp=stamps[0])
    rig.command(stamp=stamps[1])
    told = heard(rig)
    passed = (time.monotonic_ns() - begun) / 1000
    assert told.stamp_us == stamps[1]
    first, second = told.ages_us
    assert 20_000 <= second < first <= passed
    assert heard(rig).ages_us == ()  # told once


def test_a_command_is_as_old_as_it_was_when_it_came(rig: Rig) -> None:
    """The next tick, which takes it, is made by a simulator and may come much later."""
    for _ in range(100):
        begun = time.monotonic_ns()
        rig.command(stamp=beats(rig, 1)[0])
        time.sleep(0.2)
        asked = (time.monotonic_ns() - begun) / 1000
        if heard(rig).ages_us[-1] < asked - 150_000:
            return
    raise AssertionError("every command was as old as the question for it")


def test_only_commands_that_are_taken_have_an_age(rig: Rig) -> None:
    stamp = beats(rig, 1)[0]
    rig.command(stamp=stamp - 1)  # no period has it
    os.write(rig.line.file, encode(Actuators(stamp, math.nan, 0.0, 100), 500))
    os.write(rig.line.file, encode(Actuators(stamp, 0.0, 0.0, 100), 501)[1:])
    assert heard(rig).ages_us == ()
    os.write(rig.line.file, 2 * encode(Actuators(stamp, 0.0, 0.0, 100), 502))
    assert len(heard(rig).ages_us) == 1
    # Another start has other periods.
    rig.board.restart()
    os.write(rig.line.file, encode(Actuators(stamp, 0.0, 0.0, 100), 503))
    assert heard(rig) == BoardHeard(stamp, 0, ())


def test_a_flood_between_two_ticks_is_taken_and_the_first_ages_are_told(rig: Rig) -> None:
    stamp = beats(rig, 1)[0]
    for _ in range(150):
        rig.command(torque=1.0, stamp=stamp)
        time.sleep(0.001)  # so that each comes alone
    told = heard(rig)
    assert (told.stamp_us, len(told.ages_us)) == (stamp, 64)
    assert list(told.ages_us) == sorted(told.ages_us)
    rig.tick(6)
    assert rig.driver is not None
    assert (rig.driver.sequence, rig.driver.bad_frames) == (rig.line.sequence, 0)


def test_it_is_compiled_once_and_says_what_it_needs(
    program: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(native_library, "C_COMPILERS", ())
    assert build() == program
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(OSError, match="needs a C compiler: apt install gcc"):
        build()
