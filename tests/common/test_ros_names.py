"""Names of nodes and namespaces on a command line."""

from __future__ import annotations

import pytest

from bicycle_common.ros_names import wrong_rule


@pytest.mark.parametrize(
    "words",
    [[], ["__ns:=/"], ["__ns:=/b1"], ["-r", "__ns:=/a/b_2", "__node:=_x9"], ["ns:=ü"], ["/a:=ü"]],
)
def test_what_ros_takes_is_taken(words: list[str]) -> None:
    assert wrong_rule(words) == ""


@pytest.mark.parametrize(
    "name", ["", "b1", "/b1/", "//", "/9", "/ü", "/b 1", "/b\n1", "/" + "x" * 200]
)
def test_what_is_no_namespace_is_told_with_the_remedy(name: str) -> None:
    assert "is no namespace: write / and letters" in wrong_rule(["-r", f"__ns:={name}"])


@pytest.mark.parametrize("name", ["", "/b1", "b/1", "9", "ü", "b 1", "b\n", "x" * 201])
def test_what_is_no_node_s_name_is_told_with_the_remedy(name: str) -> None:
    for rule in ("__node", "__name"):
        assert f"as {rule}:=bicycle" in wrong_rule([f"{rule}:={name}"])
