"""Child processes: logs, ends, and none left behind."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import pytest
from waiting import until

from bicycle_common import processes, signals
from bicycle_common.processes import (
    MOST_DEATHS,
    Exit,
    ManagedProcess,
    ProcessGroup,
    SaveWait,
    Supervisor,
)

STUBBORN = (
    "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(3600)"
)


def stubborn(pipe: Connection) -> None:
    """Stay, whatever the spawner asks for; tells the session and whether Ctrl-C is ignored."""
    processes.begin_spawned()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    waits = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    pipe.send((os.getsid(0), signal.getsignal(signal.SIGINT) == signal.SIG_IGN, waits))
    time.sleep(3600)


def test_a_spawned_process_is_stopped_by_its_spawner_alone() -> None:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=stubborn, args=(there,), daemon=True)
    with signals.blocked():
        process.start()
    session, ignores, waits = here.recv()
    assert (session, ignores, waits) == (process.pid, True, set())
    process.terminate()
    assert not processes.joined_or_killed(process, 0.2)
    assert process.exitcode == -signal.SIGKILL
    assert processes.joined_or_killed(process, 0.2), "an ended one"


def child(tmp_path: Path, program: str, registry: Path | None = None) -> ManagedProcess:
    return ManagedProcess("node", [sys.executable, "-c", program], tmp_path / "node.log", registry)


def test_an_end_is_told_as_a_person_would() -> None:
    assert str(Exit("controller", 3)) == "controller exited with status 3"
    assert str(Exit("controller", -9)) == "controller was killed by SIGKILL"


def test_output_goes_to_the_log_and_the_status_is_kept(tmp_path: Path) -> None:
    result = child(
        tmp_path, "import sys; print('one'); print('two', file=sys.stderr); sys.exit(5)"
    )
    assert result.ended() is None
    result.start()
    until(lambda: result.ended() is not None)
    assert result.ended() == Exit("node", 5)
    assert sorted(result.last_lines()) == ["one", "two"]


def test_a_restart_adds_to_the_log(tmp_path: Path) -> None:
    result = child(tmp_path, "print('here')")
    for _ in range(2):
        result.start()
        until(lambda: result.ended() is not None)
    assert result.last_lines() == ["here", "here"]


def test_the_last_line_ends_however_long_a_dying_child_made_it(tmp_path: Path) -> None:
    """The log has all of it; a message shows one line, which forges no other and colours none."""
    words = "print('x' * 10_000_000 + chr(27) + '[31mred'); print('yyyyy'); print('z' * 3000)"
    result = child(tmp_path, words)
    result.start()
    until(lambda: result.ended() is not None)
    red, short, long = result.last_lines(3)
    assert red == "..." + "x" * (processes.LONGEST - 11) + r"\x1b[31mred"
    assert short == "yyyyy"
    assert long == "..." + "z" * processes.LONGEST
    assert (tmp_path / "node.log").stat().st_size > 10_000_000


def test_it_is_noted_for_stop_while_it_runs(tmp_path: Path) -> None:
    result = child(tmp_path, "import time; time.sleep(3600)", tmp_path / "pids")
    result.start()
    (note,) = (tmp_path / "pids").iterdir()
    pid = int(note.name.removeprefix("node."))
    assert os.getsid(pid) == pid != os.getsid(0)
    assert note.read_text().strip().isdigit()
    result.stop()
    assert list((tmp_path / "pids").iterdir()) == []


def test_who_ignores_signals_is_killed(tmp_path: Path) -> None:
    result = child(tmp_path, STUBBORN)
    result.start()
    until(lambda: result.last_lines() == ["up"])
    assert result.stop(patience=0.2) == -signal.SIGKILL
    assert result.stop() == -signal.SIGKILL


SAVING = (
    "import signal, time; from pathlib import Path; asked = []\n"
    "for number in (signal.SIGINT, signal.SIGTERM): signal.signal(number, lambda n, _: "
    "asked.append(n))\n"
    "print('up', flush=True)\n"
    "while not (asked and Path('saved').exists()): time.sleep(0.02)\n"
)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Waits are told at once; the file that ends one."""
    monkeypatch.setattr(processes, "FIRST_WORD", 0.1)
    monkeypatch.setattr(processes, "NEXT_WORD", 0.1)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "saved"


