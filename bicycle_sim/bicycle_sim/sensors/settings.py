"""Properties of a bicycle's sensors, in plain numbers; presets by name.

Positions are in m from the rear contact of the upright bicycle: x forward, y left, z up. Angles of
a mounting are roll, pitch and yaw (REP-103) in degrees, as people write them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

from bicycle_common.named_files import NamedFiles, parsed
from bicycle_common.validation import reject_unknown, require, require_between, require_positive

Kind = TypeVar("Kind", bound="Sampled")

NEVER = 1e9
"""s, a time that no ride reaches."""

FASTEST_RATE = 1000.0
"""Hz."""


@dataclass(frozen=True)
class Sampled:
    """Times of a sensor's measurements, and of the arrival of its readings.

    Raises:
        ValueError: on a value that makes no sense.
    """

    rate: float = 100.0
    """Hz; 0 means no such sensor."""
    latency: float = 0.0
    """s from the time stamp to the arrival."""
    jitter: float = 0.0
    """s, standard deviation of a delay added to the latency, never negative."""
    age: float = 0.0
    """s from the instant that is measured to the time stamp, as a filter in the sensor makes."""
    dropout: float = 0.0
    """Share of the readings that never arrive."""
    stuck_from: float = NEVER
    """s of the sensor's clock from which on it repeats its last value."""
    gone_from: float = NEVER
    """s of the sensor's clock after which no reading arrives."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(item.default, tuple):
                three = isinstance(value, tuple) and len(value) == len(item.default)
                require(three, f"{item.name} must be a list of 3 numbers, not {value!r}")
            for number in value if isinstance(item.default, tuple) else (value,):
                if isinstance(number, bool) or not isinstance(number, (int, float)):
                    raise ValueError(f"{item.name} must be a number, not {number!r}")
                require(math.isfinite(number), f"{item.name} must be finite, not {number!r}")
                signed = item.name in SIGNED
                require(signed or number >= 0, f"{item.name} must be zero or more, not {number!r}")
        require(self.rate <= FASTEST_RATE, f"rate must be at most {FASTEST_RATE:g} Hz")
        require(self.dropout < 1.0, "dropout must be below 1: a rate of 0 is no sensor")
        require(max(self.latency, self.age) <= 1.0, "latency and age must be at most 1 s")


SIGNED = ("position", "mounting", "offset", "latitude", "longitude")
"""Settings that may be below zero."""


@dataclass(frozen=True)
class ImuSettings(Sampled):
    """Three gyros and three accelerometers on the rear frame.

    The noise is that of an MPU-6050 at rest (robot bicycle, 12,024 samples at 200 Hz): 0.0021
    rad/s and, at 16,384 steps per g, 60 steps; its bias was up to 0.12 rad/s.
    """

    position: tuple[float, ...] = (0.4, 0.0, 0.6)
    """m."""
    mounting: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Degrees, of the sensor's axes against the frame's."""
    misalignment: float = 0.0
    """Degrees, standard deviation of an unknown further turn about each axis."""
    gyro_noise: float = 1.5e-4
    """rad/s per root Hz."""
    gyro_bias: float = 0.05
    """rad/s, standard deviation of the bias at the start."""
    gyro_walk: float = 2e-5
    """rad/s per root s, of the bias's random walk."""
    gyro_range: float = 4.36
    """rad/s, 250 degrees per s."""
    gyro_step: float = 1.33e-4
    """rad/s of one digit."""
    accelerometer_noise: float = 2.6e-3
    """m/s^2 per root Hz."""
    accelerometer_bias: float = 0.1
    """m/s^2, standard deviation of the bias at the start."""
    accelerometer_walk: float = 1e-4
    """m/s^2 per root s."""
    accelerometer_range: float = 19.6
    """m/s^2, 2 g."""
    accelerometer_step: float = 6e-4
    """m/s^2 of one digit."""
    vibration: float = 0.3
    """m/s^2, standard deviation at each sample of the road's vibration, while the bicycle rolls.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("gyro_range", self.gyro_range)
        require_positive("accelerometer_range", self.accelerometer_range)


@dataclass(frozen=True)
class SteerSettings(Sampled):
    """An absolute encoder on the steering axis, and the torque that its motor reports."""

    counts: float = 8192.0
    """Steps per turn; 0 is no quantum."""
    noise: float = 0.0
    """rad, standard deviation."""
    offset: float = 0.0
    """rad, standard deviation of an error of the zero."""
    torque_noise: float = 0.05
    """N m, standard deviation of the reported torque."""


@dataclass(frozen=True)
class WheelSettings(Sampled):
    """A rear wheel's encoder whose speed is a count over a time."""

    ticks: float = 192.0
    """Per turn; 0 is no quantum."""
    average: float = 0.2
    """s over which the ticks are counted."""
    scale: float = 0.0
    """Standard deviation of a relative error of the radius."""


