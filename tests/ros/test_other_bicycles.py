"""The cockpit beside a fleet: it shows all bicycles and steers the chosen one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from chromium import chromium, expect, inside, opened, said, until
from cockpit_page import COCKPIT, Page, address_of
from domains import claimed_domain
from node_process import NodeProcess

from bicycle_cockpit.nodes.other_bicycles import namespaces_of
from bicycle_cockpit.options import parse

pytestmark = [pytest.mark.ros, pytest.mark.slow]

STATE = ["bicycle_msgs/msg/BicycleState"]


def test_bicycles_are_those_with_a_state() -> None:
    topics = [
        ("/b10/bicycle/state", STATE),
        ("/b2/bicycle/state", STATE),
        ("/bicycle/state", STATE),
        ("/b2/bicycle/estimate", STATE),
        ("/strange/bicycle/state", ["std_msgs/msg/String"]),
        ("/yard/b1/bicycle/state", STATE),
    ]
    assert namespaces_of(topics) == ["/", "/b2", "/b10", "/yard/b1"]


@pytest.mark.parametrize(
    ("given", "namespace", "rules"),
    [
        ([], "/", ()),
        (["__ns:=/red"], "/red", ("--ros-args",)),
        (["--ros-args", "-r", "__ns:=red"], "/red", ("--ros-args",)),
        (
            ["--ros-args", "-r", "__ns:=/red", "-r", "__node:=x", "-r", "a:=/b"],
            "/red",
            ("--ros-args", "-r", "a:=/b"),
        ),
    ],
)
def test_a_namespace_on_the_command_line(
    given: list[str], namespace: str, rules: tuple[str, ...], tmp_path: Path
) -> None:
    options = parse(["--no-ride", *given], tmp_path)
    assert (options.namespace, options.rules) == (namespace, rules)


def words(namespace: str, **values: object) -> list[str]:
    given = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    return ["--ros-args", "-r", f"__ns:=/{namespace}", *given]


@pytest.fixture(scope="module")
def fleet() -> Iterator[tuple[str, int]]:
    """Yield the address and the domain of a cockpit beside two bicycles, b1 and b2."""
    with claimed_domain() as domain:
        there = {"ROS_DOMAIN_ID": str(domain)}
        processes: list[NodeProcess] = []
        try:
            for name, y, clock in (("b1", 0.0, "true"), ("b2", 20.0, "false")):
                module = "bicycle_sim.nodes.sim_node"
                given = words(name, start_y=y, publish_clock=clock)
                processes.append(NodeProcess.start(module, given, there))
                module = "bicycle_controller.nodes.controller_node"
                processes.append(NodeProcess.start(module, words(name, policy="lqr"), there))
            command = [str(COCKPIT), "--no-ride", "--port", "0"]
            cockpit = NodeProcess(command, there)
            processes.append(cockpit)
            yield address_of(cockpit), domain
        finally:
            for process in reversed(processes):
                process.kill()


@pytest.fixture
def page(fleet: tuple[str, int]) -> Iterator[Page]:
    """Yield a page of that cockpit, without a browser."""
    result = Page(fleet[0])
    yield result
    result.close()


def shown(page: Page, name: str) -> dict[str, Any]:
    """Return the newest word of the fleet, once a bicycle is the shown one."""
    page.until(lambda: page.newest("fleet")["shown"] == name)
    return page.newest("fleet")


def beside(page: Page, name: str) -> dict[str, Any]:
    """Return a bicycle that is not the shown one, as told last; empty if it is not told."""
    return next((one for one in page.newest("fleet")["others"] if one["name"] == name), {})


def test_all_are_shown_and_the_chosen_one_is_steered(page: Page) -> None:
    page.until(lambda: page.newest("fleet")["names"] == ["/b1", "/b2"])
    shown(page, "/b1")
    other = page.until(lambda: beside(page, "/b2"))
    assert (other["x"], other["y"], other["fallen"]) == (0.0, 20.0, False)
    page.until(lambda: page.rows and page.rows[-1]["y"] == 0.0)

    hellos = sum(message["type"] == "hello" for message in page.heard)
    assert page.ask("bicycle", name="/b2")["ok"]
    shown(page, "/b2")
    page.until(lambda: sum(m["type"] == "hello" for m in page.heard) == hellos + 1)
    page.until(lambda: page.rows[-1]["y"] == 20.0)
    page.until(lambda: page.newest("status")["controllers"] == 1)
    page.have_done("goal", x=25.0, y=20.0)
    page.until(lambda: page.rows[-1]["x"] > 5.0)
    other = page.until(lambda: beside(page, "/b1"))
    assert (other["x"], other["y"]) == (0.0, 0.0), "it has no goal"
    assert not beside(page, "/b2"), "it is the shown one"

    refused = page.ask("bicycle", name="/b3")
    assert not refused["ok"]
    assert "no bicycle '/b3' is heard" in refused["message"]
    assert page.ask("bicycle", name="/b1")["ok"]
    shown(page, "/b1")
    page.until(lambda: page.rows[-1]["y"] == 0.0)
    page.until(lambda: beside(page, "/b2").get("x", 0.0) > 5.0)


def test_the_shown_one_is_told_from_what_others_report(page: Page) -> None:
    page.until(lambda: page.newest("fleet")["names"] == ["/b1", "/b2"])
    page.have_done("bicycle", name="/b1")
    shown(page, "/b1")
    page.have_done("pause", paused=True)
    page.until(lambda: page.newest("status")["paused"])
    assert page.ask("bicycle", name="/b2")["ok"]
    shown(page, "/b2")
    begun = len(page.heard)

    def told() -> list[bool]:
        return [m["paused"] for m in page.heard[begun:] if m["type"] == "status"]

    page.until(lambda: len(told()) >= 12)  # each bicycle reports once in four of them
    assert not any(told()), "/b1 is paused, not this one"
    assert page.ask("bicycle", name="/b1")["ok"]
    shown(page, "/b1")
    page.have_done("pause", paused=False)


def test_the_first_is_shown_even_if_found_last_until_a_page_steers(
    start_node: Callable[..., NodeProcess],
) -> None:
    page = Page(address_of(start_node(COCKPIT, ["--no-ride", "--port", "0"])))

    def simulator(name: str) -> NodeProcess:
        return start_node("bicycle_sim.nodes.sim_node", words(name))

    def in_a_row(mode: str) -> bool:
        told = [m["mode"] for m in list(page.heard) if m["type"] == "status"]
        return told[-8:] == 8 * [mode]  # longer than between two looks for bicycles

    try:
        simulator("b3")
        shown(page, "/b3")
        second = simulator("b2")
        shown(page, "/b2")
        page.until(lambda: in_a_row("held"))
        assert second.stop() == 0
        page.until(lambda: in_a_row("silent"))
        assert page.newest("fleet")["shown"] == "/b2", "it may be started again"

        simulator("b2")
        page.have_done("pause", paused=True)
        simulator("b1")
        page.until(lambda: "/b1" in page.newest("fleet")["names"])
        page.until(lambda: beside(page, "/b1") or page.newest("fleet")["shown"] == "/b1")
        assert page.newest("fleet")["shown"] == "/b2", "a page steers it"
    finally:
        page.close()


def test_a_person_chooses_in_the_browser(fleet: tuple[str, int]) -> None:
    with chromium() as browser, opened(browser, fleet[0]) as page:
        options = page.locator("#bicycle option")
        expect(options).to_have_count(2)
        expect(page.locator("#bicycle-label")).to_be_visible()
        page.locator("#bicycle").select_option("/b2")
        said(page, "^/b2 is shown and steered$")
        until(page, "live.series.length > 0 && live.series.y[live.cursor] > 15")
        until(page, "fleet.others.length > 0")
        assert inside(page, "fleet.others.map(({ name }) => name)") == ["/b1"]
        page.locator("#bicycle").select_option("/b1")
        said(page, "^/b1 is shown and steered$")
        until(page, "live.series.length > 0 && live.series.y[live.cursor] < 5")


def test_a_namespace_holds_for_what_the_cockpit_starts(
    start_node: Callable[..., NodeProcess], ros_domain: int
) -> None:
    cockpit = start_node(COCKPIT, ["--port", "0", "__ns:=/red", "controller.policy:=lqr"])
    page = Page(address_of(cockpit))
    try:
        assert shown(page, "/red")["names"] == ["/red"]
        assert page.newest("hello")["setups"]["ours"]
        page.until(lambda: page.rows and page.newest("status")["controllers"] == 1)
        page.have_done("goal", x=25.0, y=0.0)
        page.until(lambda: page.rows[-1]["x"] > 2.0)
    finally:
        page.close()