def test_who_saves_is_waited_for_and_never_killed(tmp_path: Path, soon: Path) -> None:
    result = ManagedProcess(
        "node", [sys.executable, "-c", SAVING], tmp_path / "node.log", saves="a bag"
    )
    result.start()
    assert until(lambda: result.last_lines() == ["up"])
    lines: list[str] = []

    def tell(line: str) -> None:
        lines.append(line)
        if len(lines) == 8:  # long after a SIGKILL would have come
            soon.touch()

    assert result.stop(SaveWait(tell, lambda: 0), patience=0.05) == 0
    assert lines[0].startswith(
        "the node is still writing a bag (a slow disk or a busy machine), waiting ("
    )
    assert len(lines) >= 8


def test_a_ctrl_c_that_answers_the_line_leaves_it_to_end_alone(tmp_path: Path, soon: Path) -> None:
    log, registry = tmp_path / "node.log", tmp_path / "pids"
    result = ManagedProcess("node", [sys.executable, "-c", SAVING], log, registry, saves="a bag")
    result.start()
    assert until(lambda: result.last_lines() == ["up"])
    interrupts = [signal.SIGINT]  # the one that ended the ride answers nothing
    save_wait = SaveWait(lambda _: interrupts.append(signal.SIGINT), lambda: len(interrupts))
    assert result.stop(save_wait, patience=0.05) is None
    assert len(interrupts) == 2
    assert result.running
    assert "which goes on writing a bag: do not kill it" in result.left()
    assert list(registry.iterdir()), "stop.sh could not find it"
    soon.touch()
    assert until(lambda: result.ended() == Exit("node", 0))


def test_a_crew_tells_of_each_that_does_not_end_with_status_0(tmp_path: Path) -> None:
    programs = {"well": "pass", "badly": "print('lost it'); sys.exit(3)"}
    commands = {
        name: [
            sys.executable,
            "-c",
            "import signal, sys\nsignal.signal(signal.SIGINT, lambda *_: None)\n"
            f"print('up', flush=True)\nsignal.pause()\n{last}",
        ]
        for name, last in programs.items()
    }
    crew = ProcessGroup(commands, tmp_path)
    crew.start()
    logs = [tmp_path / f"{name}.log" for name in programs]
    assert until(lambda: all("up" in log.read_text() for log in logs))
    assert crew.stop(*programs) == [
        f"badly exited with status 3: lost it (log: {tmp_path / 'badly.log'})"
    ]
    assert crew.stop(*programs) == []
    assert not crew.left


def test_it_dies_with_a_ride_that_is_killed(tmp_path: Path) -> None:
    ride = (
        "import sys, time\nfrom pathlib import Path\n"
        "from bicycle_common.processes import ManagedProcess\n"
        f"made = ManagedProcess('node', [sys.executable, '-c', 'import time; time.sleep(3600)'], "
        f"Path({str(tmp_path / 'node.log')!r}), Path({str(tmp_path / 'pids')!r}))\n"
        "made.start()\nprint('started', flush=True)\ntime.sleep(3600)\n"
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

    until(gone)


def test_what_dies_is_started_again_but_not_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "BACK_OFF", 0.0)
    commands = {name: [sys.executable, "-c", "raise SystemExit(5)"] for name in ("one", "two")}
    group = ProcessGroup(commands, tmp_path)
    supervisor = Supervisor(group)
    assert supervisor.death() is None
    group.start("one")
    for _ in range(MOST_DEATHS):
        until(lambda: supervisor.death() == Exit("one", 5))
        assert supervisor.retry("one")
        assert supervisor.death() is None, "it is told once"
        until(lambda: supervisor.restarted() == "one")
    until(lambda: supervisor.death() is not None)
    assert not supervisor.retry("one")
    assert supervisor.death() == Exit("one", 5), "nothing was done about it"
    supervisor.forgive()
    assert supervisor.retry("one")
    group.stop("one", "two")


def test_a_death_waits_before_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "BACK_OFF", 3600.0)
    group = ProcessGroup({"one": [sys.executable, "-c", "pass"]}, tmp_path)
    supervisor = Supervisor(group)
    group.start()
    until(lambda: supervisor.death() is not None)
    assert supervisor.retry("one")
    assert supervisor.restarted() is None
