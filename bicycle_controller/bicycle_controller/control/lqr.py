"""A classical controller: LQR on lean and steering inside, a heading loop around it.

It sees what a learned actor sees, the six observations and the speed, and no distance to the
goal. It is the yardstick that learned actors must beat. Where commands reach the bicycle late or
through a motor that lags, the plant's model says so: then it also remembers its last commands, of
which the motor's torque and the commands under way follow.

The heading loop turns the heading error into a wanted turn: a handlebar angle and the lean at
which that turn is steady. The LQR rides it. Two facts shape the wanted turn:

- A circle around a goal is ridden at a heading error of 90 degrees. It attracts the bicycle
  where the wanted curvature grows with the error and repels it where the curvature falls, so
  the turn is tightest at 60 degrees and widens steeply through 90.
- The error jumps from +180 to -180 degrees, and a bicycle countersteers over that edge before
  it turns. So the wanted turn is small there, or it would flip from side to side.

A turn that only a torque holds (a bicycle with trail) gets that torque, so the turn that is wanted
is the turn that is ridden.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.control.past import Past
from bicycle_controller.control.unseen import settled_in, through_commands
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant

SPEEDS = np.linspace(1.0, 8.0, 57)
"""m/s, for which gains are computed; between them they are interpolated, beyond them held."""

STATES = ("lean_angle", "lean_rate", "steer_angle", "steer_rate", "heading_error")
"""States of a linear plant that the controller sees, in the order of `state_weights`."""
INPUTS = ("torque", "displacement")
"""Inputs of a linear plant that it may use."""

SPEED_STEP = 0.001
"""m/s, how finely they are interpolated."""

TURN_ERRORS = np.radians([0.0, 60.0, 90.0, 120.0, 150.0, 180.0])
"""rad, the heading errors at which `LqrConfig.turn_shape` is given."""


@dataclass(frozen=True)
class LqrConfig:
    """Tuning of the controller.

    Raises:
        ValueError: on a weight, limit or table that makes no sense.
    """

    use_displacement: bool = False
    """True to move the centre of mass too; by default only the handlebar moves."""
    use_pedal: bool = False
    """True to hold the speed by pedalling; by default the pedal is not used."""
    torque_limit: float = 2.0
    """N m, largest |T|."""
    displacement_limit: float = 0.02
    """m, largest |d|."""
    pedal_limit: float = 100.0
    """N, largest |F|."""
    state_weights: tuple[float, ...] = (6.0, 0.4, 0.03, 0.4, 10.0)
    """Cost of squared lean, lean rate, steering, steering rate and heading error."""
    torque_weight: float = 1.0
    """Cost of squared torque."""
    displacement_weight: float = 1.0
    """Cost of squared displacement as a share of its limit."""
    hold_share: float = 0.6
    """Share of `torque_limit` that the tightest wanted turn may take to be held."""
    tilt_limit: float = 0.35
    """rad, the steepest tilt of the centre of mass wanted in a turn."""
    steer_limit: float = 0.7
    """rad, the largest steering wanted in a turn."""
    lean_lead: float = 1.4
    """Largest lead of the wanted lean over the present one; 1 is where full torque answers."""
    turn_shape: tuple[float, ...] = (1.0, 1.0, 0.68, 0.34, 0.71, 0.12)
    """Share of the tightest turn that is wanted at the heading errors TURN_ERRORS."""
    straight_speed: float = 5.0
    """m/s held when the goal lies ahead."""
    turn_speed: float = 1.75
    """m/s held when the heading error is `turn_error` or more."""
    turn_error: float = 0.5
    """rad of heading error from which on `turn_speed` is held."""
    speed_gain: float = 200.0
    """N of pedal force per m/s that is missing."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "state_weights", tuple(map(float, self.state_weights)))
        object.__setattr__(self, "turn_shape", tuple(map(float, self.turn_shape)))
        require(len(self.state_weights) == 5, "state_weights needs five numbers")
        require(
            len(self.turn_shape) == len(TURN_ERRORS),
            f"turn_shape needs {len(TURN_ERRORS)} numbers",
        )
        for item in fields(self):
            value = getattr(self, item.name)
            for number in value if isinstance(value, tuple) else (value,):
                require(
                    math.isfinite(number) and (number > 0 or isinstance(value, bool)),
                    f"{item.name} must be finite and above zero, not {value!r}",
                )
        require(self.steer_limit < math.pi / 2, "steer_limit must be below pi/2")
        require(self.tilt_limit < math.pi / 2, "tilt_limit must be below pi/2")


