"""Result of a training or learning run as text."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from bicycle_controller.evaluation.score import Score


class EndedRun(Protocol):
    """End of a run: its status and times."""

    @property
    def status(self) -> str:
        """`finished`, `reached` or `interrupted`."""

    @property
    def wall_s(self) -> float:
        """Wall time, s."""

    @property
    def cpu_s(self) -> float:
        """Processor time, s."""


class RunResult(EndedRun, Protocol):
    """Common part of the results of online and offline runs."""

    @property
    def best(self) -> Score | None:
        """Score of `best.safetensors`; None without one."""


def as_text(result: RunResult, work: str, command: str, out: Path) -> str:
    """Return a run's result as a few lines.

    Args:
        result: the result.
        work: the amount of work, such as `5000 steps`.
        command: the command that resumes the run.
        out: folder of the run.
    """
    lines = [ended(result, work)]
    if result.best is not None:
        best = result.best
        time = "no goal" if best.median_time_s is None else f"median {best.median_time_s:.1f} s"
        lines.append(
            f"best policy: {out / 'best.safetensors'}: {best.reach_rate:.1%} reached,"
            f" {best.fall_rate:.1%} fell, {time}"
        )
    return "\n".join([*lines, *how_to_go_on(result, command, out)])


def ended(result: EndedRun, work: str) -> str:
    """Return the line that tells how a run ended, after which work, in which time."""
    wall, cpu = f"{result.wall_s:.0f} s", f"{result.cpu_s:.0f} s of processor time"
    return f"{result.status} after {work} in {wall} ({cpu})"


def how_to_go_on(result: EndedRun, command: str, out: Path) -> list[str]:
    """Return the line that tells how an interrupted run goes on; none for another."""
    if result.status != "interrupted":
        return []
    return [f"go on with: {command} --resume --out {out}"]
