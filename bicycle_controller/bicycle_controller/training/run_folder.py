"""Folder of a run: its configuration, its results, and everything needed to resume it.

config.yaml           the whole configuration
run.json              command, commit, version, seed, start, processor
log.jsonl             one line per row of metrics
episodes.csv          what each training episode came to, where `record.episodes` is on
tracks.csv            the ways of some, see `episode_log`
tensorboard/          the same for TensorBoard, where it is installed
checkpoint/state.pt   networks, optimisers, replay memory, noise, generators, counters
best.safetensors      the policy with the best evaluation
last.safetensors      the policy of the last evaluation
policies/             those of some evaluations by their updates, where `evaluation.keep` asks it
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bicycle_common.origin import origin as origin_of_result
from bicycle_controller import __version__
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.policy.policy import KEPT, SUFFIX, Policy, save_policy, write_atomically

RESUMABLE = ("steps", "device", "threads", "save_every", "log_every", "evaluation", "tensorboard")
"""Settings that may change in a resumed run: none that its previous numbers depend on."""


CONFIG = "config.yaml"
"""Configuration of a run of goals."""
PATH_CONFIG = "path-following.json"
"""Configuration of a run of path following, in its place."""


class BusyError(OSError):
    """Another process trains in this run's folder."""


@dataclass(frozen=True)
class RunFolder:
    """The files of one run."""

    path: Path
    config_name: str = CONFIG

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes of this machine from training here; a crash releases the lock.

        Raises:
            BusyError: if another process trains here.
            ValueError: if the folder cannot be created.
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
        """Path of the configuration, YAML."""
        return self.path / self.config_name

    @property
    def checkpoint(self) -> Path:
        """Path of the complete state."""
        return self.path / "checkpoint" / "state.pt"

    @property
    def best(self) -> Path:
        """Path of the policy with the best evaluation."""
        return self.path / "best.safetensors"

    @property
    def last(self) -> Path:
        """Path of the policy of the last evaluation."""
        return self.path / "last.safetensors"

    def keep(self, policy: Policy, updates: int, most: int) -> None:
        """Keep the policy after some updates; of more than `most`, drop the one least missed.

        The first and the newest stay, and the others are spread over the updates.
        """
        folder = self.path / KEPT
        folder.mkdir(exist_ok=True)
        save_policy(policy, folder / f"{updates:08d}{SUFFIX}")
        files = sorted(folder.glob(f"[0-9]*{SUFFIX}"))
        while len(files) > max(most, 1):
            files.pop(_least_missed([int(file.stem) for file in files])).unlink()

    def create(self, config: RunConfig) -> None:
        """Create the folder and write the configuration; raises as `begin`."""
        self.begin(loading.dump(config), config.seed)

    def begin(self, config: str, seed: int) -> None:
        """Create the folder and write the text of the configuration.

        Raises:
            ValueError: if it contains a run already, or cannot be created.
        """
        if self.config.exists():
            raise ValueError(
                f"{self.path} holds a run already: go on with --resume, or choose another --out"
            )
        about = origin() | {"seed": seed}
        try:
            write_atomically(self.path / "run.json", json.dumps(about, indent=2).encode() + b"\n")
            write_atomically(self.config, config.encode())
        except OSError as error:
            raise ValueError(f"cannot write to {self.path}: {error.strerror}") from error

    def require(self) -> None:
        """Refuse a folder without a run.

        Raises:
            ValueError: if this is one.
        """
        if not self.config.exists():
            raise ValueError(f"{self.path} holds no run to resume: leave out --resume")

    def resumed_config(self, overrides: Iterable[loading.Override]) -> RunConfig:
        """Return the run's configuration with the overrides that a resumed run may have.

        Raises:
            ValueError: if there is no run here, or on a change that affects its numbers.
        """
        self.require()
        old, new = loading.load(self.config), loading.load(self.config, overrides)
        # Annealed learning rates depend on the total number of steps.
        annealed = old.imitation is not None or old.learner.learning_rate_end < 1.0
        free = [name for name in RESUMABLE if not (annealed and name == "steps")]
        for name in vars(old):
            if name not in free and getattr(old, name) != getattr(new, name):
                raise ValueError(
                    f"{name} cannot change when this run goes on, only {', '.join(free)} can:"
                    " choose another --out"
                )
        self.clean()
        if new != old:
            write_atomically(self.config, loading.dump(new).encode())
        return new

    def clean(self) -> None:
        """Remove files that were half-written when the run was killed."""
        for stale in [*self.path.glob(".*.*.*"), *self.checkpoint.parent.glob(".*.*.*")]:
            stale.unlink()


def _least_missed(updates: list[int]) -> int:
    """Return the index of the number whose neighbours are the closest together."""
    if len(updates) == 2:
        return 0
    gaps = [after - before for before, after in zip(updates, updates[2:], strict=False)]
    return 1 + gaps.index(min(gaps))


def _lock(folder: int, path: Path) -> None:
    """Lock an open folder; the lock ends when it is closed, also by a crash."""
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BusyError(
            f"another process trains in {path}: wait for it, or choose another --out"
        ) from None


def origin() -> dict[str, Any]:
    """Return the origin of a run: command, commit, version, time and processor."""
    return {**origin_of_result(), "version": __version__}