TUNED = {
    "lqr": LqrConfig(),
    "lqr-displacement": LqrConfig(use_displacement=True),
    "lqr-pedal": LqrConfig(use_pedal=True),
    "lqr-displacement-pedal": LqrConfig(use_displacement=True, use_pedal=True),
    "lqr-20cm": LqrConfig(
        use_displacement=True,
        displacement_limit=0.2,
        state_weights=(5.0, 0.24, 0.022, 0.08, 14.0),
        displacement_weight=7.3,
        tilt_limit=0.5,
        steer_limit=0.78,
        lean_lead=1.45,
        turn_shape=(1.0, 1.0, 0.72, 0.53, 0.85, 0.8),
    ),
}
"""Tunings by name; `lqr-20cm` needs a scenario that allows its displacement of 20 cm."""

REAL: dict[str, Any] = {
    "state_weights": (10.0, 1.0, 1.0, 0.1, 5.0),
    "torque_weight": 0.1,
    "lean_lead": 5.0,
}
"""Tuning of bicycles for which those by name were not made, with trail and perhaps a delay:
these weights catch larger kicks, above all under a long delay."""


def tuned(name: str, plant: Plant[Any], torque_limit: float | None = None) -> LqrConfig:
    """Return the tuning of a name for a bicycle.

    Args:
        name: one of TUNED.
        plant: the bicycle.
        torque_limit: N m; the motor's by default, or the tuning's if the plant has none.
    """
    config = TUNED[name]
    if plant.fits_named_tunings:
        return config
    limit = torque_limit or plant.torque_limit or config.torque_limit
    return replace(config, **REAL, torque_limit=limit)


def tuning_id(config: LqrConfig, plant: Plant[Any]) -> str:
    """Return `lqr-` and a digest of tuning and plant: the controller's `policy_id`."""
    values = asdict(config)
    if values["hold_share"] == LqrConfig.hold_share:
        del values["hold_share"]  # ids from before there was one stay as they were
    tuning = json.dumps([values, registry.to_dict(plant)])
    return "lqr-" + hashlib.sha256(tuning.encode()).hexdigest()[:8]


@cache
def _tuned(name: str, plant: Plant[Any], torque_limit: float | None) -> LqrController:
    """Return the controller of a tuning's name; its gains take a moment, so it is kept."""
    return LqrController.named(name, plant, torque_limit)


def fitting(limits: Sequence[float] | np.ndarray, plant: Plant[Any]) -> LqrController:
    """Return the controller that uses what the limits (3,) on |T|, |d| and |F| allow.

    An action whose limit is unknown, that is infinite, is not used.
    """
    torque, displacement, pedal = map(float, limits)
    name = "lqr"
    if math.inf > displacement >= TUNED["lqr-displacement"].displacement_limit:
        name += "-displacement"
    if math.inf > pedal >= TUNED["lqr-pedal"].pedal_limit:
        name += "-pedal"
    return _tuned(name, plant, torque if math.isfinite(torque) else None)


