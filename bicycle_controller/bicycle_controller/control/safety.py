"""A layer between policy and bicycle: it hands over to the fallback while that can still recover.

The layer watches above all the extrapolated lean: the lean at which a bicycle with zero lean rate
and a straight handlebar would fall in the same way. It is the state's share in the unstable mode
of the linearised bicycle, like the extrapolated centre of mass (Hof et al. 2005) of a walker.
Steering increases it too, so it warns before the lean itself does. The bicycle determines its
limit: how far torque limit and handlebar can bring the unstable mode back (`recoverable`). A plant
whose limit was measured has it in its `safety_envelope`.

All functions take N bicycles at once: the same code runs in the node and is measured over
thousands of rides (`tests/benchmarks/bench_safety.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.control import recoverable
from bicycle_controller.control.guide import PlannedTurns
from bicycle_controller.control.unseen import settled_in, through_commands
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant

TORQUE_SHARE = 0.35
"""Share of the extrapolated lean from which the torque limit can still save."""
STEERING = 0.5
"""rad, the turn of the handlebar that may be needed."""
LARGEST = 0.5
"""rad of extrapolated lean, where the bicycle lies at `base.FALL_ANGLE`, 0.524 rad."""
TORQUE_LIMIT = 2.0
"""N m of a bicycle that names none, as in the scenarios."""

TURN_LEAVES = 0.2
"""Least share of the limit that a planned turn leaves for what is beside it."""

SPEEDS = np.linspace(1.0, 8.0, 141)
"""m/s, for which the unstable mode is computed."""
SLOWEST, SPACING = float(SPEEDS[0]), float(SPEEDS[1] - SPEEDS[0])
MODE_STATES = ("lean_angle", "lean_rate", "steer_angle", "steer_rate")
MODE_ORDER = np.array([2, 3, 0, 1])
"""Indices of lean, lean rate, steering and steering rate in an observation."""

TRUST = 10.0
"""s of riding after which a hand-over no longer counts against the next one."""
LONGEST_HOLD = 64.0
"""s that the fallback keeps the bicycle at most before it lets a policy try again."""
STOP_SPEED = 1.5
"""m/s that a commanded stop slows down to: slower, the bicycle is hard to hold upright."""
STOP_GAIN = 200.0
"""N of pedal force per m/s above it."""


class HandOverReason(IntEnum):
    """Why the fallback drives; the numbers are those of HandOver."""

    NONE = 0
    EXTRAPOLATED_LEAN = 1
    LEAN = 2
    LEAN_RATE = 3
    TOO_SLOW = 4
    TOO_FAST = 5
    STALE = 6
    POLICY = 7


WATCHED = tuple(HandOverReason)[1:7]
"""Rows of `_measures`, in its order."""

CALM = np.array([0.5, 0.7, 0.5, 0.97, 0.97, 0.5])[:, None]
"""Share of each limit that must not be exceeded before the policy gets the bicycle back."""

_WORDS = {
    HandOverReason.EXTRAPOLATED_LEAN: ("extrapolated lean", "rad"),
    HandOverReason.LEAN: ("lean", "rad"),
    HandOverReason.LEAN_RATE: ("lean rate", "rad/s"),
    HandOverReason.TOO_SLOW: ("speed", "m/s"),
    HandOverReason.TOO_FAST: ("speed", "m/s"),
    HandOverReason.STALE: ("age of the command that led to the state", "steps"),
}


@dataclass(frozen=True)
class SafetyConfig:
    """Bounds beyond which the fallback takes over, and the largest rates of the actions.

    Raises:
        ValueError: on a number that is not finite and above zero.
    """

    envelope: float = 1.0
    """Share of the largest extrapolated lean."""
    lean: float = 0.5
    """rad, largest |omega|."""
    lean_rate: float = 0.5
    """rad/s, largest |omega dot|."""
    slowest: float = 1.1
    """m/s."""
    fastest: float = 5.5
    """m/s."""
    oldest: float = 10.0
    """Steps that the command which led to a state may be late by."""
    hold: float = 1.0
    """s that the fallback drives at least; doubled where the policy fails again within TRUST."""
    rates: tuple[float, float, float] = (200.0, 20.0, 10000.0)
    """N m/s, m/s and N/s, largest changes of T, d and F; by default the full range in one step."""
    stop: bool = False
    """True if a hand-over ends the ride to the goal in a commanded stop."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            for number in value if isinstance(value, tuple) else (value,):
                require(
                    isinstance(value, bool) or (math.isfinite(number) and number > 0),
                    f"{name} must be finite and above zero, not {value!r}",
                )


