"""Diagnostics of one bicycle among others."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from bicycle_common.nodes.diagnostics import OK, entries_of, status

pytestmark = pytest.mark.ros

NAMES = ("bicycle_sim", "b1/bicycle_sim", "b1/bicycle_controller", "yard/b1/bicycle_sim")


@pytest.mark.parametrize(
    ("namespace", "own"), [("/", NAMES[:1]), ("/b1", NAMES[1:3]), ("/yard/b1", NAMES[3:])]
)
def test_entries_are_those_of_the_namespace(namespace: str, own: tuple[str, ...]) -> None:
    array = DiagnosticArray(status=[status(f"{name}: x", OK, "", {}) for name in NAMES])
    assert [entry.name for entry in entries_of(namespace, array)] == [f"{one}: x" for one in own]
