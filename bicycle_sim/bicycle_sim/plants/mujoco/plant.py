"""The bicycles of the plant whipple, moved by MuJoCo."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from bicycle_sim.plants.base import (
    Array,
    BodyState,
    Geometry,
    Linear,
    Loads,
    Plant,
    SteadyLean,
    SteadyTorque,
)
from bicycle_sim.plants.mujoco import model, poses
from bicycle_sim.plants.whipple import plain_parameters
from bicycle_sim.plants.whipple.constants import delay_steps
from bicycle_sim.plants.whipple.integrate import LIES
from bicycle_sim.plants.whipple.parameters import Parameters
from bicycle_sim.plants.whipple.plant import WhipplePlant

MOTION = poses.POSITIONS + poses.SPEEDS
"""Numbers of one bicycle's motion in MuJoCo."""


@dataclass
class MujocoState(BodyState):
    """N bicycles in MuJoCo; arrays of shape (N,) but for the last."""

    pitch: np.ndarray
    """rad, nose up."""
    yaw_rate: np.ndarray
    """rad/s."""
    motor_torque: np.ndarray
    """N m on the steering now."""
    stopped: np.ndarray
    """1 where the bicycle lies, so that it moves no more; else 0."""
    motion: np.ndarray = field(metadata={"wide": True})
    """(N, 19 + 3 k): MuJoCo's positions and speeds, then the last k commands that have not come
    to rule yet, the newest first."""


