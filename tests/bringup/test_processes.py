"""Child processes: logs, ends, and none left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from bicycle_bringup.processes import Child, Exit

STUBBORN = (
    "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(60)"
)


def child(tmp_path: Path, program: str, registry: Path | None = None) -> Child:
    return Child("node", [sys.executable, "-c", program], tmp_path / "node.log", registry)


def until(condition: object, seconds: float = 10.0) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def test_an_end_is_told_as_a_person_would() -> None:
    assert str(Exit("controller", 3)) == "controller exited with status 3"
    assert str(Exit("controller", -9)) == "controller was killed by SIGKILL"


def test_output_goes_to_the_log_and_the_status_is_kept(tmp_path: Path) -> None:
    made = child(tmp_path, "import sys; print('one'); print('two', file=sys.stderr); sys.exit(5)")
    assert made.ended() is None
    made.start()
    assert until(lambda: made.ended() is not None)
    assert made.ended() == Exit("node", 5)
    assert sorted(made.last_lines()) == ["one", "two"]


def test_a_restart_adds_to_the_log(tmp_path: Path) -> None:
    made = child(tmp_path, "print('here')")
    for _ in range(2):
        made.start()
        assert until(lambda: made.ended() is not None)
    assert made.last_lines() == ["here", "here"]


def test_it_is_noted_for_stop_while_it_runs(tmp_path: Path) -> None:
    made = child(tmp_path, "import time; time.sleep(60)", tmp_path / "pids")
    made.start()
    (note,) = (tmp_path / "pids").iterdir()
    pid = int(note.name.removeprefix("node."))
    assert os.getsid(pid) == pid != os.getsid(0)
    assert note.read_text().strip().isdigit()
    made.stop()
    assert list((tmp_path / "pids").iterdir()) == []


def test_who_ignores_signals_is_killed(tmp_path: Path) -> None:
    made = child(tmp_path, STUBBORN)
    made.start()
    assert until(lambda: made.last_lines() == ["up"])
    assert made.stop(patience=0.2) == -signal.SIGKILL
    assert made.stop() == -signal.SIGKILL


def test_it_dies_with_a_ride_that_is_killed(tmp_path: Path) -> None:
    ride = (
        "import sys, time\nfrom pathlib import Path\n"
        "from bicycle_bringup.processes import Child\n"
        f"made = Child('node', [sys.executable, '-c', 'import time; time.sleep(60)'], "
        f"Path({str(tmp_path / 'node.log')!r}), Path({str(tmp_path / 'pids')!r}))\n"
        "made.start()\nprint('started', flush=True)\ntime.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", ride], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert parent.stdout.readline() == "started\n"
    (note,) = (tmp_path / "pids").iterdir()
    pid = int(note.name.removeprefix("node."))
    parent.kill()
    parent.wait()
    parent.stdout.close()

    def gone() -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].startswith("Z")
        except OSError:
            return True

    assert until(gone)
