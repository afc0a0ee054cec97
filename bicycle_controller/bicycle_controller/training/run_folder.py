"""A run's folder: what was asked for, what came out, and all that is needed to go on.

config.yaml           the whole configuration
run.json              command, commit, version, seed, start, processor
log.jsonl             one line per row of metrics
episodes.csv          what each training episode came to, where `record.episodes` is on
tracks.csv            the ways of some, see `episode_log`
tensorboard/          the same for TensorBoard, where it is installed
checkpoint/state.pt   networks, optimisers, replay memory, noise, generators, counters
best.safetensors      the policy with the best evaluation
last.safetensors      the policy of the last evaluation
"""

from __future__ import annotations

import fcntl
import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from bicycle_controller import __version__
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.policy.policy import write_atomically

RESUMABLE = ("steps", "device", "threads", "save_every", "log_every", "evaluation", "tensorboard")
"""What may change when a run goes on: nothing that its numbers so far depend on."""


class BusyError(OSError):
    """Another process trains in a run's folder."""


@dataclass(frozen=True)
class RunFolder:
    """The files of one run."""

    path: Path

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes of this machine from training here; a crash lets go of it.

        Raises:
            BusyError: when another one does.
            ValueError: when the folder cannot be made.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            folder = os.open(self.path, os.O_RDONLY)
        except OSError as error:
            raise ValueError(f"cannot write to {self.path}: {error.strerror}") from error
        try:
            _lock(folder, self.path)
            yield
        finally:
            os.close(folder)

    @property
    def config(self) -> Path:
        """The configuration, YAML."""
        return self.path / "config.yaml"

    @property
    def checkpoint(self) -> Path:
        """The whole state."""
        return self.path / "checkpoint" / "state.pt"

    @property
    def best(self) -> Path:
        """The policy with the best evaluation."""
        return self.path / "best.safetensors"

    @property
    def last(self) -> Path:
        """The policy of the last evaluation."""
        return self.path / "last.safetensors"

    def create(self, config: RunConfig) -> None:
        """Make the folder and say in it what is about to run.

        Raises:
            ValueError: when it holds a run already, or cannot be made.
        """
        if self.config.exists():
            raise ValueError(
                f"{self.path} holds a run already: go on with --resume, or choose another --out"
            )
        about = origin() | {"seed": config.seed}
        try:
            write_atomically(self.path / "run.json", json.dumps(about, indent=2).encode() + b"\n")
            write_atomically(self.config, loading.dump(config).encode())
        except OSError as error:
            raise ValueError(f"cannot write to {self.path}: {error.strerror}") from error

    def require(self) -> None:
        """Refuse a folder without a run.

        Raises:
            ValueError: when this is one.
        """
        if not self.config.exists():
            raise ValueError(f"{self.path} holds no run to resume: leave out --resume")

    def resumed_config(self, overrides: Iterable[loading.Override]) -> RunConfig:
        """The run's configuration, with the changes that a run may go on with.

        Raises:
            ValueError: when there is no run here, or on a change that its numbers forbid.
        """
        self.require()
        old, new = loading.load(self.config), loading.load(self.config, overrides)
        # Annealed learning rates depend on how many steps there will be.
        annealed = old.learner.learning_rate_end < 1.0
        free = [name for name in RESUMABLE if not (annealed and name == "steps")]
        for name in vars(old):
            if name not in free and getattr(old, name) != getattr(new, name):
                raise ValueError(
                    f"{name} cannot change when this run goes on, only {', '.join(free)} can:"
                    " choose another --out"
                )
        for stale in [*self.path.glob(".*.*.*"), *self.checkpoint.parent.glob(".*.*.*")]:
            stale.unlink()  # half-written when the run was killed
        if new != old:
            write_atomically(self.config, loading.dump(new).encode())
        return new


def _lock(folder: int, path: Path) -> None:
    """Lock an open folder, which unlocks as it is closed, by a crash too."""
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BusyError(
            f"another process trains in {path}: wait for it, or choose another --out"
        ) from None


def origin() -> dict[str, Any]:
    """Where a run comes from: command, commit, version, time, and what its seconds are of."""
    return {
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "commit": _commit(),
        "version": __version__,
        "started": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "processor": processor(),
    }


def processor() -> str:
    """The processor's name, as the kernel has it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _commit() -> str:
    """The commit of this source tree, `+` after it when files have changed, or `unknown`."""
    here = Path(__file__).parent
    found = []
    for words in (("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no")):
        try:
            done = subprocess.run(
                ["git", "-C", str(here), *words],
                capture_output=True,
                text=True,
                timeout=10,
                check=True,
            )
        except (OSError, subprocess.SubprocessError):
            return "unknown"
        found.append(done.stdout.strip())
    return found[0] + ("+" if found[1] else "")