class MujocoPlant(Plant[MujocoState]):
    """N bicycles that are alike, each 1 ms after the other, every period begun without warm start.

    The linear model, steady turns and geometry are those of the plant whipple, which is what the
    controllers know; how the bicycle moves is MuJoCo's.
    """

    name = "mujoco"
    about = "a measured bicycle in MuJoCo"
    takes_bicycle = True
    state_type = MujocoState

    def __init__(self, p: Parameters) -> None:
        """Compile the model.

        Raises:
            ValueError: if MuJoCo is not installed, or the bicycle has what this plant has not.
        """
        self.parameters = p
        self._model = model.compiled(p)
        self._whipple = WhipplePlant(p)
        self._delay, self._share = (np.ravel(value)[0] for value in delay_steps(p))
        self._memory = int(self._delay + (self._share > 0.0))
        self._steps = max(1, round(p.time_step / model.STEP))
        self._data: list[Any] = []

    @property
    def time_step(self) -> float:
        """s of one control period."""
        return self.parameters.time_step

    @property
    def count(self) -> int | None:
        """None: all bicycles are alike."""
        return None

    @property
    def input_names(self) -> tuple[str, ...]:
        """Torque and pedal force."""
        return "torque", "pedal_force"

    @property
    def label(self) -> str:
        """The plant and the bicycle's name."""
        return f"{self.name} {self.parameters.name}".strip()

    @property
    def geometry(self) -> Geometry:
        """Geometry of the bicycle."""
        return self._whipple.geometry

    @property
    def pedal_gear(self) -> float:
        """Force at the rear wheel's rim per pedal force."""
        return self._whipple.pedal_gear

    @property
    def steer_friction(self) -> Array:
        """N m of Coulomb friction of the steering."""
        return self._whipple.steer_friction

    @property
    def torque_limit(self) -> float | None:
        """N m of the motor; None if it has no limit."""
        return self._whipple.torque_limit

    def initial(
        self, rear_x: np.ndarray, rear_y: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> MujocoState:
        """N upright bicycles with straight handlebars; arguments of shape (N,), m, rad, m/s."""
        zero = np.zeros(len(rear_x))
        given = {"rear_x": rear_x, "rear_y": rear_y, "heading": heading, "speed": speed}
        body = {item.name: zero for item in fields(BodyState)} | given
        moved = poses.to_mujoco(self.parameters.bicycle, self._whipple.constants, body)
        waiting = np.zeros((len(zero), 3 * self._memory))
        return self._state(moved, waiting, zero, zero, zero)

    def step(
        self,
        state: MujocoState,
        torque: np.ndarray,
        displacement: np.ndarray,
        pedal_force: np.ndarray,
        speed_limits: tuple[Array, Array] | None = None,
        loads: Loads | None = None,
    ) -> MujocoState:
        """Step by one control period; see `Plant.step`.

        Raises:
            ValueError: on a displacement or on loads, which this plant does not have.
        """
        if np.any(displacement) or loads is not None:
            raise ValueError("the plant mujoco has neither displacement nor loads: leave them out")
        count = len(state.speed)
        motion, waiting = state.motion[:, :MOTION], state.motion[:, MOTION:]
        command = np.stack([torque, np.zeros(count), pedal_force], axis=-1)
        queue = np.concatenate([command, waiting], axis=1)
        delay = int(self._delay)
        new = queue[:, 3 * delay : 3 * delay + 3]
        before = queue[:, 3 * delay + 3 : 3 * delay + 6] if self._share > 0.0 else new
        controls, motor = self._controls(state, new, before, speed_limits)
        moved = self._rolled(motion, controls)
        sane = np.isfinite(moved).all(axis=1) & (np.abs(moved[:, 10:]).max(axis=1) < 1000.0)
        going = (state.stopped == 0.0) & sane
        moved = np.where(going[:, None], moved, motion)
        after = self._state(
            moved, queue[:, : 3 * self._memory], motor, ~going * 1.0, state.lean_acceleration
        )
        up = (after.lean_rate - state.lean_rate) / self.time_step
        lies = np.abs(after.lean_angle) > LIES
        return replace(
            after,
            lean_acceleration=np.where(going, up, state.lean_acceleration),
            stopped=np.where(lies, 1.0, after.stopped),
        )

    def pushed(self, state: MujocoState, lean_rate: Array) -> MujocoState:
        """Return the state after a push that adds `lean_rate`, rad/s, float or (N,)."""
        up = np.where(state.stopped == 0.0, lean_rate, 0.0)
        return self.settled(replace(state, lean_rate=state.lean_rate + up))

    def settled(self, state: MujocoState) -> MujocoState:
        """Return the state of a bicycle that rolls with this lean, steering, rates and speed."""
        body = {item.name: getattr(state, item.name) for item in fields(BodyState)}
        moved = poses.to_mujoco(self.parameters.bicycle, self._whipple.constants, body)
        waiting, motor = state.motion[:, MOTION:], state.motor_torque
        return self._state(moved, waiting, motor, state.stopped, state.lean_acceleration)

    def yaw_rate(self, state: MujocoState) -> np.ndarray:
        """Return the yaw rate (N,), rad/s."""
        return state.yaw_rate

    def pitch(self, state: MujocoState) -> np.ndarray:
        """Return the pitch (N,), rad, nose up."""
        return state.pitch

    def fallen(self, state: MujocoState, limit: float) -> np.ndarray:
        """Return True (N,) for a lean of more than `limit`, rad, or a stop for good."""
        leans: np.ndarray = np.abs(state.lean_angle) > limit
        return leans | (state.stopped != 0.0)

    def linearize(self, speed: float, discrete: bool = False) -> Linear:
        """Return the Whipple bicycle linearised about riding straight at a speed, m/s."""
        return self._whipple.linearize(speed, discrete)

    def steady_lean(self, steer_angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the lean (N,), rad, of the Whipple bicycle's steady turns."""
        return self._whipple.steady_lean(steer_angle, speed)

    def steady_lean_law(self, steer_limit: float) -> SteadyLean:
        """Return the Whipple bicycle's."""
        return self._whipple.steady_lean_law(steer_limit)

    def steady_torque_law(self, steer_limit: float) -> SteadyTorque:
        """Return the Whipple bicycle's."""
        return self._whipple.steady_torque_law(steer_limit)

    def take(self, mask: np.ndarray) -> MujocoPlant:
        """Return this plant: all bicycles are alike."""
        return self

    def to_json(self) -> str:
        """Return all parameters to the last bit, with the key `plant`."""
        return json.dumps({"plant": self.name, **plain_parameters.to_dict(self.parameters)})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> MujocoPlant:
        """Return the content of `to_json` as plain data.

        Raises:
            ValueError: on an unknown or missing key, or on a value that makes no sense.
        """
        return cls(plain_parameters.from_dict({k: v for k, v in data.items() if k != "plant"}))

    def _state(
        self,
        moved: np.ndarray,
        waiting: np.ndarray,
        motor: np.ndarray,
        stopped: np.ndarray,
        lean_acceleration: np.ndarray,
    ) -> MujocoState:
        return MujocoState(
            **poses.from_mujoco(self.parameters.bicycle, moved),
            lean_acceleration=lean_acceleration,
            motor_torque=motor,
            stopped=stopped,
            motion=np.concatenate([moved, waiting], axis=1),
        )

    def _controls(
        self,
        state: MujocoState,
        new: np.ndarray,
        before: np.ndarray,
        speed_limits: tuple[Array, Array] | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return torques on steering and rear wheel (N, steps, 2), and the motor's at the end."""
        p, steps = self.parameters, self._steps
        controls = np.zeros((len(new), steps, 2))
        motor, now = p.motor, state.motor_torque
        late = round(self._share * steps)
        limit = float(motor.limit) or np.inf
        share = 1.0 - np.exp(-model.STEP / motor.lag) if motor.lag > 0.0 else 1.0
        most = motor.rate * model.STEP if motor.rate > 0.0 else np.inf
        for index in range(steps):
            asked = motor.rounded((before if index < late else new)[:, 0])
            asked = asked - np.clip(asked, -motor.dead_band, motor.dead_band)
            asked = np.clip(asked, -limit, limit)
            now = now + np.clip(share * (asked - now), -most, most)
            controls[:, index, model.STEER] = now
        early = late / steps
        pedal = early * before[:, 2] + (1.0 - early) * new[:, 2]
        rim = p.drive.gear * pedal
        if speed_limits is not None:
            low, high = speed_limits
            rim = rim + p.drive.governor * np.maximum(low - state.speed, 0.0)
            rim = rim - p.drive.governor * np.maximum(state.speed - high, 0.0)
        rim = np.clip(rim, -p.drive.brake, p.drive.power / np.maximum(state.speed, 1.0))
        rim = np.where(rim < 0.0, rim * np.clip(10.0 * state.speed, -1.0, 1.0), rim)
        controls[:, :, model.DRIVE] = (p.bicycle.rR * rim)[:, None]
        return controls, now

    def _rolled(self, motion: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Return positions and speeds (N, 19) after a period under controls (N, steps, 2)."""
        import mujoco
        from mujoco import rollout

        threads = min(len(motion), os.cpu_count() or 1)
        while len(self._data) < threads:
            self._data.append(mujoco.MjData(self._model))
        begun = np.concatenate([np.zeros((len(motion), 1)), motion], axis=1)  # time first
        states, _ = rollout.rollout(
            self._model, self._data[:threads], begun, controls, persistent_pool=threads > 1
        )
        return np.array(states[:, -1, 1:])