@dataclass(frozen=True)
class GnssSettings(Sampled):
    """A receiver of satellites; none with rate 0."""

    position: tuple[float, ...] = (0.3, 0.0, 1.0)
    """m, the antenna."""
    noise: float = 0.02
    """m, standard deviation of each fix, horizontally."""
    wander: float = 0.0
    """m, standard deviation of an error that lasts."""
    wander_time: float = 60.0
    """s that it lasts."""
    velocity_noise: float = 0.05
    """m/s."""
    latitude: float = 52.0
    """Degrees, of the origin of the map."""
    longitude: float = 4.37
    """Degrees."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between("latitude", self.latitude, -89.0, 89.0)
        require_between("longitude", self.longitude, -180.0, 180.0)


@dataclass(frozen=True)
class SensorSettings:
    """All sensors of a bicycle."""

    imu: ImuSettings
    steer: SteerSettings
    wheel: WheelSettings
    gnss: GnssSettings
    name: str = ""
    about: str = ""
    rest: float = 5.0
    """s for which the bicycle stands still, held upright, before each ride."""

    def __post_init__(self) -> None:
        good = isinstance(self.rest, (int, float)) and 0.0 <= self.rest <= 60.0
        require(good, f"rest must be 0 to 60 s, not {self.rest!r}")

    def to_dict(self) -> dict[str, Any]:
        """Plain data, from which `from_dict` makes the same."""
        return asdict(self)


PARTS: dict[str, type[Sampled]] = {
    "imu": ImuSettings,
    "steer": SteerSettings,
    "wheel": WheelSettings,
    "gnss": GnssSettings,
}


FILES = NamedFiles("bicycle_sim.sensors", "presets", "sensors")


def names() -> list[str]:
    """Return the presets that come with the package."""
    return FILES.names()


def load(name_or_file: str | Path) -> SensorSettings:
    """Return the sensors of a preset's name, or of a YAML file.

    Raises:
        ValueError: when there is none, or on an unknown key or a value that makes no sense; one
            line that names it.
    """
    return _read(*FILES.find(name_or_file))


def _read(text: str, name: str, place: str) -> SensorSettings:
    data = parsed(text, place)
    try:
        require(isinstance(data, dict), "sensors must be a mapping of names to values")
        return from_dict({"name": name, **data})
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


def from_dict(data: Mapping[str, Any]) -> SensorSettings:
    """Return sensors from plain data; omitted values are the classes' defaults, but without GNSS.

    Raises:
        ValueError: on an unknown key, or on a value that makes no sense.
    """
    reject_unknown(SensorSettings, dict(data))
    parts: dict[str, Any] = {name: _part(kind, data.get(name)) for name, kind in PARTS.items()}
    if data.get("gnss") is None:
        parts["gnss"] = GnssSettings(rate=0.0)
    others = {name: value for name, value in data.items() if name not in PARTS}
    return SensorSettings(**parts, **others)


def _part(kind: type[Kind], data: object) -> Kind:
    values = {} if data is None else data
    if not isinstance(values, Mapping):
        raise ValueError(f"{kind.__name__} must be a mapping, not {type(values).__name__}")
    reject_unknown(kind, dict(values))
    plain: dict[str, Any] = {
        name: tuple(value) if isinstance(value, (list, tuple)) else value
        for name, value in values.items()
    }
    return kind(**plain)
