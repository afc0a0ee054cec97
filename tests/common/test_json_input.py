"""JSON of others, nested as deeply as a file can be: every reader says so in one line."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bicycle_common import json_input
from bicycle_controller.nodes.setup import Setup
from bicycle_sim.plants import registry
from bicycle_sim.plants.choi.parameters import Physics
from bicycle_sim.task.scenario import Scenario
from bicycle_tools.report_page.explorer import _radius
from bicycle_tools.report_page.tables import _plain, _switches

DEEP = "[" * 100_000
READERS = (json_input.parse, Scenario.from_json, registry.from_json, Physics.from_json)


@pytest.mark.parametrize("read", [*READERS, Setup.from_json], ids=lambda read: read.__qualname__)
@pytest.mark.parametrize("text", [DEEP, f'{{"a": {DEEP}', "9" * 5000, "", "{"])
def test_what_cannot_be_read_is_a_value_error(read: Callable[[str], object], text: str) -> None:
    with pytest.raises(ValueError, match=r".") as error:
        read(text)
    assert "\n" not in str(error.value)


def test_a_report_shows_a_text_that_it_cannot_read_as_it_is() -> None:
    assert _plain(DEEP) == _switches(DEEP) == DEEP
    assert _radius({"scenario": [DEEP, '{"goal_radius": 2.0}']}) == 2.0  # type: ignore[dict-item]


def test_what_can_be_read_is() -> None:
    assert json_input.parse('{"a": [1, 2.5, null]}') == {"a": [1, 2.5, None]}
