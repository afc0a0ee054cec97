"""`bicycle train` as a process, which may kill itself when its log has some lines."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from waiting import finish

from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.training import checkpoint

PROGRAM = """
import argparse, os, signal, sys, threading, time
from pathlib import Path
from bicycle_controller.training.logger import Logger
from bicycle_controller.training.run_folder import RunFolder
from bicycle_controller.evaluation.score import score
from bicycle_controller.cli.train import add_arguments, run_command
parser = argparse.ArgumentParser()
add_arguments(parser)
if lines := int(os.environ.get("KILLED_AFTER_LINES", 0)):
    folder = Path(sys.argv[sys.argv.index("--out") + 1])
    number = int(os.environ["KILLED_BY"])
    log, state = folder / "log.jsonl", folder / "checkpoint" / "state.pt"
    struck, write = threading.Event(), Logger.write
    def due(lines):
        return state.exists() and log.read_bytes().count(b"\\n") >= lines
    def strike():
        while not due(lines):
            time.sleep(0.001)
        os.kill(os.getpid(), number)
        struck.set()
    def write_on(*arguments):
        write(*arguments)
        # The blow comes at any moment of some lines, but before the run ends.
        if due(lines + 2):
            struck.wait()
    Logger.write = write_on
    threading.Thread(target=strike, daemon=True).start()
try:
    sys.exit(run_command(parser.parse_args()))
except ValueError as error:
    sys.exit(f"error: {error}")
"""


def bicycle_train(folder: Path, *arguments: str, config: RunConfig | None = None) -> list[str]:
    """Return the words that run `bicycle train` in a folder, quietly."""
    words = [sys.executable, "-c", PROGRAM, *arguments, "--out", str(folder), "--quiet"]
    if config is not None:
        path = folder.with_suffix(".yaml")
        path.write_text(loading.dump(config))
        words += ["--config", str(path)]
    return words


def start(words: list[str], **variables: str) -> subprocess.Popen[str]:
    """Start it."""
    pipe, env = subprocess.PIPE, {**os.environ, "OMP_NUM_THREADS": "1", **variables}
    return subprocess.Popen(words, text=True, env=env, stdout=pipe, stderr=pipe)


def struck(words: list[str], folder: Path, lines: int, number: signal.Signals) -> str:
    """Run it until its log has some lines, when a signal strikes it; return what it printed."""
    # It strikes itself: on a busy machine another process may come when it is done already.
    process = start(words, KILLED_AFTER_LINES=str(lines), KILLED_BY=str(int(number)))
    out, err = finish(process)
    code = -number if number == signal.SIGKILL else 128 + number
    assert (process.returncode, err) == (code, "")
    assert checkpoint.load(folder / "checkpoint" / "state.pt")["updates"] > 0
    return out


def went_on(words: list[str]) -> str:
    """Run it to its end; return what it printed."""
    process = start(words)
    out, err = finish(process)
    assert process.returncode == 0, err
    return out
