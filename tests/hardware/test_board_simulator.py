"""The bicycle on the simulated board, with the driver's core at the other end, without ROS."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from bicycle_common.types import Command
from bicycle_hardware.bench.board_simulator import BoardSimulator
from bicycle_hardware.driver import ControlPeriod, Driver, DriverConfig
from bicycle_hardware.serial_line import SerialLine
from bicycle_hardware.simulated_board import SimulatedBoard, build
from bicycle_sim.plants import registry
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.task.scenario import SCENARIOS

REST = 0.1
"""s."""


class Bench:
    """A bicycle at rest, its board and its driver."""

    def __init__(self) -> None:
        self.board = SimulatedBoard(build())
        self.simulator = BoardSimulator(
            SCENARIOS["fixed-start-fixed-goal"],
            registry.named("whipple", "browser-rider"),
            0,
            replace(sensors.load("mpu6050"), rest=REST),
            self.board,
        )
        self.line = SerialLine(self.board.path)
        self.driver = Driver(self.line, DriverConfig(rest=REST, pc_clock=False))

    def answer(self, every: int = 1) -> int:
        """Answer each step that ended, or each `every`th; return how many."""
        found = self.driver.take(self.line.receive(), time.monotonic())
        steps = [one for one in found if isinstance(one, ControlPeriod) and one.step >= 0]
        return sum(
            self.driver.command(
                Command(one.episode, one.step, 0.0, 0.0, 0.0, None, 0, "me", "lqr")
            )
            for one in steps
            if one.step % every == 0
        )

    def close(self) -> None:
        """End the board."""
        self.line.close()
        self.board.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


@pytest.mark.parametrize("every", [1, 3])
def test_each_command_s_age_at_the_board_is_kept(bench: Bench, every: int) -> None:
    """The board's own clock stands still while a command is under way."""
    begun = time.monotonic()
    sent = 0
    for _ in range(30):
        bench.simulator.step(None)
        time.sleep(0.005)
        sent += bench.answer(every)
    bench.simulator.step(None)
    passed = time.monotonic() - begun
    assert sent > 5
    assert len(bench.simulator.ages) == sent
    assert all(0.005 <= age < passed for age in bench.simulator.ages)


def test_ages_are_kept_in_lock_step_and_over_a_reset(bench: Bench) -> None:
    simulator = bench.simulator
    sent = 0
    for _ in range(2):
        simulator.step(None)
        for _ in range(20):
            sent += bench.answer()
            while not simulator.is_awaited(20, lockstep=True):
                sent += bench.answer()
            simulator.step(None)
        simulator.reset()
    assert sent > 20
    assert len(simulator.ages) == sent
