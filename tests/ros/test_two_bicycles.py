"""Two bicycles in namespaces of one domain: orders by action, frames, and a crossing."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from node_process import NodeProcess
from probe import Probe
from waiting import PATIENCE

from bicycle_common.nodes import topics
from bicycle_tools.nodes import commander
from bicycle_tools.nodes.commander import BicycleCommander

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]


def words(namespace: str, **values: object) -> list[str]:
    given = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    return ["--ros-args", "-r", f"__ns:=/{namespace}", *given]


def has_heard(probe: Probe) -> bool:
    return bool(probe[topics.STATE] and probe[topics.ODOMETRY])


@pytest.mark.parametrize(("by", "apart"), [("paths", 1.4), ("goals", 1.0)])
def test_two_bicycles_cross_and_keep_clear(
    by: str,
    apart: float,
    start_node: Callable[..., NodeProcess],
    ros_domain: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(commander, "READY", PATIENCE)
    starts = {"b1": (-30.0, 0.0, 0.0), "b2": (0.0, -30.0, math.pi / 2)}
    for name, (x, y, yaw) in starts.items():
        start_node(
            "bicycle_sim.nodes.sim_node",
            words(
                name,
                scenario="learned-speed",
                start_speed=3.0,
                start_x=x,
                start_y=y,
                start_yaw=yaw,
                publish_clock="false",
            ),
        ).wait_for_line("episode 1 waits")
        other = "b2" if name == "b1" else "b1"
        start_node(
            "bicycle_controller.nodes.controller_node",
            words(name, policy="lqr-pedal", keep_clear=other),
        ).wait_for_line("waits for a goal")
    heard: dict[str, Any] = {}
    probes = [Probe(ros_domain, topics.STATE, topics.ODOMETRY, namespace=n) for n in starts]
    orders = [BicycleCommander(f"/{name}") for name in starts]
    try:
        for probe in probes:
            probe.spin_until(partial(has_heard, probe))
        if by == "paths":
            orders[0].follow_path([(-30.0, 0.0), (25.0, 0.0)], speed=3.0)
            orders[1].follow_path([(0.0, -30.0), (0.0, 25.0)], speed=3.0)
        else:
            orders[0].ride_to(25.0, 0.0)
            orders[1].ride_to(0.0, 25.0)
        least = math.inf
        while not all(order.done for order in orders):
            for probe, name in zip(probes, starts, strict=True):
                probe.executor.spin_once(timeout_sec=0.01)
                heard[name] = probe[topics.STATE][-1].rear_contact
            one, two = heard["b1"], heard["b2"]
            least = min(least, math.hypot(one.x - two.x, one.y - two.y))
        for order in orders:
            outcome = order.wait(timeout=PATIENCE)
            assert outcome.reached, outcome.message
        assert least > apart
        frames = {probe[topics.ODOMETRY][-1].header.frame_id for probe in probes}
        assert frames == {"b1/odom", "b2/odom"}
    finally:
        for order in orders:
            order.close()
        for probe in probes:
            probe.close()
