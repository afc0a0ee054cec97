"""Fixtures for tests that start real nodes: a domain of their own, processes, no leftovers."""

from __future__ import annotations

import fcntl
import importlib.util
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from domains import claimed_domain, shared_memory
from node_process import NodeProcess, parameters

StartNode = Callable[..., NodeProcess]


@pytest.fixture(scope="session", autouse=True)
def ros_environment() -> None:
    """Fail at once, with the remedy, where the caller has not set up ROS."""
    needed = ("rclpy", "bicycle_msgs")
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        pytest.fail(f"no {' and '.join(missing)} here: source ros2_ws/env.sh or use tests/run.sh")


@pytest.fixture(scope="session", autouse=True)
def ordinary_priority() -> Iterator[None]:
    """Nodes in the test's own process leave its priority alone: children would inherit it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "sched_setscheduler", lambda *_: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """Let programs hear Ctrl-C where whoever started the tests ignores it, as `&` in a script."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def ride() -> list[Any]:
    """Return the messages of a sound ride in one episode; a test changes copies of them."""
    from changed_ride import STEPS
    from ride_bag_maker import Rider

    return list(Rider(seed=3).ride(STEPS))


@pytest.fixture
def signals_as_they_were() -> Iterator[None]:
    """Gives the test's process its handlers back from a program that it calls."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Yield a ROS_DOMAIN_ID that no other test on this machine uses, set in the environment."""
    with claimed_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        yield domain


@pytest.fixture
def start_node(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[StartNode]:
    """Yield a function `(module, args, env) -> NodeProcess` in this test's own domain.

    A `module` with a slash or given as a path is run as a program instead of `python -m`.
    Whatever still runs at the end of the test is killed.
    """
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "roslog"))
    started: list[NodeProcess] = []

    def start(
        module: str | Path, args: Sequence[object] = (), env: Mapping[str, str] | None = None
    ) -> NodeProcess:
        words = [str(arg) for arg in args]
        if "/" in str(module):
            process = NodeProcess([str(module), *words], env)
        else:
            process = NodeProcess.start(str(module), words, env)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()


@pytest.fixture
def start_sim(start_node: StartNode) -> StartNode:
    """Return a function that starts the simulator with parameters and waits until it is ready."""

    def start(**values: object) -> NodeProcess:
        process = start_node("bicycle_sim.nodes.sim_node", parameters(**values))
        process.wait_for_line("episode 1 waits for its first command")
        return process

    return start


@pytest.fixture
def makes_shared_memory() -> Iterator[None]:
    """Allow shared memory in a test that opens DDS beyond loopback."""
    with shared_memory(fcntl.LOCK_EX):
        yield


@pytest.fixture
def no_new_shared_memory() -> Iterator[None]:
    """Fail when the test leaves files of the middleware in /dev/shm."""
    folder = Path("/dev/shm")
    with shared_memory(fcntl.LOCK_SH):
        before = set(folder.glob("*fastrtps*")) if folder.is_dir() else set()
        yield
        after = set(folder.glob("*fastrtps*")) if folder.is_dir() else set()
    assert after <= before, f"left in /dev/shm: {sorted(str(path) for path in after - before)}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with a slow test before all others, so that no worker ends long after the rest.

    pytest hands all tests of the run to this hook, not those of this folder alone.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
