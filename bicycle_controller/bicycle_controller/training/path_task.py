"""Bicycles that learn to follow random roads: N at once, each begun again when it ends."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from bicycle_common.geometry import wrap_angle
from bicycle_controller.control import followers
from bicycle_controller.control.learned_follower import ALONG, NEAR, observe
from bicycle_controller.control.path import Paths
from bicycle_controller.control.path_follower import PathFollower
from bicycle_controller.control.speed_profile import speed_profile
from bicycle_controller.evaluation.course_rides import SLOWEST
from bicycle_controller.evaluation.course_score import random_road
from bicycle_sim.plants.base import FALL_ANGLE, Plant, put

LONGEST = 400
"""Steps of an episode."""
FALL = 20.0
"""Penalty of a fall, and of leaving the path."""
SPEED_LIMITS = (1.0, 8.0)
"""m/s."""
CHANGING = ("observation", "_along", "_steps", "_classical")
"""Arrays of a task that change while it rides."""


class PathTask:
    """N bicycles on random roads.

    Attributes:
        observation: (N, 18), of the present states.
        follower: the classical one, whose torque is the teacher's, and whose pedal rides.
    """

    def __init__(
        self,
        plant: Plant[Any],
        count: int,
        seed: int,
        roads: int = 200,
        torque_limit: float = 2.0,
        speeds: tuple[float, float] = (2.5, 4.0),
    ) -> None:
        """Draw the roads and begin.

        Args:
            plant: the bicycles.
            count: N.
            seed: of roads and starts.
            roads: number of roads.
            torque_limit: N m that an action of 1 is.
            speeds: m/s, bounds of the speed wanted on a road.
        """
        self.plant, self.count, self.limit = plant, count, torque_limit
        self.follower: PathFollower = followers.make("preview", plant, torque_limit)
        self._rng = np.random.default_rng(seed)
        radius = followers.tightest(self.follower)
        paths = [random_road(self._rng, radius / 0.8, 80.0) for _ in range(roads)]
        profiles = [
            speed_profile(road, float(self._rng.uniform(*speeds)), self.follower.sharpest, SLOWEST)
            for road in paths
        ]
        self._paths = Paths(paths, self._rng.integers(roads, size=count))
        self._profile = np.concatenate(profiles)
        self._roads = roads
        self._along = np.zeros(count)
        self._steps = np.zeros(count)
        self._state: Any = None
        self._begin(np.ones(count, dtype=bool))
        self._look()

    def restart(self, rng: np.random.Generator) -> None:
        """Begin all rides again, with starts drawn by `rng` from now on."""
        self._rng = rng
        self._begin(np.ones(self.count, dtype=bool))
        self._look()

    def _begin(self, which: np.ndarray) -> None:
        """Put some bicycles at new places beside their roads."""
        rng, number = self._rng, int(which.sum())
        index = self._paths.index.copy()
        index[which] = rng.integers(self._roads, size=number)
        self._paths.index = index
        here = self._paths.keep(which)
        along = rng.uniform(0.0, 0.6, number) * here.length
        speed = here.values(self._profile, along) + rng.uniform(-0.3, 0.3, number)
        x, y = here.point(along)
        x2, y2 = here.point(along + 0.2)
        psi = np.arctan2(-(x2 - x), y2 - y)
        left, turned = rng.normal(0.0, 0.4, number), rng.normal(0.0, 0.15, number)
        x, y = x - left * np.cos(psi), y - left * np.sin(psi)
        fresh = self.plant.initial(x, y, np.asarray(wrap_angle(psi + turned)), speed)
        if self._state is None:
            self._state = fresh
        else:
            self._state = put(self._state, np.flatnonzero(which), fresh)
        self._along[which], self._steps[which] = along, 0.0

    def _look(self) -> None:
        """Observe the present states."""
        s = self._state
        place = self._paths.locate(self._along, s.rear_x, s.rear_y, s.heading)
        self._along = place.along.copy()
        acceleration = s.lean_acceleration
        self._seen = np.column_stack(
            [s.steer_angle, s.steer_rate, s.lean_angle, s.lean_rate, acceleration, 0.0 * s.rear_x]
        )
        self._place = place
        self.observation = observe(self._seen, s.speed, place, self._paths)
        wanted = self._paths.values(self._profile, place.along + 0.5 * s.speed)
        self._classical = self.follower.act(self._seen, s.speed, place, self._paths, wanted)

    def state_dict(self) -> dict[str, Any]:
        """Return what changes while they ride; the roads are drawn again."""
        own = {name: getattr(self, name) for name in CHANGING}
        index, rng = self._paths.index, self._rng.bit_generator.state
        return {"state": asdict(self._state), "index": index, "rng": rng} | own

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state` of a task of the same seed, to the bit."""
        self._state = self.plant.state_type(**state["state"])
        self._paths.index = state["index"]
        self._rng.bit_generator.state = state["rng"]
        for name in CHANGING:
            setattr(self, name, state[name])

    @property
    def teacher(self) -> np.ndarray:
        """(N,) shares of the largest torque that the classical follower chooses."""
        return np.asarray(self._classical[:, 0] / self.limit)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Ride one period.

        Args:
            action: (N,) shares of the largest torque.

        Returns:
            The observations that it led to, (N, 18); rewards (N,); True where the ride is lost;
            True where it ends. `observation` then has those of the rides begun again.
        """
        torque = self.limit * np.clip(action, -1.0, 1.0)
        pedal = self._classical[:, 2]
        self._state = self.plant.step(
            self._state, torque, np.zeros(self.count), pedal, SPEED_LIMITS
        )
        self._steps += 1
        fallen = self.plant.fallen(self._state, FALL_ANGLE)
        self._look()
        place, share = self._place, np.clip(action, -1.0, 1.0)
        lost = fallen | (np.abs(place.cross_track) > NEAR)
        lost |= np.abs(place.heading_error) > ALONG
        reward = -(10.0 * np.minimum(place.cross_track**2, 1.0) + place.heading_error**2)
        reward -= 0.02 * share**2 + 0.05 * self._state.lean_rate**2
        reward = np.where(lost, reward - FALL, reward)
        done = lost | (self._steps >= LONGEST) | (place.along > self._paths.length - 12.0)
        after = self.observation
        if done.any():
            self._begin(done)
            self._look()
        return after, np.maximum(reward, -FALL - 12.0), lost, done
