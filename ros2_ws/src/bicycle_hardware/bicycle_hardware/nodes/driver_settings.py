"""Parameters of the driver; no ROS here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bicycle_common.nodes.realtime import priority_parameter
from bicycle_common.parameters import parameter
from bicycle_hardware.driver import DriverConfig
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_sim.task.scenario import SCENARIOS, Scenario, named


@dataclass(frozen=True)
class DriverSettings:
    """ROS parameters of the driver."""

    port: str = parameter(
        "/dev/ttyACM0", "the microcontroller's serial line; it may come and go while it runs"
    )
    baud: int = parameter(
        921600, "bits per s; 115200, 230400, 460800 or 921600; USB ignores it", 115200, 921600
    )
    plant: str = parameter(
        "whipple", "model of the bicycle, for the estimator", choices=registry.with_bicycles()
    )
    bicycle: str = parameter(
        "", "its parameters: a name that bicycle info lists, or a YAML file; empty is benchmark"
    )
    scenario: str = parameter(
        "random-start-random-goal",
        "limits of the commands and goal radius, as the simulator's",
        choices=tuple(SCENARIOS),
    )
    sensors: str = parameter("mpu6050", "what the sensors are like: a preset, or a YAML file")
    valid_ms: int = parameter(
        100, "ms for which a command is obeyed; then the microcontroller's fallback rules", 5, 200
    )
    clock: str = parameter(
        "pc",
        "stamps of readings: the PC's clock by time synchronisation, or the microcontroller's own",
        choices=("pc", "board"),
    )
    pace: str = parameter(
        "realtime",
        "realtime; or lockstep with a simulated board that waits for its answers",
        choices=("realtime", "lockstep"),
    )
    arm_when_ready: bool = parameter(
        False, "arm without bicycle/arm as soon as nothing speaks against it; for simulation only"
    )
    realtime_priority: int = priority_parameter()
    diagnostics_period: float = parameter(1.0, "s", 0.1, 3600.0)

    def make_plant(self) -> Plant[Any]:
        """Return the bicycle.

        Raises:
            ValueError: when there is none of that name.
        """
        return registry.named(self.plant, self.bicycle or None)

    def make_scenario(self) -> Scenario:
        """Return limits and goal radius, suited to the bicycle.

        Raises:
            ValueError: as `make_plant`.
        """
        plant = self.make_plant()
        return named(self.scenario).with_motor(plant.torque_limit).suited(plant.input_names)

    def make_sensors(self) -> SensorSettings:
        """Return the sensors.

        Raises:
            ValueError: when there are none of that name, or on a bad file.
        """
        return sensors.load(self.sensors)

    def make_config(self, plant: Plant[Any]) -> DriverConfig:
        """Return the settings of the logic.

        Raises:
            ValueError: as `make_sensors`.
        """
        return DriverConfig(
            rest=self.make_sensors().rest,
            period=plant.time_step,
            valid_ms=self.valid_ms,
            gear=plant.pedal_gear,
            pc_clock=self.clock == "pc",
            arms_itself=self.arm_when_ready,
        )
