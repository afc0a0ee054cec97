"""How a program of ours begins and ends, tried with small ones."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import finish

BEGIN = """
if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("program")
"""
SLEEP = "print('up', flush=True); time.sleep(3600)"


def begun(folder: Path, *lines: str) -> subprocess.Popen[str]:
    """A program whose `main` has these lines, when it says that it is up."""
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
    assert finish(process) == ("", "")
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
