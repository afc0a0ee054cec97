"""Simulator on one host, controller on another, and a cable that is cut, healed and made worse."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from node_process import NodeProcess
from two_hosts import Cable, Host, command_ages, forbidden
from waiting import until

from bicycle_bag import columns
from bicycle_bag.reader import BagReader

pytestmark = [
    pytest.mark.ros,
    pytest.mark.usefixtures("makes_shared_memory"),
    pytest.mark.slow,
    pytest.mark.skipif(bool(forbidden()), reason=forbidden() or "never"),
]

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
FAR = ("5000", "0")
DELAY = 0.03
Start = Callable[..., NodeProcess]


@pytest.fixture
def hosts() -> Iterator[tuple[Host, Host, Cable]]:
    left, right = Host("left", "10.77.0.1/24"), Host("right", "10.77.0.2/24")
    cable = Cable(left, right)
    yield left, right, cable
    cable.close()
    left.close()
    right.close()


@pytest.fixture
def start(
    hosts: tuple[Host, Host, Cable],
    ros_domain: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Start]:
    """Start a script on a host, in LAN mode unless told otherwise; all end before the hosts do."""
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "roslog"))
    started: list[NodeProcess] = []

    def on(host: Host, script: str, *words: object, network: str = "lan") -> NodeProcess:
        command = (WORKSPACE / f"{script}.sh", *words)
        started.append(host.start(*command, env={"BICYCLE_NETWORK": network}))
        return started[-1]

    yield on
    for process in started:
        process.kill()


def wait_for(process: NodeProcess, text: str, times: int) -> None:
    """Wait until so many lines hold a text."""
    until(lambda: sum(text in line for line in process.lines) >= times)


def test_a_ride_goes_on_when_the_cable_is_healed_and_over_a_bad_one(
    hosts: tuple[Host, Host, Cable], start: Start, tmp_path: Path
) -> None:
    left, right, cable = hosts
    simulator = start(left, "sim", "on_timeout:=pause")
    recorder = start(left, "record", "--output", tmp_path / "bag")
    start(right, "controller", "policy:=lqr").wait_for_line("waits for a goal")
    recorder.wait_for_line("recording /bicycle/command")
    goal = start(right, "goal", *FAR)
    assert goal.wait() == 0, goal.output
    for number in (1, 2):
        time.sleep(1.0)
        cable.cut()
        wait_for(simulator, "no valid command for 0.25 s", number)
        time.sleep(0.5)
        cable.heal()
        wait_for(simulator, "commands again at step", number)
    time.sleep(1.0)
    cable.set(delay=DELAY, jitter=0.1 * DELAY, loss=0.02)
    time.sleep(5.0)
    assert recorder.stop() == 0, recorder.output

    bag = BagReader(tmp_path / "bag")
    states = columns.load(bag, "/bicycle/state")
    steps, first = np.unique(states["step"], return_index=True)
    assert list(steps) == list(range(steps[0], steps[-1] + 1))
    assert not states["fallen"].any()
    # The watchdog's 0.25 s are ten steps; a bicycle that it holds makes none.
    heard = columns.load(bag, "/bicycle/command")["log_time"]
    state_times = states["log_time"][first]
    silences = np.flatnonzero(np.diff(heard) > 0.5)[:2]
    assert len(silences) == 2
    for at in silences:
        ridden = np.count_nonzero((state_times > heard[at]) & (state_times < heard[at + 1]))
        assert 1 <= ridden <= 11
    ages = command_ages(bag)
    assert np.median(ages[: silences[0]]) < 2 * DELAY <= np.median(ages[-40:]) < 0.25


def test_nothing_leaves_a_host_in_local_mode(
    hosts: tuple[Host, Host, Cable], start: Start
) -> None:
    left, right, cable = hosts
    start(left, "sim", network="local").wait_for_line("waits for its first command")
    start(left, "controller", "policy:=lqr", network="local").wait_for_line("waits for a goal")
    goal = start(left, "goal", *FAR, network="local")
    assert goal.wait() == 0, goal.output
    foreign = start(right, "topic", "list")
    assert foreign.wait() == 0
    assert "/bicycle/state" not in foreign.output
    assert cable.set()["ipv4"][0] == 0
    assert cable.set()["ipv4"][1] > 0  # the other host, in LAN mode, did ask around
    open_to_all = start(left, "topic", "list")
    assert open_to_all.wait() == 0
    assert cable.set()["ipv4"][0] > 0
