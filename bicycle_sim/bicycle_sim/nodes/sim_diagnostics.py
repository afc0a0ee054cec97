"""The simulator's diagnostics."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticStatus

from bicycle_common.nodes.diagnostics import ERROR, OK, WARN, percentiles, status
from bicycle_sim.runtime.loop import WITHOUT_COMMANDS, Loop, StepResult

_MODES = {
    "riding": "riding",
    "paused": "paused",
    "held": "held until the next command",
    "fallen": "fallen: reset it",
}


class SimReport:
    """Collects steps and reports loop, commands and bicycle once per period."""

    def __init__(self, name: str, loop: Loop) -> None:
        self._name = name
        self._loop = loop
        self._steps: list[StepResult] = []
        self._since = time.monotonic()
        self._late = self._dropped = 0

    def add(self, step: StepResult) -> None:
        """Count one step."""
        self._steps.append(step)

    def statuses(self, simulators: int) -> list[DiagnosticStatus]:
        """Return the entries since the last call; `simulators` counts the state publishers."""
        steps, self._steps = self._steps, []
        now = time.monotonic()
        elapsed, self._since = now - self._since, now
        return [self._timing(steps, elapsed), self._commands(steps), self._bicycle(simulators)]

    def _timing(self, steps: list[StepResult], elapsed: float) -> DiagnosticStatus:
        pacer = self._loop.pacer
        late, dropped = pacer.late - self._late, pacer.dropped - self._dropped
        self._late, self._dropped = pacer.late, pacer.dropped
        level, text = OK, "punctual"
        if self._loop.lockstep:
            text = "lock-step"
        elif dropped:
            level, text = WARN, f"{dropped} steps dropped: this machine is too slow or too busy"
        elif late:
            level, text = WARN, f"{late} steps late"
        values: dict[str, object] = {
            "rate (Hz)": len(steps) / elapsed,
            "late steps": pacer.late,
            "dropped steps": pacer.dropped,
            **percentiles([one.timing.lateness for one in steps], "lateness"),
            **percentiles([one.latency for one in steps], "state to command"),
        }
        return status(f"{self._name}: loop", level, text, values)

    def _commands(self, steps: list[StepResult]) -> DiagnosticStatus:
        loop, validator = self._loop, self._loop.validator
        held = loop.waiting or loop.paused or loop.snapshot.fallen
        level, text = OK, "waiting" if held else f"from {validator.owner!r}"
        if loop.timed_out:
            what = WITHOUT_COMMANDS[loop.options.on_timeout]
            level, text = ERROR, f"no valid command for {validator.silence():.2f} s: {what}"
        values: dict[str, object] = {
            "accepted": validator.accepted,
            "silence (s)": validator.silence(),
            "controller": validator.owner or "",
            **{reason.value: count for reason, count in validator.rejected.items()},
            "steps by input": ", ".join(_sources(steps)),
        }
        return status(f"{self._name}: commands", level, text, values)

    def _bicycle(self, simulators: int) -> DiagnosticStatus:
        loop, snapshot = self._loop, self._loop.snapshot
        level, mode = OK, self._mode()
        text = _MODES[mode]
        if snapshot.fallen:
            level = WARN
        if simulators > 1:
            level, text = (
                ERROR,
                f"{simulators} nodes publish this bicycle's state: stop all but one",
            )
        values: dict[str, object] = {
            "mode": mode,
            "paused": loop.paused,
            "episode": snapshot.episode,
            "step": snapshot.step,
            "total steps": loop.total_steps,
            "seed": loop.simulator.seed,
        }
        return status(f"{self._name}: bicycle", level, text, values)

    def _mode(self) -> str:
        """Return a key of `_MODES`."""
        loop = self._loop
        if loop.snapshot.fallen:
            return "fallen"
        if loop.paused:
            return "paused"
        return "held" if loop.waiting else "riding"


def _sources(steps: list[StepResult]) -> list[str]:
    """Return a text per kind of input: how many steps it made."""
    names = [one.applied.source.name.lower() for one in steps]
    return [f"{names.count(name)} {name}" for name in sorted(set(names))]
