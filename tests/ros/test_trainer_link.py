"""The learning process and the node that started it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from node_process import alive
from waiting import until

pytestmark = pytest.mark.ros

PROGRAM = """
import multiprocessing, os, time
from bicycle_common.processes import end_with_spawner

def learn():
    end_with_spawner()
    print(os.getpid(), flush=True)
    time.sleep(3600.0)

if __name__ == "__main__":
    child = multiprocessing.get_context("spawn").Process(target=learn)
    child.start()
    child.join()
"""


def test_it_ends_with_a_killed_parent_whatever_it_does(tmp_path: Path) -> None:
    """Asleep it asks nobody whether the parent lives, as while it loads torch."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    parent = subprocess.Popen([sys.executable, str(program)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert alive(child)
    parent.kill()
    parent.wait()
    until(lambda: not alive(child))
