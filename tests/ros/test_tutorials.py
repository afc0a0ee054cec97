"""The tutorials as a reader types them: every command, in the page's order, in a fresh folder.

Nothing is prepared that the page does not prepare itself. Training and scoring are made shorter by
words of their own, which stand below; a command that keeps its terminal is left running, as the
page says, until `stop.sh` ends it.
"""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path

import pytest
from node_process import NodeProcess
from printed import run_printed

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = sorted(path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md"))
FOREVER = {
    "./ros2_ws/sim.sh": "waits for its first command|waits for",
    "./ros2_ws/controller.sh": "waits for",
    "./ros2_ws/record.sh": "recording /bicycle/command",
}
"""Commands that keep their terminal, and a line after which the next one is typed."""
TRAINED = "--quiet --set evaluation.episodes=8 --set evaluation.near_episodes=8"
SHORTER = {
    "bicycle train": f"--steps 12800 --set evaluation.every=20 {TRAINED}",
    r"bicycle learn \S+ --out": f"--updates 40 --set evaluation.every=20 {TRAINED}",
    "bicycle evaluate": "--episodes 4",
    "bicycle sensing": "--episodes 4 --duration 4 --bicycles browser-rider",
    r"\./ros2_ws/ride.sh --minutes": "--minutes 2.2",
    r"\./ros2_ws/ride.sh --goals": "--goals 1 controller.policy:=lqr",
}
"""Beginnings of commands, and the words that make them shorter; the last of an option holds."""
MISSED_GOAL = 4
STATUSES = {r"\./ros2_ws/ride.sh --minutes": (0, MISSED_GOAL)}
"""Commands that may end otherwise than with 0. A ride for its recording misses a goal
now and then: a bicycle in lock-step has ridden on when the next goal comes from a busy machine."""
SETUP = "./ros2_ws/setup.sh"


def commands(name: str) -> list[str]:
    """Return the commands of a tutorial; one with a here-document is several lines."""
    text = (ROOT / "docs" / "tutorials" / f"{name}.md").read_text(encoding="utf-8")
    found: list[str] = []
    for block in re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        inside = ""
        for line in block.splitlines():
            if inside:
                found[-1] += f"\n{line}"
                inside = "" if line == inside else inside
                continue
            word = re.search(r"<<'(\w+)'$", line)
            inside = word[1] if word else ""
            command = line if inside else line.partition(" #")[0].strip()
            if command:
                found.append(command)
    return found


def shortened(command: str) -> str:
    more = next((words for start, words in SHORTER.items() if re.match(start, command)), "")
    return f"{command} {more}".strip()


@pytest.mark.parametrize("name", TUTORIALS)
def test_a_tutorial_leads_where_it_says(name: str, tmp_path: Path, ros_domain: int) -> None:
    for entry in ("ros2_ws", "docs"):
        (tmp_path / entry).symlink_to(ROOT / entry)
    found = commands(name)
    assert len(found) > 3
    assert found[0].startswith(SETUP), "a reader may begin with this page"
    with ExitStack() as running:
        terminals: list[NodeProcess] = []
        for command in found:
            if command.startswith(SETUP):
                continue  # the tests run in what it has made
            line = next((said for start, said in FOREVER.items() if command.startswith(start)), "")
            if line:
                words = ["bash", "-c", f"exec {command}"]
                process = running.enter_context(NodeProcess(words, cwd=tmp_path))
                process.wait_for_line(line)
                terminals.append(process)
                continue
            expected = next(
                (some for start, some in STATUSES.items() if re.match(start, command)), (0,)
            )
            run_printed(shortened(command), tmp_path, statuses=expected)
            if command == "./ros2_ws/stop.sh":
                for process in terminals:
                    assert process.wait() == 0, process.output
                terminals.clear()
        assert not terminals, "a tutorial ends what it started"
