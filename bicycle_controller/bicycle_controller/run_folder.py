"""A run's folder: what was asked for, what came out, and all that is needed to go on.

config.yaml           the whole configuration
run.json              command, commit, version, seed, start
log.jsonl             one line per row of metrics
episodes.csv          what each training episode came to, where `record.episodes` is on
tracks.csv            the ways of some, see `episode_log`
tensorboard/          the same for TensorBoard, where it is installed
checkpoint/state.pt   networks, optimisers, replay memory, noise, generators, counters
best.safetensors      the policy with the best evaluation
last.safetensors      the policy of the last evaluation
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from bicycle_controller import __version__, settings
from bicycle_controller.config import RunConfig
from bicycle_controller.policy import write_atomically

RESUMABLE = ("steps", "device", "threads", "save_every", "log_every", "evaluation", "tensorboard")
"""What may change when a run goes on: nothing that its numbers so far depend on."""


@dataclass(frozen=True)
class RunFolder:
    """The files of one run."""

    path: Path

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
            write_atomically(self.config, settings.dump(config).encode())
        except OSError as error:
            raise ValueError(f"cannot write to {self.path}: {error.strerror}") from error

    def resumed_config(self, overrides: list[str]) -> RunConfig:
        """The run's configuration, with the changes that a run may go on with.

        Raises:
            ValueError: when there is no run here, or on a change that its numbers forbid.
        """
        if not self.config.exists():
            raise ValueError(f"{self.path} holds no run to resume: leave out --resume")
        old, new = settings.load(self.config), settings.load(self.config, overrides)
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
            write_atomically(self.config, settings.dump(new).encode())
        return new


def origin() -> dict[str, Any]:
    """Where a run comes from: command, commit, version and time."""
    return {
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "commit": _commit(),
        "version": __version__,
        "started": datetime.now(timezone.utc).isoformat(timespec="seconds"),
    }


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
