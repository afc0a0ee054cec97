"""Parameters of the controller; no ROS here."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from bicycle_common import steer_into_lean
from bicycle_common.geometry import yaw_to_heading
from bicycle_common.nodes.realtime import priority_parameter
from bicycle_common.parameters import parameter
from bicycle_common.ros_names import LONGEST_NAME, NAMESPACE
from bicycle_common.validation import one_line, require
from bicycle_controller.control.controller import Controller
from bicycle_controller.control.exploration_noise import Noise, NoiseConfig
from bicycle_controller.control.followers import FOLLOWERS
from bicycle_controller.control.guidance import AFTER, GuidanceConfig
from bicycle_controller.control.lean_steering import SteerIntoLean
from bicycle_controller.control.safety import Safety, SafetyConfig
from bicycle_controller.control.twist_ride import TwistLimits
from bicycle_controller.policy.policy import DEFAULT_POLICY, LQR
from bicycle_sim.plants.base import Plant
from bicycle_sim.sensors import settings as sensors
from bicycle_sim.sensors.settings import SensorSettings

SAFE = SafetyConfig()
"""Defaults of the safety layer."""


@dataclass(frozen=True)
class ControllerSettings:
    """ROS parameters of the controller."""

    policy: str = parameter(
        DEFAULT_POLICY,
        "what rides: a policy file or an ONNX file, a shipped policy's name, a Python class as "
        f"module:Class, the name of an installed one, or one of {', '.join(LQR)}",
        fixed="the service bicycle/load_policy switches the policy",
    )
    state: str = parameter(
        "truth",
        "the simulator's truth, or what an estimator makes of the sensors",
        choices=("truth", "estimated"),
    )
    sensors: str = parameter(
        "mpu6050", "of state estimated: the sensors' preset or YAML file, the simulator's own"
    )
    start_x: float = parameter(0.0, "m, of state estimated: where the ride begins", -1e4, 1e4)
    start_y: float = parameter(0.0, "m, the same", -1e4, 1e4)
    start_yaw: float = parameter(0.0, "rad from +x, the same", -1000.0, 1000.0)
    fallback: str = parameter(
        "lqr",
        "what rides where the policy may not: the LQR that uses what the simulator allows, "
        "steering into the lean without a goal, or zero input",
        choices=("lqr", "steer_into_lean", "zero"),
    )
    steer_into_lean_gain: float = parameter(
        steer_into_lean.GAIN,
        "N m per rad/s of lean rate and m/s below 6 m/s, of fallback steer_into_lean",
        0.01,
        1000.0,
    )
    safety: str = parameter(
        "ride",
        "outside the envelope the fallback drives, and rides on to the goal; or straight on and "
        "slowly until a new goal comes; or no layer",
        choices=("ride", "stop", "none"),
    )
    safety_envelope: float = parameter(
        SAFE.envelope,
        "share of the extrapolated lean from which the fallback can still save",
        0.1,
        10.0,
    )
    safety_lean: float = parameter(SAFE.lean, "rad, largest lean left to the policy", 0.01, 1.6)
    safety_lean_rate: float = parameter(
        SAFE.lean_rate, "rad/s, largest lean rate left to it", 0.01, 100.0
    )
    safety_slowest: float = parameter(SAFE.slowest, "m/s, lowest speed left to it", 0.01, 100.0)
    safety_fastest: float = parameter(SAFE.fastest, "m/s, highest speed left to it", 0.01, 100.0)
    safety_stale: int = parameter(
        int(SAFE.oldest),
        "steps that the command which led to a state may be late by",
        1,
        1_000_000,
    )
    safety_hold: float = parameter(
        SAFE.hold,
        "simulated s that the fallback drives at least; doubled if needed again",
        0.025,
        60.0,
    )
    safety_torque_rate: float = parameter(SAFE.rates[0], "N m/s, largest change of T", 0.1, 1e6)
    safety_displacement_rate: float = parameter(
        SAFE.rates[1], "m/s, largest change of d", 0.001, 1e6
    )
    safety_pedal_rate: float = parameter(SAFE.rates[2], "N/s, largest change of F", 0.1, 1e6)
    exploration: str = parameter(
        "none", "noise on the actions, to record data with", choices=("none", "ou", "gaussian")
    )
    exploration_sigma: float = parameter(
        0.1, "size of that noise, as a share of the action limits", 0.0, 10.0
    )
    exploration_theta: float = parameter(0.15, "pull of ou towards zero per step", 0.0, 1.0)
    seed: int = parameter(1, "of the exploration noise", 0, 2**62)
    goal_radius: float = parameter(
        0.0,
        "m within which a goal is reached; 0 takes the simulator's",
        0.0,
        100.0,
        live=True,
    )
    goal_timeout: float = parameter(
        300.0,
        "simulated s after which a goal is given up; 0 is never",
        0.0,
        1e6,
        live=True,
    )
    orbit_turns: float = parameter(
        2.0,
        "full turns without an approach after which a goal is missed",
        0.5,
        100.0,
        live=True,
    )
    follower: str = parameter(
        "preview",
        "what follows paths: an LQR with preview of the curvature, the baseline, or the shipped "
        "network",
        choices=tuple(FOLLOWERS),
    )
    path_speed: float = parameter(3.0, "m/s on paths that name no speed", 1.0, 8.0, live=True)
    path_slowest: float = parameter(
        2.0,
        "m/s, lowest speed in turns, after a goal and under cmd_vel",
        1.0,
        8.0,
        live=True,
    )
    arrival: str = parameter(
        "heading",
        "a goal's orientation is the direction of arrival, unless it is exactly (0, 0, 0, 1); "
        "or it is ignored",
        choices=("heading", "any"),
        live=True,
    )
    after_goal: str = parameter(
        "hold",
        "after the last goal: ride straight on, circle it, or ride on at path_slowest",
        choices=AFTER,
        live=True,
    )
    cmd_vel_fastest: float = parameter(
        5.0, "m/s, highest speed under cmd_vel", 1.0, 8.0, live=True
    )
    cmd_vel_yaw_rate: float = parameter(
        1.0, "rad/s, largest yaw rate under cmd_vel", 0.01, 10.0, live=True
    )
    cmd_vel_timeout: float = parameter(
        0.5,
        "simulated s after which a cmd_vel ends and the bicycle rides straight on",
        0.05,
        60.0,
        live=True,
    )
    keep_clear: str = parameter(
        "",
        "namespaces of other bicycles, as b2,b3, to keep clear of; none by default",
    )
    take_over: bool = parameter(True, "ride on a bicycle that is found riding, to the goal it had")
    managed: bool = parameter(
        False,
        "a managed node waits to be configured and activated by ros2 lifecycle; false does both "
        "by itself",
    )
    realtime_priority: int = priority_parameter()
    diagnostics_period: float = parameter(1.0, "s", 0.1, 3600.0)

    def names_to_keep_clear_of(self) -> list[str]:
        """Return the namespaces of `keep_clear`.

        Raises:
            ValueError: on what is no namespace.
        """
        names = [word.strip().strip("/") for word in self.keep_clear.split(",") if word.strip()]
        for name in names:
            require(
                re.fullmatch(NAMESPACE, name) is not None and len(name) <= LONGEST_NAME,
                f"parameter keep_clear holds {one_line(name)!r}: write namespaces with commas, "
                "as b2,b3",
            )
        return names

    def make_guidance(self) -> GuidanceConfig:
        """Return how paths, arrivals and cmd_vel are carried out.

        Raises:
            ValueError: if the lowest speed is above another one.
        """
        slowest = self.path_slowest
        require(
            slowest <= self.path_speed,
            f"parameter path_slowest is {slowest:g}: choose one up to path_speed",
        )
        twist = TwistLimits(
            slowest, self.cmd_vel_fastest, self.cmd_vel_yaw_rate, self.cmd_vel_timeout
        )
        return GuidanceConfig(self.follower, self.path_speed, slowest, self.after_goal, twist)

    def make_sensors(self) -> SensorSettings | None:
        """Return the sensors that the estimator listens to; None where it sees the truth.

        Raises:
            ValueError: when there are none of that name, or on a bad file.
        """
        return sensors.load(self.sensors) if self.state == "estimated" else None

    def start(self) -> tuple[float, float, float]:
        """Return where an estimated ride begins: m, m and the heading in rad."""
        return self.start_x, self.start_y, float(yaw_to_heading(self.start_yaw))

    def make_noise(self) -> Noise | None:
        """Return the exploration noise of one bicycle."""
        if self.exploration == "none":
            return None
        config = NoiseConfig(self.exploration, self.exploration_sigma, self.exploration_theta)
        return Noise(config, 1, 3, np.random.default_rng(self.seed))

    @np.errstate(all="ignore")  # an impossible bicycle gives NaN, which is checked later
    def make_fallback(self, limits: np.ndarray, plant: Plant[Any]) -> Controller | None:
        """Return the controller to use instead of the policy, limited to (3,) |T|, |d| and |F|."""
        if self.fallback == "steer_into_lean":
            return SteerIntoLean(float(limits[0]), self.steer_into_lean_gain)
        if self.fallback != "lqr":
            return None
        # Imported here: it needs scipy, which a policy does not.
        from bicycle_controller.control.lqr import fitting

        return fitting(limits, plant)

    @np.errstate(all="ignore")
    def make_safety(self, plant: Plant[Any]) -> Safety | None:
        """Return the safety layer between policy and bicycle."""
        if self.safety == "none":
            return None
        config = SafetyConfig(
            envelope=self.safety_envelope,
            lean=self.safety_lean,
            lean_rate=self.safety_lean_rate,
            slowest=self.safety_slowest,
            fastest=self.safety_fastest,
            oldest=float(self.safety_stale),
            hold=self.safety_hold,
            rates=(
                self.safety_torque_rate,
                self.safety_displacement_rate,
                self.safety_pedal_rate,
            ),
            stop=self.safety == "stop",
        )
        return Safety(config, plant)