class LqrController:
    """The classical controller, gain-scheduled on speed; it holds no state between calls.

    Attributes:
        memory: number of past control periods whose commands `act` needs; 0 without delay or lag.
        tuning: name of its tuning in TUNED; empty if it has one of its own.
    """

    tuning = ""

    @classmethod
    def named(
        cls, name: str, plant: Plant[Any] | None = None, torque_limit: float | None = None
    ) -> LqrController:
        """Return the controller of a tuning's name, see `tuned`; by default for the paper's.

        Raises:
            ValueError: when the tuning moves what the plant has not.
        """
        ridden = plant if plant is not None else registry.default()
        controller = cls(tuned(name, ridden, torque_limit), ridden)
        controller.tuning = name
        return controller

    def __init__(self, config: LqrConfig | None = None, plant: Plant[Any] | None = None) -> None:
        """Compute the gains for every speed of SPEEDS.

        Args:
            config: the tuning; steering only by default.
            plant: the bicycle that is ridden; the paper's by default.

        Raises:
            ValueError: when the tuning moves what the plant has not.
        """
        self.config = config or LqrConfig()
        self.plant = plant if plant is not None else registry.default()
        self._policy_id = tuning_id(self.config, self.plant)
        require(
            not self.config.use_displacement or "displacement" in self.plant.input_names,
            f"no displacement moves the bicycle {self.plant.label}: choose an LQR without, or a "
            "bicycle with a rider who leans",
        )
        self._steady_lean = self.plant.steady_lean_law(self.config.steer_limit)
        self._steady_torque = self.plant.steady_torque_law(self.config.steer_limit)
        self._inputs = INPUTS[: 2 if self.config.use_displacement else 1]
        self._limits = self.config.torque_limit, self.config.displacement_limit
        held = self._steady_torque(np.full(len(SPEEDS), 0.1), SPEEDS)
        self._holds = bool(held.any()) and not self.config.use_displacement
        self.memory = settled_in(self.plant.linearize(float(SPEEDS[0]), discrete=True), STATES)
        designs = np.array([self._design(float(speed)) for speed in SPEEDS])
        fine = np.arange(SPEEDS[0], SPEEDS[-1] + 0.5 * SPEED_STEP, SPEED_STEP)
        self._schedule = np.array([np.interp(fine, SPEEDS, column) for column in designs.T])

    @property
    def policy_id(self) -> str:
        """`lqr-` and a digest of tuning and plant."""
        return self._policy_id

    @np.errstate(over="ignore", invalid="ignore")  # the caller checks the result
    def act(
        self, observation: np.ndarray, speed: np.ndarray, past: Past | None = None
    ) -> np.ndarray:
        """Return the action for each bicycle.

        Args:
            observation: (N, 6), see `bicycle_sim.task.task.OBSERVATION_FIELDS`.
            speed: (N,) m/s.
            past: of `memory` periods or more; without it, the last commands are taken for those
                that hold the turn.

        Returns:
            (N, 3): N m of torque, m of displacement, N of pedal force, within the limits.

        Raises:
            ValueError: on another shape.
        """
        if observation.shape != (len(speed), 6):
            raise ValueError(
                f"observation must have shape (N, 6) with N speeds, not {observation.shape} "
                f"with {len(speed)}"
            )
        config = self.config
        steer, steer_rate, lean, lean_rate, _, error = observation.T
        gains = self._gains(speed)

        share = np.interp(np.abs(error), TURN_ERRORS, config.turn_shape)
        wanted_steer = -_limited(gains[8] * error, gains[9] * share)
        wanted_tilt = self._steady_lean(wanted_steer, speed)
        wanted_displacement, wanted_lean = self._divide(wanted_tilt, gains[10])
        # A turn too far ahead would saturate the torque, so ride a wider one first.
        ahead = _limited(wanted_lean - lean, gains[11])
        wanted_steer = wanted_steer - (wanted_lean - lean - ahead) * gains[12]
        state = (-ahead, lean_rate, steer - wanted_steer, steer_rate)
        answers = [-_dot(gains[0:4], state)]
        steady: list[np.ndarray | float] = [0.0]
        if self._holds:
            steady[0] = self._steady_torque(wanted_steer, speed)
            answers[0] = answers[0] + steady[0]
        if config.use_displacement:
            answers.append(wanted_displacement - _dot(gains[4:8], state))
            steady.append(wanted_displacement)
        if past is not None and self.memory:
            for index, answer in enumerate(self._late(past, steady, gains[13:])):
                answers[index] = answers[index] + answer
        action = np.zeros((len(speed), 3))
        for index, (answer, limit) in enumerate(zip(answers, self._limits, strict=False)):
            action[:, index] = _limited(answer, limit)
        if config.use_pedal:
            action[:, 2] = self._pedal(error, speed)
        return action

    def _late(self, past: Past, steady: list[np.ndarray | float], gains: np.ndarray) -> np.ndarray:
        """Return the correction for past commands that differ from `steady`, (inputs, N)."""
        inputs, count = len(steady), gains.shape[-1]
        sent = past.action[:, : self.memory, :inputs].transpose(1, 2, 0)
        beside = sent - np.array([np.broadcast_to(value, count) for value in steady])
        shares = gains.reshape(2, self.memory, inputs, count)[:inputs]
        answer: np.ndarray = -(shares * beside).sum(axis=(1, 2))
        return answer

    def _divide(
        self, tilt: np.ndarray, share: np.ndarray
    ) -> tuple[np.ndarray | float, np.ndarray]:
        """Displacement, m, and lean, rad, that tilt the centre of mass together (eq. 6)."""
        if not self.config.use_displacement:
            return 0.0, tilt
        height = self.plant.geometry.mass_height
        displacement = _limited(height * np.tan(share * tilt), self.config.displacement_limit)
        return displacement, tilt - np.arctan(displacement / height)

    def _gains(self, speed: np.ndarray) -> np.ndarray:
        """Return the numbers of `_design` at each speed, (13 or more, N)."""
        index = np.rint((speed - SPEEDS[0]) / SPEED_STEP).astype(np.intp)
        return self._schedule.take(index, axis=1, mode="clip")

    def _pedal(self, error: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Pedal force, (N,) N: fast when the goal lies ahead, slow in turns."""
        config = self.config
        turning = np.minimum(np.abs(error) / config.turn_error, 1.0)
        wanted = config.straight_speed + turning * (config.turn_speed - config.straight_speed)
        return _limited(config.speed_gain * (wanted - speed), config.pedal_limit)

    def _design(self, speed: float) -> list[float]:
        """Gains at one speed, m/s.

        The LQR's fifth gain, on the heading error, is turned into the steady turn with which
        the other gains would answer it. So the loop is the LQR's for small errors, and can be
        limited in terms of turns for large ones.

        Returns:
            Four gains of torque and four of displacement on lean, lean rate, steering and
            steering rate; wanted steering per heading error; the largest wanted steering, rad;
            the displacement's share of a steady tilt; rad that the wanted lean may be ahead;
            steering per tilt of a steady turn; gains of torque, then of displacement, on the last
            commands, the newest first.
        """
        config, model = self.config, self.plant.linearize(speed, discrete=True)
        costs = [config.torque_weight, config.displacement_weight / config.displacement_limit**2]
        weights = dict(zip(STATES, config.state_weights, strict=True))
        inputs = len(self._inputs)
        gain = np.zeros((2, len(STATES)))
        found = _regulator(
            model.a,
            model.b[:, [model.inputs.index(name) for name in self._inputs]],
            [weights.get(name, 0.0) for name in model.states],
            costs[:inputs],
        )
        gain[:inputs] = found[:, [model.states.index(name) for name in STATES]]
        # The last commands show what no observation does: motor torque and commands under way.
        late = np.zeros((2, self.memory, inputs))
        late[:inputs] = through_commands(model, found, STATES, self._inputs, self.memory)

        steer = np.linspace(0.0, config.steer_limit, 1001)
        tilt = self._steady_lean(steer, np.full_like(steer, speed))
        hold = np.zeros_like(steer)
        if self._holds:
            hold = self._steady_torque(steer, np.full_like(steer, speed))
        tilt_per_steer, tilt_per_metre = tilt[1] / steer[1], 1.0 / self.plant.geometry.mass_height
        hold_per_steer = hold[1] / steer[1]
        # Unknown lean, steering and displacement per heading error: the torque that holds the
        # turn, the regulator's displacement, and the tilt that the turn needs.
        balance = [
            [gain[0, 0], gain[0, 2] + hold_per_steer * (1.0 + late[0, :, 0].sum()), 0.0],
            [gain[1, 0], gain[1, 2], 1.0],
            [1.0, -tilt_per_steer, tilt_per_metre],
        ]
        _, turn, moved = np.linalg.solve(balance, [-gain[0, 4], -gain[1, 4], 0.0])
        share = moved * tilt_per_metre / (turn * tilt_per_steer)
        rideable = (tilt <= config.tilt_limit) & (
            np.abs(hold) <= config.hold_share * config.torque_limit
        )
        tightest = np.interp(config.tilt_limit, tilt, steer)
        if self._holds and not rideable.all():
            tightest = min(tightest, steer[max(1, int(rideable.argmin()) - 1)])
        lead = config.lean_lead * config.torque_limit / abs(gain[0, 0])
        turns = (-float(turn), float(tightest), float(share), float(lead), 1.0 / tilt_per_steer)
        return [*gain[0, :4], *gain[1, :4], *turns, *late.ravel()]


def _regulator(
    a: np.ndarray, b: np.ndarray, state_costs: Sequence[float], input_costs: Sequence[float]
) -> np.ndarray:
    """Gain K of the u = -K x with the least sum of weighted squares, (inputs, states)."""
    # Imported here: scipy takes a second to load, and a tuning's id does not need it.
    from scipy.linalg import solve_discrete_are

    q, r = np.diag(state_costs), np.diag(input_costs)
    cost = solve_discrete_are(a, b, q, r)
    return np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a)


def _dot(gains: np.ndarray, state: tuple[np.ndarray, ...]) -> np.ndarray:
    """Sum over the four states of gain times state, (N,)."""
    return gains[0] * state[0] + gains[1] * state[1] + gains[2] * state[2] + gains[3] * state[3]


def _limited(value: np.ndarray, limit: np.ndarray | float) -> np.ndarray:
    """Clip `value` to -limit and limit, faster than numpy.clip for few bicycles."""
    return np.minimum(np.maximum(value, -limit), limit)
