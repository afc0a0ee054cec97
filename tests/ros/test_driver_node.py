"""The driver over real DDS, with the simulated microcontroller at the other end of its line."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from bicycle_msgs.msg import BicycleCommand, CommandEcho, DriverState
from conftest import StartNode
from probe import Probe
from std_srvs.srv import SetBool, Trigger

from bicycle_common.node_commands import config_folder
from bicycle_common.nodes import topics
from bicycle_common.parameters import parameters_of
from bicycle_hardware.nodes.driver_settings import DriverSettings

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SENSORS = """
rest: 1.5
imu: {vibration: 0.0}
"""
TORQUE = 0.1
"""N m under which the benchmark bicycle rides in a circle by itself at 4.8 m/s."""


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    probe = Probe(
        ros_domain,
        *(topics.DRIVER_STATE, topics.STATE, topics.IMU, topics.ENCODERS, topics.EPISODE),
        *(topics.COMMAND_ECHO, topics.SENSOR_TIME, topics.DIAGNOSTICS),
    )
    yield probe
    probe.close()


def answer_all(probe: Probe) -> None:
    """Answer each step with a small torque, as a controller would."""
    say = probe.publisher(topics.COMMAND)

    def answer(message: Any) -> None:
        episode, step = map(int, message.source.split())
        command = BicycleCommand(episode=episode, step=step, controller="probe", torque=TORQUE)
        say.publish(command)

    topic = topics.SENSOR_TIME
    probe.node.create_subscription(topic.type, topic.name, answer, topic.subscribe)


def states(probe: Probe) -> list[DriverState]:
    return list(probe[topics.DRIVER_STATE])


def test_nothing_moves_before_arming_and_a_cable_may_be_pulled(
    probe: Probe, start_node: StartNode, tmp_path: Path
) -> None:
    (tmp_path / "mine.yaml").write_text(SENSORS)
    port, sensors = f"port:={tmp_path / 'board'}", f"sensors:={tmp_path / 'mine.yaml'}"
    driver = start_node(
        "bicycle_hardware.nodes.driver_node",
        ["--ros-args", "-p", port, "-p", sensors, "-p", "bicycle:=benchmark"],
    )
    driver.wait_for_line("waits for a microcontroller")
    refused = probe.call(topics.ARM, SetBool.Request(data=True))
    assert not refused.success
    assert "no serial line" in refused.message
    bench_words = ["--ros-args", "-p", port, "-p", sensors, "-p", "plant:=whipple"]
    bench_words += ["-p", "bicycle:=benchmark", "-p", "start_speed:=4.8"]
    bench = start_node("bicycle_hardware.nodes.bench_node", bench_words)
    driver.wait_for_line("listens at")
    probe.spin_until(lambda: probe[topics.SENSOR_TIME])
    refused = probe.call(topics.ARM, SetBool.Request(data=True))
    assert not refused.success
    assert "commands have not come" in refused.message

    answer_all(probe)
    probe.spin_until(lambda: states(probe)[-1].reasons == 0)
    still = states(probe)
    assert {(s.mode, s.torque, s.drive) for s in still} == {(DriverState.MODE_DISARMED, 0.0, 0.0)}
    places = {(s.rear_contact.x, s.rear_contact.y) for s in probe[topics.STATE]}
    assert len(places) == 1
    assert {e.command_source for e in probe[topics.COMMAND_ECHO]} == {0}

    # On a busy machine commands may have a gap, which is a reason to refuse.
    probe.spin_until(lambda: probe.call(topics.ARM, SetBool.Request(data=True)).success)
    riding = DriverState.MODE_RIDING
    probe.spin_until(lambda: any(s.mode == riding for s in states(probe)))
    probe.spin_until(lambda: any(s.torque == pytest.approx(TORQUE) for s in states(probe)))
    driven = {CommandEcho.SOURCE_FRESH, CommandEcho.SOURCE_HELD}
    probe.spin_until(lambda: {e.command_source for e in probe[topics.COMMAND_ECHO]} & driven)
    assert states(probe)[-1].round_trip > 0.0
    assert probe[topics.EPISODE][-1].pace == "realtime"

    probe.spin_until(lambda: probe.call(topics.ESTOP, Trigger.Request()).success)
    probe.spin_until(lambda: states(probe)[-1].mode == DriverState.MODE_ESTOP)
    probe.spin_until(lambda: probe.call(topics.ARM, SetBool.Request(data=False)).success)
    refused = probe.call(topics.ARM, SetBool.Request(data=True))
    assert not refused.success
    assert "the wheel turns" in refused.message
    assert states(probe)[-1].drive == 0.0

    bench.kill()
    driver.wait_for_line("is gone")
    before = len(probe[topics.EPISODE])
    start_node("bicycle_hardware.nodes.bench_node", bench_words)
    probe.spin_until(lambda: len(probe[topics.EPISODE]) > before)
    assert probe[topics.EPISODE][-1].episode == 2
    names = {s.name for array in probe[topics.DIAGNOSTICS] for s in array.status}
    assert {"bicycle_driver: line", "bicycle_driver: board"} <= names
    assert driver.stop(signal.SIGINT) == 0


def test_the_drivers_file_holds_its_defaults() -> None:
    stored = yaml.safe_load((config_folder() / "driver.yaml").read_text())
    defaults = {item.name: item.default for item in parameters_of(DriverSettings)}
    assert stored == {"/**": {"ros__parameters": defaults}}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["baud:=115201"], "parameter baud is 115201"),
        (["bicycle:=nonsuch"], "nonsuch"),
        (["sensors:=nonsuch"], "nonsuch"),
    ],
)
def test_mistakes_are_one_line(start_node: StartNode, words: list[str], said: str) -> None:
    given = [part for word in words for part in ("-p", word)]
    driver = start_node("bicycle_hardware.nodes.driver_node", ["--ros-args", *given])
    assert driver.wait() == 2
    assert said in driver.lines[-1]
    assert "Traceback" not in driver.output
