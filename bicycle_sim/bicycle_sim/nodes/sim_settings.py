"""Parameters of the simulator and what is built from them; no ROS here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from bicycle_common import steer_into_lean
from bicycle_common.geometry import yaw_to_heading
from bicycle_common.nodes.realtime import priority_parameter
from bicycle_common.parameters import parameter
from bicycle_common.types import FARTHEST_START, FASTEST_START, InitialPose
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.runtime.loop import ON_TIMEOUT, LoopOptions
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.task.scenario import SCENARIOS, Scenario, named

NAME = "bicycle_sim"
"""Name of the simulator's node."""


@dataclass(frozen=True)
class SimSettings:
    """ROS parameters of the simulator."""

    pace: str = parameter(
        "realtime",
        "realtime steps by the clock, lockstep when the answer to the last state arrives",
        choices=("realtime", "lockstep"),
    )
    real_time_factor: float = parameter(
        1.0, "simulated seconds in a second, in real time", 0.01, 100.0
    )
    realtime_priority: int = priority_parameter()
    scenario: str = parameter(
        "random-start-random-goal",
        "limits, start speed and goal radius of the paper's experiment",
        choices=tuple(SCENARIOS),
    )
    plant: str = parameter(
        "choi",
        "the paper's bicycle, the Whipple-Carvallo model of a real one, or the latter in MuJoCo",
        choices=tuple(registry.PLANTS),
    )
    bicycle: str = parameter(
        "",
        "of whipple or mujoco: a name that bicycle info lists, or a YAML file; empty is benchmark",
    )
    sensors: str = parameter(
        "", "what measures the bicycle: a preset such as mpu6050, or a YAML file; empty is none"
    )
    physics: str = parameter(
        "faithful",
        "of plant choi: as the paper's authors ran it, or with all corrections",
        choices=("faithful", "corrected"),
    )
    chord_follows_steering: bool = parameter(
        False, "true switches this correction on in faithful physics (errata row 5)"
    )
    gyroscopic_correction: bool = parameter(
        False, "true switches this correction on in faithful physics (errata row 13)"
    )
    stop_absorbs_steering: bool = parameter(
        False, "true switches this correction on in faithful physics (errata row 22)"
    )
    displacement_noise: float = parameter(
        0.0, "m, half width of uniform noise on the rider's displacement", 0.0, 0.2
    )
    seed: int = parameter(1, "of the first episode; each next one adds 1", 0, 2**62)
    random_start: bool = parameter(False, "draw starts from the scenario, not start_x, y, yaw")
    start_x: float = parameter(0.0, "m, rear contact", -FARTHEST_START, FARTHEST_START)
    start_y: float = parameter(0.0, "m, rear contact", -FARTHEST_START, FARTHEST_START)
    start_yaw: float = parameter(0.0, "rad, counter-clockwise from +x", -1000.0, 1000.0)
    start_speed: float = parameter(-1.0, "m/s; negative takes the scenario's", -1.0, FASTEST_START)
    reset_after_fall: float = parameter(
        0.0,
        "s by the clock until a fallen bicycle is reset; 0 waits for a reset",
        0.0,
        3600.0,
        live=True,
    )
    watchdog_timeout: float = parameter(
        0.25,
        "simulated s that a command may be held before on_timeout; 0 is for ever",
        0.0,
        3600.0,
    )
    on_timeout: str = parameter(
        "zero",
        "ride on with zero input or steering into the lean, or hold the bicycle until the next "
        "command",
        choices=ON_TIMEOUT,
    )
    steer_into_lean_gain: float = parameter(
        steer_into_lean.GAIN,
        "N m per rad/s of lean rate and m/s below 6 m/s, of on_timeout steer_into_lean",
        0.01,
        1000.0,
    )
    marker_rate: float = parameter(
        20.0,
        "Hz, markers for RViz and Foxglove; 0 is none",
        0.0,
        100.0,
        live=True,
    )
    tf_rate: float = parameter(20.0, "Hz, transforms on /tf; 0 is none", 0.0, 100.0, live=True)
    publish_clock: bool = parameter(
        True, "publish /clock; false for all but one bicycle of a fleet"
    )
    diagnostics_period: float = parameter(1.0, "s", 0.1, 3600.0)

    def make_plant(self) -> Plant[Any]:
        """The bicycle.

        Raises:
            ValueError: when there is none of that name, or on an option that it has not.
        """
        names = (
            "chord_follows_steering",
            "gyroscopic_correction",
            "stop_absorbs_steering",
            "displacement_noise",
        )
        options = {name: getattr(self, name) for name in names}
        return registry.named(self.plant, self.bicycle or None, self.physics, **options)

    def make_sensors(self) -> SensorSettings | None:
        """The sensors; None where there are none.

        Raises:
            ValueError: when there are none of that name, or on a bad file.
        """
        return sensors.load(self.sensors) if self.sensors else None

    def make_scenario(self) -> Scenario:
        """Return the paper's experiment of the configured name, with the bicycle's motor.

        Raises:
            ValueError: as `make_plant`.
        """
        steers = self.on_timeout == "steer_into_lean"
        return replace(
            named(self.scenario).with_motor(self.make_plant().torque_limit),
            silence_gain=self.steer_into_lean_gain if steers else 0.0,
        )

    def make_options(self) -> LoopOptions:
        """Return pace and watchdog."""
        return LoopOptions(
            self.pace, self.real_time_factor, self.watchdog_timeout, self.on_timeout
        )

    def make_start(self) -> InitialPose | None:
        """Return the start of an episode without a requested pose; None draws one."""
        if self.random_start:
            return None
        heading = float(yaw_to_heading(self.start_yaw))
        return InitialPose(
            self.start_x, self.start_y, heading, self.speed_or_default(self.start_speed)
        )

    def loop_priority(self) -> int:
        """Return the loop's real-time priority; none if the loop may occupy a whole processor."""
        paced = self.pace == "realtime" and self.real_time_factor <= 1.0
        return self.realtime_priority if paced else 0

    def speed_or_default(self, speed: float) -> float:
        """Return the speed, or the scenario's start speed for a negative one; m/s."""
        return named(self.scenario).start_speed if speed < 0 else speed