class Safety:
    """Says for every state who drives, and keeps commands from jumping.

    Attributes:
        reason: (N,) why the fallback drives, a `HandOverReason`; 0 where the policy does.
        hand_overs: (N,) times that it took over.
        limited: (N,) commands whose change was cut.
    """

    def __init__(
        self,
        config: SafetyConfig | None = None,
        plant: Plant[Any] | None = None,
        count: int = 1,
    ) -> None:
        """Begin with the policy in charge of `count` bicycles; the paper's by default."""
        self.config = config or SafetyConfig()
        self.plant = plant if plant is not None else registry.default()
        self._memory = settled_in(self.plant.linearize(SLOWEST, discrete=True), MODE_STATES)
        self._mode = np.array([unstable_mode(float(speed), self.plant) for speed in SPEEDS])
        self._sent = np.zeros((count, self._memory))
        self._envelope = envelope(self.plant)
        self._time_step = self.plant.time_step
        self._rates = np.array(self.config.rates) * self._time_step
        self.reason = np.zeros(count, dtype=np.int64)
        self.hand_overs = np.zeros(count, dtype=np.int64)
        self.limited = np.zeros(count, dtype=np.int64)
        fixed = self.config
        limits = (0.0, fixed.lean, fixed.lean_rate, fixed.slowest, fixed.fastest, fixed.oldest)
        self._values = np.zeros((len(WATCHED), count))
        self._limits = np.array(limits)[:, None].repeat(count, axis=1)
        self.reset()

    def reset(self) -> None:
        """Trust the policy again, at a new episode or with a new policy; the counts stay."""
        count = len(self.reason)
        self.reason = np.zeros(count, dtype=np.int64)
        self._hold = np.full(count, self._steps(self.config.hold))
        self._left = np.zeros(count, dtype=np.int64)
        self._quiet = np.full(count, self._steps(TRUST))
        self._last: np.ndarray | None = None
        self._sent = np.zeros((count, self._memory))

    def _steps(self, seconds: float) -> int:
        return max(1, round(seconds / self._time_step))

    def extrapolated_lean(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """rad, (N,): see above; its size where the unstable modes are a pair that oscillates.

        Args:
            observation: (N, 6), see `bicycle_sim.task.task.OBSERVATION_FIELDS`.
            speed: (N,) m/s.
        """
        return np.asarray(np.abs(self._in_mode(observation, self._sent, speed)))

    def _in_mode(self, observation: np.ndarray, sent: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the share of states and torques under way in the unstable mode, (N,) complex."""
        nearest = np.rint((speed - SLOWEST) / SPACING).astype(np.intp)
        mode = self._mode.take(nearest, axis=0, mode="clip")
        if not self._memory:
            return np.asarray((mode * observation[:, MODE_ORDER]).sum(axis=1))
        # Count commands under way as applied.
        known = np.concatenate([observation[:, MODE_ORDER], sent], axis=1)
        return np.asarray((mode * known).sum(axis=1))

    def beside(
        self, observation: np.ndarray, speed: np.ndarray, turns: PlannedTurns
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return how far the bicycle is beside its planned turns.

        A steady turn has a lean and a steering of its own, which are no fall; the torque and the
        steering that hold it are no longer there to save the bicycle.

        Args:
            observation: (N, 6), see `bicycle_sim.task.task.OBSERVATION_FIELDS`.
            speed: (N,) m/s.
            turns: of the N bicycles.

        Returns:
            (N,) rad of extrapolated lean beyond the nearest of the turns, and (N,) the share of
            the limit that the sharpest of them leaves.
        """
        steady = np.zeros((len(speed), observation.shape[1]))
        steady[:, 0], steady[:, 2] = turns.steer, turns.lean
        held = np.repeat(turns.torque[:, None], self._memory, axis=1)
        named = self._in_mode(steady, held, speed)
        now = self._in_mode(observation, self._sent, speed)
        size = np.maximum(np.abs(named), 1e-9) ** 2
        nearest = np.clip((now * named.conj()).real / size, turns.right, turns.left)
        most = self.plant.torque_limit or TORQUE_LIMIT
        used = np.maximum(np.abs(turns.torque) / most, np.abs(turns.steer) / STEERING)
        left = 1.0 - used * np.maximum(-turns.right, turns.left)
        return np.asarray(np.abs(now - nearest * named)), np.maximum(left, TURN_LEAVES)

    def judge(
        self,
        observation: np.ndarray,
        speed: np.ndarray,
        age: np.ndarray,
        turns: PlannedTurns | None = None,
    ) -> np.ndarray:
        """Look at new states, one step after the last ones.

        Args:
            observation: (N, 6), see `bicycle_sim.task.task.OBSERVATION_FIELDS`.
            speed: (N,) m/s.
            age: (N,) steps that the command which led to each state was late by.
            turns: planned by a guide; None where a goal or nothing is ridden to.

        Returns:
            (N,) the reasons for which the fallback must answer; 0 where the policy may.
        """
        with np.errstate(all="ignore"):  # a state that is not finite is beyond every limit
            shares = self._measure(observation, speed, age, turns)
            within = shares <= 1.0
        if within.all() and not self.reason.any():
            self._quiet += 1
            return self.reason
        driving, beyond = self.reason > 0, ~within.all(axis=0)
        with np.errstate(invalid="ignore"):
            calm = (shares <= CALM).all(axis=0)
        self._left = np.maximum(self._left - 1, 0)
        # The policy returns only after the bicycle has been calm for a moment.
        soon = np.maximum(self._left, self._steps(0.5 * self.config.hold))
        self._left = np.where(driving & ~calm, soon, self._left)
        self._quiet = np.where(driving, 0, self._quiet + 1)
        self.reason = np.where(driving & (self._left == 0), 0, self.reason)
        worst = np.where(np.isnan(shares), np.inf, shares).argmax(axis=0) + 1
        self._take_over(beyond & ~driving, worst)
        return self.reason

    def fail(self, failed: np.ndarray) -> np.ndarray:
        """Take over where the policy gave no action, bool (N,); returns the reasons again."""
        self._take_over(
            failed & (self.reason == 0), np.full(len(failed), int(HandOverReason.POLICY))
        )
        return self.reason

    def limit(self, action: np.ndarray, steps: int = 1) -> np.ndarray:
        """(N, 3) actions that differ from the last ones, `steps` ago, by no more than allowed."""
        if self._last is not None:
            reach = self._rates * steps
            low, high = self._last - reach, self._last + reach
            if not ((action >= low) & (action <= high)).all():
                cut = action.clip(low, high)
                self.limited += (cut != action).any(axis=1)
                action = cut
        self._last = action
        for _ in range(min(steps, self._memory)):  # the last one was held where a step was missed
            self._sent = np.concatenate([action[:, :1], self._sent[:, :-1]], axis=1)
        return action

    def explain(self, index: int = 0) -> str:
        """Why the fallback drives bicycle `index`, in words with numbers."""
        reason = HandOverReason(int(self.reason[index]))
        if reason not in _WORDS:
            return ""
        what, unit = _WORDS[reason]
        row = WATCHED.index(reason)
        value, limit = self._values[row, index], self._limits[row, index]
        if reason is HandOverReason.STALE and math.isinf(value):
            return "no command led to the state"
        return f"{what} {value:.3g} {unit} is beyond {limit:.3g} {unit}"

    def _take_over(self, taken: np.ndarray, reason: np.ndarray) -> None:
        """Let the fallback drive where `taken` (N,); longer where it had to not long ago."""
        if not taken.any():
            return
        first, longest = self._steps(self.config.hold), self._steps(LONGEST_HOLD)
        again = self._quiet < self._steps(TRUST)
        hold = np.where(again, np.minimum(2 * self._hold, longest), first)
        self._hold = np.where(taken, hold, self._hold)
        self._left = np.where(taken, self._hold, self._left)
        self.reason = np.where(taken, reason, self.reason)
        self.hand_overs += taken

    def _measure(
        self,
        observation: np.ndarray,
        speed: np.ndarray,
        age: np.ndarray,
        turns: PlannedTurns | None = None,
    ) -> np.ndarray:
        """Return every one of WATCHED as a share of its limit, (6, N)."""
        values, limits = self._values, self._limits
        limits[0] = self.config.envelope * np.interp(speed, *self._envelope)
        if turns is None:
            values[0] = self.extrapolated_lean(observation, speed)
        elif math.isinf(turns.room):
            values[0] = 0.0
        else:
            values[0], left = self.beside(observation, speed, turns)
            limits[0] *= left * turns.room
        np.abs(observation[:, 2:4].T, out=values[1:3])
        values[3:5] = speed
        values[5] = age
        shares = values / limits
        shares[3] = 1.0 / shares[3]
        return np.asarray(shares)


def envelope(
    plant: Plant[Any], torque_limit: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds, m/s, and the largest extrapolated lean at each, rad; both (n,).

    Args:
        plant: with the delay and the motor that it has.
        torque_limit: N m; the motor's by default, or TORQUE_LIMIT.
    """
    if plant.safety_envelope is not None:
        measured_speeds, leans = plant.safety_envelope
        return np.array(measured_speeds), np.array(leans)
    limit = torque_limit or plant.torque_limit or TORQUE_LIMIT
    speeds = SPEEDS[::4]
    found = [
        min(
            LARGEST,
            TORQUE_SHARE * recoverable.farthest(plant.linearize(speed, discrete=True), limit),
            STEERING * recoverable.within_steering(plant.linearize(speed)),
        )
        for speed in map(float, speeds)
    ]
    return speeds, np.array(found)


def unstable_mode(speed: float, plant: Plant[Any]) -> np.ndarray:
    """Return the parts of lean, lean rate, steering and steering rate in the extrapolated lean.

    Returns:
        (4,) complex: the left eigenvector of the most unstable pole, with 1 for the lean; of a
        plant with delay or motor lag (4 + n,), what its last n torques add, the newest first.
    """
    discrete = plant.linearize(speed, discrete=True)
    memory = settled_in(discrete, MODE_STATES)
    if memory:
        vector = recoverable.unstable_mode(discrete).vector
        seen = [vector[discrete.states.index(name)] for name in MODE_STATES]
        sent = [
            through_commands(discrete, part[None], MODE_STATES, ("torque",), memory)[0, :, 0]
            for part in (vector.real, vector.imag)
        ]
        return np.concatenate([seen, sent[0] + 1j * sent[1]])
    model = plant.linearize(speed)
    rows = [model.states.index(name) for name in MODE_STATES]
    poles, vectors = np.linalg.eig(model.a[np.ix_(rows, rows)].T)
    vector = vectors[:, poles.real.argmax()]
    return np.asarray(vector / vector[0], dtype=np.complex128)


def stopping_pedal(speed: float) -> float:
    """N of pedal force that slow the bicycle down to STOP_SPEED; m/s."""
    return STOP_GAIN * (STOP_SPEED - speed)
