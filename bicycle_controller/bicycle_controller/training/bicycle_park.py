"""Thousands of random bicycles on their training rides, each with its own teacher beside it.

Every ride has disturbances: kicks, gusts, turns, jumps of the wanted heading. The actor's inputs
are noisy and biased; the teachers see the truth.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_controller.config.imitation import ImitationConfig
from bicycle_controller.control.past import Past
from bicycle_controller.training.calm_teachers import CalmTeachers
from bicycle_controller.training.teachers import COMMANDS, Seen, Teachers
from bicycle_sim.plants import base
from bicycle_sim.plants.base import FALL_ANGLE, Loads
from bicycle_sim.plants.whipple import random_bicycles
from bicycle_sim.plants.whipple.plant import WhipplePlant

SPEEDS = np.linspace(0.75, 7.0, 11)
"""m/s, for which teachers are designed."""
JUDGED = (1, 3, 5, 8)
"""Indices into SPEEDS at which the weights are compared; between them the nearest."""
LARGEST_KICK = 300.0
"""deg/s."""
BISECTIONS = 6
PREFERENCE = 1.05
"""Factor by which another teacher than the first of the list has to be better in a turn: teachers
that are alike are learned better than each bicycle's best."""
SETTLING, TURNING, CATCHING = 10, 120, 110
"""Control periods straight on or in a turn before a kick that weights are judged by, and after."""
TURN_LEAN, TURN_RADIUS = 0.1, 5.0
"""rad of lean and least radius in m of the turn in which weights are judged."""
LARGEST_STEER = np.pi / 3
"""rad, beyond which a ride has ended."""
CHANGING = (
    *("seen", "speed", "error", "commands", "teacher_rides"),
    *("_wanted", "_wanted_rate", "_gust"),
)
"""Arrays of a park that change while it rides."""
GUST_TIME = 0.5
"""s in which gusts change."""


