"""Start and end of programs under signals, and the one handler of signals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from waiting import PATIENCE, finish

from bicycle_common.signals import ENDING, InterruptError, StopRequest

BEGIN = """
if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("program")
"""
SLEEP = "print('up', flush=True); time.sleep(3600)"


def begun(folder: Path, *lines: str) -> subprocess.Popen[str]:
    """Return a program whose `main` has these lines, when it says that it is up."""
    body = "".join(f"    {line}\n" for line in lines)
    (folder / "program.py").write_text(f"{BEGIN}\nimport signal, time\n\ndef main():\n{body}")
    process = subprocess.Popen(
        [sys.executable, "-m", "program"],
        env={**os.environ, "PYTHONPATH": f"{folder}:{os.environ.get('PYTHONPATH', '')}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    return process


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        ((SLEEP,), 130),
        # C code, such as hasattr's, may swallow the exception.
        (("try:", f"    {SLEEP}", "except KeyboardInterrupt:", "    time.sleep(3600)"), 130),
        (("try:", f"    {SLEEP}", "except KeyboardInterrupt:", "    return 7"), 7),
        # Where it strikes within exec, Python would end itself with SIGINT at its very end.
        (("try:", f"    exec({SLEEP!r})", "except KeyboardInterrupt:", "    return 7"), 7),
        (("try:", f"    {SLEEP}", "finally:", "    signal.raise_signal(signal.SIGINT)"), 130),
    ],
)
def test_ctrl_c_ends_it_without_a_word(
    tmp_path: Path, lines: tuple[str, ...], status: int
) -> None:
    process = begun(tmp_path, *lines)
    process.send_signal(signal.SIGINT)
    try:
        printed = process.communicate(timeout=PATIENCE / 6.0)
    except subprocess.TimeoutExpired:
        # Python sleeps on if the signal comes in the moment before its sleep begins.
        process.send_signal(signal.SIGINT)
        printed = finish(process)
    assert printed == ("", "")
    assert process.returncode == status


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_end_it_too(tmp_path: Path, number: signal.Signals) -> None:
    process = begun(tmp_path, SLEEP)
    process.send_signal(number)
    assert finish(process) == ("", "")
    assert process.returncode == 128 + number


def test_what_is_said_at_the_end_is_said_and_the_status_stands(tmp_path: Path) -> None:
    lines = "import atexit, os", "me = os.getpid()"
    last = "atexit.register(lambda: [os.kill(me, n) for n in (2, 15, 1)] and print('last'))"
    process = begun(tmp_path, *lines, last, "print('up', flush=True)", "return 5")
    assert process.stdout is not None
    assert process.stdout.read() == "last\n"
    assert finish(process)[1] == ""
    assert process.returncode == 5


@pytest.fixture
def handlers_as_before() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in ENDING}
    # A test run in a shell's background ignores SIGINT.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", ENDING)
def test_a_listening_program_is_ended_by_no_signal(
    number: signal.Signals, handlers_as_before: None
) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup has it ignored
    stop = StopRequest().listen()
    assert stop.signal == 0
    for _ in range(3):
        signal.raise_signal(number)
    assert stop.requested
    assert stop.wait(60.0)
    assert stop.signal == number
    assert stop.interrupts == (3 if number == signal.SIGINT else 0)
    signal.raise_signal(signal.SIGINT)
    assert stop.signal == number, "the first signal decides the exit status"


def test_nohup_keeps_a_program_alive(handlers_as_before: None) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    stop = StopRequest().listen()
    signal.raise_signal(signal.SIGHUP)
    with stop:
        signal.raise_signal(signal.SIGHUP)
    assert not stop.requested


def test_the_second_signal_acts_as_if_nothing_caught_it(handlers_as_before: None) -> None:
    with StopRequest() as stop:
        signal.raise_signal(signal.SIGTERM)
        assert stop.signal == signal.SIGTERM
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_a_context_gives_the_signals_back(handlers_as_before: None) -> None:
    with StopRequest():
        pass
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_at_once_raises_when_a_signal_comes_and_when_it_has_come(handlers_as_before: None) -> None:
    with StopRequest() as stop:
        with pytest.raises(InterruptError), stop.at_once():
            signal.raise_signal(signal.SIGTERM)
        assert stop.signal == signal.SIGTERM
        with pytest.raises(InterruptError), stop.at_once():
            pytest.fail("it had been asked to end")


def test_another_thread_catches_nothing_and_says_nothing() -> None:
    found = []

    def work() -> None:
        with StopRequest() as stop:
            found.append(stop.requested)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [False]
