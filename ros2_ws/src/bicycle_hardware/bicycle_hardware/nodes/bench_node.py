"""The simulator with a simulated microcontroller: commands reach its bicycle by a serial line."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_hardware.nodes.bench_node")

import sys
from dataclasses import dataclass
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from std_srvs.srv import SetBool

from bicycle_common.nodes import topics
from bicycle_common.nodes.diagnostics import OK, percentiles, status
from bicycle_common.nodes.realtime import Priority
from bicycle_common.nodes.runner import LOOP_EXECUTOR, UserError, run
from bicycle_common.nodes.topics import serve
from bicycle_common.parameters import describe, parameter
from bicycle_hardware.bench.board_loop import BoardLoop
from bicycle_hardware.bench.board_simulator import BoardSimulator
from bicycle_hardware.simulated_board import SimulatedBoard, build
from bicycle_sim.nodes.sim_node import OUTPUTS, SimNode
from bicycle_sim.nodes.sim_settings import NAME, SimSettings
from bicycle_sim.runtime.loop import Loop

BY_DRIVER = (topics.COMMAND_ECHO, topics.EPISODE)
"""Topics of a bicycle's driver."""
LOOK = 0.001
"""s between two looks whether a period was answered, in lock-step."""


@dataclass(frozen=True)
class BenchSettings(SimSettings):
    """ROS parameters of the simulator, and the serial line's."""

    port: str = parameter(
        "", "path at which the simulated microcontroller's serial line appears; empty only logs it"
    )


class BenchNode(SimNode):
    """One simulated bicycle on a simulated microcontroller."""

    settings_type = BenchSettings
    outputs = tuple(one for one in OUTPUTS if one not in BY_DRIVER)
    sensor_outputs = (topics.GNSS_FIX, topics.GNSS_VELOCITY)
    obeys_topic = False
    _settings: BenchSettings

    def _make_loop(self) -> Loop:
        settings = self._settings
        link = Path(settings.port) if settings.port else None
        try:
            sensors = settings.make_sensors()
            if sensors is None:
                raise ValueError("a microcontroller needs sensors: give sensors:=mpu6050")
            settings.make_start()
            self._board = SimulatedBoard(build(), link)
            self._hurry_board()
            simulator = BoardSimulator(
                settings.make_scenario(),
                settings.make_plant(),
                settings.seed,
                sensors,
                self._board,
            )
            loop = BoardLoop(simulator, settings.make_options())
            loop.on_begin = self._publish_fixes
        except (ValueError, OSError) as error:
            raise UserError(str(error)) from None
        self.get_logger().info(f"the microcontroller's serial line is {link or self._board.path}")
        return loop

    def _hurry_board(self) -> None:
        """Let the board run before the loop's nodes: a real one has a processor of its own."""
        priority = self._settings.loop_priority()
        # Where it is not permitted, the node says so of its own.
        Priority(self._board.pid).take(min(priority + 1, 99) if priority else 0)

    def _publish_readings(self) -> None:
        """Publish nothing with the state: the board's readings come over the serial line."""

    def _publish_fixes(self) -> None:
        """Publish the last period's satellites before the board runs on.

        So whoever answers the next period has them, and a ride in lock-step repeats.
        """
        super()._publish_readings()

    def _listen(self) -> None:
        super()._listen()
        serve(self, topics.STOP_BUTTON, self._on_button)

    def _on_button(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Press the button for emergencies, which is wired to the board, or let it go."""
        simulator = self._loop.simulator
        assert isinstance(simulator, BoardSimulator)
        simulator.stopped = bool(request.data)
        response.success = True
        response.message = f"the button is {'pressed' if request.data else 'released'}"
        return response

    def _start_timers(self) -> None:
        super()._start_timers()
        if self._loop.lockstep:
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.create_timer(LOOK, self._on_due, clock=steady)

    def _statuses(self) -> list[DiagnosticStatus]:
        simulator = self._loop.simulator
        assert isinstance(simulator, BoardSimulator)
        values: dict[str, object] = {
            "held": simulator.held,
            **percentiles(list(simulator.ages), "period to command at the board"),
        }
        mode = simulator.outputs.mode.name.lower()
        return [*super()._statuses(), status(f"{self._who()}: microcontroller", OK, mode, values)]

    def close(self) -> None:
        """Wait until the last state is received; tell the commands' age; switch the board off."""
        super().close()
        simulator = self._loop.simulator
        if isinstance(simulator, BoardSimulator) and simulator.ages:
            ages = percentiles(list(simulator.ages), "age")
            self.get_logger().info(
                f"age of the last {len(simulator.ages)} commands when they reached the board: "
                f"median {ages['age p50 (ms)']:.2f} ms, 99 % {ages['age p99 (ms)']:.2f} ms"
            )
        self._board.close()


def main() -> None:
    """Run the simulator until SIGINT or SIGTERM."""
    usage = (
        "usage: bicycle_bench [--ros-args -p NAME:=VALUE ... --params-file FILE]\n\n"
        "Simulates one bicycle on a simulated microcontroller, for bicycle_driver. Parameters and "
        "their defaults:\n" + describe(BenchSettings)
    )
    sys.exit(run(NAME, BenchNode, usage, executor=LOOP_EXECUTOR))