class Park:
    """N bicycles that ride at once.

    Attributes:
        plant: the bicycles.
        limits: (N,) N m, their largest torques.
        falls, rides: counts since the last `metrics`.
    """

    def __init__(
        self, config: ImitationConfig, count: int, memory: int, rng: np.random.Generator
    ) -> None:
        """Draw `count` bicycles and design their teachers.

        Args:
            config: see there.
            count: N.
            memory: control periods that the actor remembers.
            rng: source of everything.
        """
        self.config, self.riding, self.rng = config, config.riding, rng
        parameters = random_bicycles.draw(count, rng, config.ranges, config.substeps)
        self.plant = WhipplePlant(parameters)
        self.limits = np.asarray(parameters.motor.limit)
        self.teachers, self.caught = teachers_of(self.plant, self.limits, config)
        noise = self.riding.noise * rng.uniform(size=count)
        pairs = (self.riding.lean_noise, self.riding.rate_noise, self.riding.steer_noise)
        self._white = noise[:, None] * [pair[0] for pair in pairs]
        self._white_rate = noise * self.riding.steer_rate_noise
        most = np.array([pair[1] for pair in pairs])
        self._bias = noise[:, None] * rng.uniform(-most, most, (count, 3))
        self._gustiness = self.riding.gust * rng.uniform(size=count) ** 2
        self.past = Past(count, memory)
        zero = np.zeros(count)
        self._zero, self._wanted, self._wanted_rate, self._gust = zero, zero, zero, zero
        self.commands = np.zeros((count, COMMANDS))
        self.state = self.plant.initial(zero, zero, zero, zero + 3.0)
        self.teacher_rides = np.ones(count, dtype=bool)
        self.falls = self.rides = 0
        self.seen, self.speed = np.zeros((count, 6)), zero
        self.begin(np.ones(count, dtype=bool), 1.0)

    def begin(self, mask: np.ndarray, teacher_share: float) -> None:
        """Begin the rides of `mask` (N,) anew; `teacher_share` of them are ridden by teachers."""
        number = int(mask.sum())
        if not number:
            return
        rng, riding = self.rng, self.riding
        low, high = riding.speeds
        # As many below 2.2 m/s as above: slow rides are the hard ones.
        speed = low + (high - low) * rng.uniform(size=number) ** 2
        heading = rng.uniform(-np.pi, np.pi, number)
        speeds, headings = self.state.speed.copy(), self.state.heading.copy()
        speeds[mask], headings[mask] = speed, heading
        fresh = self.plant.initial(self._zero, self._zero, headings, speeds)
        self.state = base.where(mask, fresh, self.state)
        self._wanted = self._wanted.copy()
        self._wanted[mask] = heading
        self._wanted_rate = np.where(mask, 0.0, self._wanted_rate)
        self._gust = np.where(mask, 0.0, self._gust)
        self.commands = np.where(mask[:, None], 0.0, self.commands)
        self.teacher_rides = self.teacher_rides.copy()
        self.teacher_rides[mask] = rng.uniform(size=number) < teacher_share
        self.rides += number
        self._look(None)
        self.past.fill(mask, self.seen, self.speed)

    def _look(self, _: object) -> None:
        """Measure the state: `seen` (N, 6), `speed` (N,)."""
        state, rng = self.state, self.rng
        error = wrap_angle(state.heading - self._wanted)
        noise = self._bias + self._white * rng.standard_normal(self._white.shape)
        rate = self._white_rate * rng.standard_normal(len(error))
        self.error = error
        self.seen = np.column_stack(
            [
                state.steer_angle + noise[:, 2],
                state.steer_rate + rate,
                state.lean_angle + noise[:, 0],
                state.lean_rate + noise[:, 1],
                state.lean_acceleration,
                error,
            ]
        )
        self.speed = state.speed

    def taught_torque(self) -> np.ndarray:
        """Return the teachers' answers to the true state, (N,) N m."""
        return self.teachers.act(Seen.of(self.state, self.error, self.commands))

    def step(self, torque: np.ndarray, teacher_share: float) -> None:
        """Ride one control period with torques (N,) N m; rides that end begin anew."""
        torque = np.clip(torque, -self.limits, self.limits)
        action = np.column_stack([torque, self._zero, self._zero])
        self.past.push(self.seen, self.speed, action)
        self.commands = np.column_stack([torque, self.commands[:, :-1]])
        self._disturb()
        loads = Loads(lateral_force=self._gust)
        self.state = self.plant.step(self.state, torque, self._zero, self._zero, loads=loads)
        state, period = self.state, self.plant.time_step
        fell = np.abs(state.lean_angle) > FALL_ANGLE
        fell |= np.abs(state.steer_angle) > LARGEST_STEER
        fell |= state.stopped != 0.0
        self.falls += int(fell.sum())
        over = self.rng.uniform(size=len(fell)) < period / self.riding.seconds
        over |= (state.speed < 0.6) | (state.speed > 7.5)
        self._wanted = self._wanted + self._wanted_rate * period
        self._look(None)
        self.begin(fell | over, teacher_share)

    def _disturb(self) -> None:
        """Kick some, and let the wind and the wanted heading of some change."""
        rng, riding, period = self.rng, self.riding, self.plant.time_step
        count = len(self.limits)
        kicked = rng.uniform(size=count) < period / riding.kick_every
        if kicked.any():
            place = np.interp(self.speed, SPEEDS, np.arange(len(SPEEDS))).astype(np.intp)
            most = riding.kick_share * np.radians(self.caught[place, np.arange(count)])
            self.state = self.plant.pushed(
                self.state, np.where(kicked, rng.uniform(-1.0, 1.0, count) * most, 0.0)
            )
        keep = np.exp(-period / GUST_TIME)
        fresh = np.sqrt(1.0 - keep**2) * self._gustiness * rng.standard_normal(count)
        self._gust = keep * self._gust + fresh
        turned = rng.uniform(size=count) < period / riding.turn_every
        if turned.any():
            radius = np.maximum(4.0, self.speed**2 / (9.81 * np.tan(0.3)))
            # Up to more than it can turn, as around a goal too near: the error stays large.
            rate = rng.choice((-1.0, 0.0, 1.0), count) * rng.uniform(0.1, 1.8, count)
            rate *= self.speed / radius
            self._wanted_rate = np.where(turned, rate, self._wanted_rate)
            jump = rng.uniform(-np.pi, np.pi, count) * (rng.uniform(size=count) < 0.5)
            self._wanted = np.where(turned, self._wanted + jump, self._wanted)

    def state_dict(self) -> dict[str, Any]:
        """Return what changes while they ride; bicycles and teachers are drawn again."""
        own = {name: getattr(self, name) for name in CHANGING}
        counts = {"falls": self.falls, "rides": self.rides}
        rng = self.rng.bit_generator.state
        return {"state": asdict(self.state), "past": self.past.rows, "rng": rng} | own | counts

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state` of a park that was drawn alike, to the bit."""
        self.state = self.plant.state_type(**state["state"])
        self.past.rows = state["past"]
        for name in (*CHANGING, "falls", "rides"):
            setattr(self, name, state[name])
        self.rng.bit_generator.state = state["rng"]

    def metrics(self) -> dict[str, float]:
        """Return the share of rides that ended in a fall since the last call."""
        found = {"rides": float(self.rides), "fall_share": self.falls / max(1, self.rides)}
        self.falls = self.rides = 0
        return found


def teachers_of(
    plant: WhipplePlant, limits: np.ndarray, config: ImitationConfig
) -> tuple[Teachers | CalmTeachers, np.ndarray]:
    """Return the teachers of N bicycles.

    Args:
        plant: the bicycles.
        limits: (N,) N m, the largest torques.
        config: their weights, turns, and whether calm ones ride between kicks.

    Returns:
        The teachers; (S, N) deg/s that they catch at SPEEDS.
    """
    quick, caught = _best(plant, limits, config)
    if config.calm is None:
        return quick, caught
    calm = Teachers(plant, config.calm.weights, config.turns, SPEEDS, limits)
    return CalmTeachers(config.calm, calm, quick, np.radians(caught)), caught


def _best(
    plant: WhipplePlant, limits: np.ndarray, config: ImitationConfig
) -> tuple[Teachers, np.ndarray]:
    """Return for each bicycle and speed the teacher whose weights catch the largest kick.

    Returns:
        The teachers; (S, N) deg/s that they catch.
    """
    candidates = [
        Teachers(plant, weights, config.turns, SPEEDS, limits) for weights in config.teachers
    ]
    in_turns = config.judged_in_turns
    caught = np.array(
        [
            [_largest(plant, teachers, SPEEDS[index], in_turns) for index in JUDGED]
            for teachers in candidates
        ]
    )
    nearest = np.abs(np.arange(len(SPEEDS))[:, None] - np.array(JUDGED)).argmin(axis=1)
    # Equal ones: the first of the list.
    first = PREFERENCE if in_turns else 1.0
    which = np.concatenate([first * caught[:1], caught[1:]]).argmax(axis=0)
    chosen = candidates[0]
    chosen.choose(candidates, which[nearest])
    best = np.take_along_axis(caught, which[None], axis=0)[0]
    levels = [np.interp(SPEEDS, SPEEDS[list(JUDGED)], row) for row in best.T]
    return chosen, np.array(levels).T


def _largest(plant: WhipplePlant, teachers: Teachers, speed: float, in_turns: bool) -> np.ndarray:
    """Return the largest kicks that are caught, (N,) deg/s, by bisection."""
    assert plant.count is not None
    count = plant.count
    yaw_rate = None
    if in_turns:
        yaw_rate = speed / max(TURN_RADIUS, speed**2 / (9.81 * np.tan(TURN_LEAN)))
    trial = _Trial(plant, teachers, np.full(count, speed), yaw_rate)
    low, high = np.zeros(count), np.full(count, LARGEST_KICK)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        good = trial.catches(np.radians(middle))
        low, high = np.where(good, middle, low), np.where(good, high, middle)
    return low


class _Trial:
    """N bicycles that teachers ride straight on or into a steady turn, ready to be kicked."""

    def __init__(
        self,
        plant: WhipplePlant,
        teachers: Teachers,
        speed: np.ndarray,
        yaw_rate: float | None,
    ) -> None:
        """Ride until the kick is due.

        Args:
            plant: the bicycles.
            teachers: who rides them.
            speed: (N,) m/s.
            yaw_rate: rad/s of the wanted heading; None if the heading does not matter.
        """
        self._plant, self._teachers, self._yaw_rate = plant, teachers, yaw_rate
        zero = np.zeros(len(speed))
        self._begin = plant.initial(zero, zero, zero, speed), zero, np.zeros((len(zero), COMMANDS))
        self._upright = np.ones(len(zero), dtype=bool)
        periods = SETTLING if yaw_rate is None else TURNING
        self._begin, self._upright = self._ride(*self._begin, periods)

    def catches(self, kick: np.ndarray) -> np.ndarray:
        """Return whether each kick, (N,) rad/s, is caught, bool (N,)."""
        state, wanted, commands = self._begin
        pushed = self._plant.pushed(state, kick)
        return self._ride(pushed, wanted, commands, CATCHING)[1]

    def _ride(
        self, state: Any, wanted: np.ndarray, commands: np.ndarray, periods: int
    ) -> tuple[tuple[Any, np.ndarray, np.ndarray], np.ndarray]:
        """Ride on; return where that leads, and who was upright all the time, bool (N,)."""
        good, zero = self._upright.copy(), np.zeros(len(wanted))
        for _ in range(periods):
            error = zero if self._yaw_rate is None else wrap_angle(state.heading - wanted)
            torque = self._teachers.act(Seen.of(state, error, commands))
            commands = np.column_stack([torque, commands[:, :-1]])
            state = self._plant.step(state, torque, zero, zero)
            wanted = wanted + (self._yaw_rate or 0.0) * self._plant.time_step
            good &= np.abs(state.lean_angle) < FALL_ANGLE
            good &= np.abs(state.steer_angle) < LARGEST_STEER
        return (state, wanted, commands), good
