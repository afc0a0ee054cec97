"""A follower whose torque a network chooses, trained by `bicycle train path-following`.

It sees lean and steering with their rates, the cross-track and heading error, the speed, and the
path's curvature here and in the next 2.5 s. Left and right are mirror images by construction, so
on a straight it rides straight. Far from the path, where it was never trained, the classical
follower joins it; the pedal and the limits on paths are the classical one's, too.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.control.follow_gains import FollowConfig
from bicycle_controller.control.path import Paths, Place
from bicycle_controller.control.path_follower import PathFollower
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant

SHIPPED = FilePath(__file__).parent.parent / "followers" / "browser-rider.npz"
"""The follower named `learned`."""
AHEAD = np.linspace(0.0, 2.5, 11)
"""s ahead, at which the path's curvature is seen."""
SCALE = np.array([0.3, 1.0, 0.3, 0.5, 1.0, 0.5, 1.0, *np.full(len(AHEAD), 0.15)])
"""Size of each number of an observation."""
SPEED = 6
"""Index of the speed, which no mirror changes."""
USUAL_SPEED = 3.0
"""m/s that an observation has as zero."""
NEAR, ALONG = 2.0, 0.8
"""m and rad up to which the network rides."""


def observe(seen: np.ndarray, speed: np.ndarray, place: Place, paths: Paths) -> np.ndarray:
    """Return scaled observations (N, 18).

    Args:
        seen: (N, 6), see `OBSERVATION_FIELDS`; lean acceleration and goal are not used.
        speed: (N,) m/s.
        place: of the N bicycles on their paths.
        paths: the paths.
    """
    coming = place.along[:, None] + np.maximum(speed, 0.1)[:, None] * AHEAD
    columns = [
        *seen.T[:4],
        np.clip(place.cross_track, -NEAR, NEAR),
        np.clip(place.heading_error, -ALONG, ALONG),
        speed - USUAL_SPEED,
        *paths.curvature(coming).T,
    ]
    return np.asarray(np.column_stack(columns) / SCALE)


def mirrored(observation: np.ndarray) -> np.ndarray:
    """Return scaled observations as a mirror shows them."""
    flipped = -observation
    flipped[:, SPEED] = observation[:, SPEED]
    return np.asarray(flipped)


@dataclass(frozen=True)
class Network:
    """A network with hidden layers of tanh; its answer is odd, the mirror image's is the other."""

    weights: tuple[np.ndarray, ...]
    """(in, out) of each layer."""
    biases: tuple[np.ndarray, ...]
    """(out,) of each layer."""
    plant: str
    """JSON of the bicycle that it was trained on."""
    about: str
    """JSON: command, commit, processor, seed, steps."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return (N,) shares of the largest torque, -1 to 1."""
        both = np.concatenate([observation, mirrored(observation)])
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            both = np.tanh(both @ weight + bias)
        raw = (both @ self.weights[-1] + self.biases[-1])[:, 0]
        count = len(observation)
        return np.asarray(np.tanh(0.5 * (raw[:count] - raw[count:])))

    def save(self, file: FilePath) -> None:
        """Write it."""
        held: dict[str, Any] = {f"weight_{i}": value for i, value in enumerate(self.weights)}
        held |= {f"bias_{i}": value for i, value in enumerate(self.biases)}
        held |= {"plant": np.array(self.plant), "about": np.array(self.about)}
        np.savez(file, **held)

    @classmethod
    def load(cls, file: FilePath) -> Network:
        """Read it.

        Raises:
            ValueError: if the file holds none.
        """
        try:
            with np.load(file, allow_pickle=False) as held:
                count = sum(name.startswith("weight_") for name in held.files)
                weights = tuple(held[f"weight_{i}"] for i in range(count))
                biases = tuple(held[f"bias_{i}"] for i in range(count))
                follower = cls(weights, biases, str(held["plant"]), str(held["about"]))
        except (OSError, ValueError, KeyError, EOFError) as error:
            reason = error.strerror if isinstance(error, OSError) else None
            raise ValueError(f"{file} holds no follower: {reason or error}") from None
        shapes = [weight.shape for weight in follower.weights]
        fits = bool(shapes) and shapes[0][0] == len(SCALE) and shapes[-1][1] == 1
        require(fits, f"{file} holds no follower: it must take {len(SCALE)} numbers")
        return follower


class LearnedFollower(PathFollower):
    """Rides near the path by a network, and joins it from afar as the classical follower does."""

    room = 1.0
    """A network is trusted with no more than the limit."""

    def __init__(
        self, plant: Plant[Any], config: FollowConfig | None = None, network: Network | None = None
    ) -> None:
        """Load the network; the shipped one by default.

        Raises:
            ValueError: if it was trained on another bicycle.
        """
        super().__init__(plant, config)
        self.network = network or Network.load(SHIPPED)
        require(
            registry.from_json(self.network.plant) == plant,
            "this learned follower was trained on another bicycle: choose the follower preview, "
            "or train one with bicycle train path-following",
        )

    @property
    def policy_id(self) -> str:
        """`learned-follow-` and a digest of the weights."""
        digest = hashlib.sha256(b"".join(w.tobytes() for w in self.network.weights))
        return "learned-follow-" + digest.hexdigest()[:8]

    def act(
        self,
        observation: np.ndarray,
        speed: np.ndarray,
        place: Place,
        paths: Paths,
        wanted_speed: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the action of each bicycle; see `PathFollower.act`."""
        action = super().act(observation, speed, place, paths, wanted_speed)
        near = (np.abs(place.cross_track) < NEAR) & (np.abs(place.heading_error) < ALONG)
        if near.any():
            chosen = self.network.act(observe(observation, speed, place, paths))
            torque = self.config.torque_limit * chosen
            action[:, 0] = np.where(near, torque, action[:, 0])
        return action
