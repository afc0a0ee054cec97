"""The messages of a bag from which its estimates and commands can be computed again."""

from __future__ import annotations

import bisect
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from bicycle_msgs.msg import BicycleCommand, BicycleState, CommandEcho, EpisodeInfo
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu, JointState, NavSatFix
from std_msgs.msg import String

from bicycle_bag.errors import BagError
from bicycle_bag.versions import TodaysReader
from bicycle_common import topic_names
from bicycle_common.nodes import topics
from bicycle_controller.estimation.order import InOrder
from bicycle_controller.nodes.setup import Setup
from bicycle_sim.nodes import sensor_messages
from bicycle_sim.sensors.reading import Reading
from bicycle_sim.sensors.settings import SensorSettings
from bicycle_tools.ride_log import COMMAND, ECHO, EPISODE, STATE, prefix_of

ESTIMATE = topic_names.in_bag(topic_names.ESTIMATE)
SETUP = topic_names.in_bag(topic_names.CONTROLLER_SETUP)
DRIVER = topic_names.in_bag(topic_names.DRIVER_STATE)
IMU = topic_names.in_bag(topic_names.IMU)
ENCODERS = topic_names.in_bag(topic_names.ENCODERS)
FIX = topic_names.in_bag(topic_names.GNSS_FIX)
VELOCITY = topic_names.in_bag(topic_names.GNSS_VELOCITY)
KINDS: dict[str, Any] = {
    SETUP: String,
    EPISODE: EpisodeInfo,
    COMMAND: BicycleCommand,
    ECHO: CommandEcho,
    IMU: Imu,
    ENCODERS: JointState,
    FIX: NavSatFix,
    VELOCITY: topics.GNSS_VELOCITY.type,
    ESTIMATE: BicycleState,
    STATE: BicycleState,
}


class Readings:
    """The readings of a bag that an estimator takes, by sensor in the order of their stamps.

    A clock that is set back, as at the start of a simulator or when a driver learns a board's
    time, begins another run of readings: an estimator forgets those before.
    """

    def __init__(self) -> None:
        self._in_order = InOrder()
        self._runs: dict[str, list[list[Reading]]] = defaultdict(list)
        self._stamps: dict[str, list[list[float]]] = defaultdict(list)

    def add(self, reading: Reading) -> None:
        """Add a reading, each sensor's in the order in which they were recorded."""
        runs, stamps = self._runs[reading.sensor], self._stamps[reading.sensor]
        if not runs or self._in_order.begins_anew(reading):
            runs.append([])
            stamps.append([])
        if self._in_order.takes(reading):
            runs[-1].append(reading)
            stamps[-1].append(reading.stamp)

    def between(self, sensor: str, after: float, until: float, run: int = 0) -> Sequence[Reading]:
        """Return the readings of a run with a stamp above `after` and up to `until`, s."""
        if run >= len(self._runs[sensor]):
            return ()
        stamps = self._stamps[sensor][run]
        low, high = bisect.bisect_right(stamps, after), bisect.bisect_right(stamps, until)
        return self._runs[sensor][run][low:high] if high > low else ()

    def run_with(self, sensor: str, stamp: float, begin: int) -> int:
        """Return the first run from `begin` on that has a reading with this stamp, or the last."""
        runs = self._stamps[sensor]
        for run in range(begin, len(runs)):
            index = bisect.bisect_left(runs[run], stamp)
            if index < len(runs[run]) and runs[run][index] == stamp:
                return run
        return max(len(runs) - 1, 0)


@dataclass
class Sensed:
    """The messages that this verification needs."""

    estimates: list[tuple[int, BicycleState]] = field(default_factory=list)
    """Place in the recorded order, and message; so below."""
    setups: list[tuple[int, Setup]] = field(default_factory=list)
    episodes: list[tuple[int, EpisodeInfo]] = field(default_factory=list)
    commands: dict[tuple[int, int], list[BicycleCommand]] = field(
        default_factory=lambda: defaultdict(list)
    )
    echoes: dict[tuple[int, int], CommandEcho] = field(default_factory=dict)
    imu: list[Imu] = field(default_factory=list)
    encoders: list[JointState] = field(default_factory=list)
    fixes: list[NavSatFix] = field(default_factory=list)
    velocities: dict[tuple[int, int], Any] = field(default_factory=dict)


def has_estimates(reader: TodaysReader) -> bool:
    """Return True if a bag tells all that makes estimates."""
    prefix = prefix_of(reader)
    needed = (SETUP, IMU, ENCODERS, EPISODE)
    return all(prefix + name in reader.topics for name in needed)


def is_hardware(reader: TodaysReader) -> bool:
    """Return True if a microcontroller moved the bicycle: no simulator makes its states again."""
    return prefix_of(reader) + DRIVER in reader.topics


def read(reader: TodaysReader) -> Sensed:
    """Read the messages that are needed.

    Raises:
        BagError: if the bag cannot be read or holds something else under these names.
    """
    prefix = prefix_of(reader)
    kinds = {prefix + name: kind for name, kind in KINDS.items() if prefix + name in reader.topics}
    found = Sensed()
    for place, item in enumerate(reader.messages(list(kinds))):
        try:
            message = deserialize_message(item.data, kinds[item.topic])
            _keep(found, item.topic.removeprefix(prefix), place, message)
        except Exception as error:  # the middleware's errors have no common base class
            raise BagError(
                f"{reader.path} holds a message of {item.topic} that cannot be read "
                f"({' '.join(str(error).split())[:100]}): was it recorded by another release?"
            ) from None
    return found


def _keep(found: Sensed, topic: str, place: int, message: Any) -> None:
    if topic == SETUP:
        found.setups.append((place, Setup.from_json(message.data)))
    elif topic == EPISODE:
        found.episodes.append((place, message))
    elif topic == COMMAND:
        found.commands[message.episode, message.step].append(message)
    elif topic == ECHO:
        found.echoes.setdefault((message.episode, message.step), message)
    elif topic == IMU:
        found.imu.append(message)
    elif topic == ENCODERS:
        found.encoders.append(message)
    elif topic == FIX:
        found.fixes.append(message)
    elif topic == VELOCITY:
        found.velocities[_stamp(message)] = message
    elif message.estimated:
        found.estimates.append((place, message))


def _stamp(message: Any) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec


def readings_of(sensed: Sensed, sensors: SensorSettings) -> Readings:
    """Return the sensors' readings, in order."""
    found = Readings()
    for imu in sensed.imu:
        found.add(sensor_messages.from_imu(imu))
    for encoders in sensed.encoders:
        for reading in sensor_messages.from_encoders(encoders):
            found.add(reading)
    for fix in sensed.fixes:
        velocity = sensed.velocities.get(_stamp(fix))
        if velocity is not None:
            found.add(sensor_messages.from_gnss(fix, velocity, sensors))
    return found
