"""`fleet.sh`: two bicycles ride crossing routes and keep clear of one another."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess

pytestmark = [
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.usefixtures("no_new_shared_memory"),
]


def test_two_ride_their_routes(
    start_node: Callable[..., NodeProcess], ros_domain: int, tmp_path: Path
) -> None:
    folder = tmp_path / "fleet"
    # Slow, so that no period is dropped on a busy machine: the rule holds for steady clocks.
    words = ["2", "--output", str(folder), "simulator.real_time_factor:=0.5"]
    fleet = start_node("bicycle_bringup.nodes.fleet", words)
    assert fleet.wait(240.0) == 0, fleet.lines
    assert "2 of 2 rode their routes to the end" in "\n".join(fleet.lines)
    found = json.loads((folder / "fleet.json").read_text())
    assert found["finished"] == 2
    assert found["nearest_m"] > 1.4
    assert all(one["steps"] > 100 for one in found["bicycles"].values())


@pytest.mark.parametrize(
    ("words", "remedy"),
    [(["0"], "choose 1 to 20"), (["2", "sim.plant:=choi"], "names no node")],
)
def test_bad_arguments(
    start_node: Callable[..., NodeProcess], words: list[str], remedy: str
) -> None:
    fleet = start_node("bicycle_bringup.nodes.fleet", words)
    assert fleet.wait(60.0) == 2
    assert remedy in fleet.lines[-1]
