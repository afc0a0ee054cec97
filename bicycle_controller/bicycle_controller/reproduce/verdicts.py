"""Verdicts: the parts of a claim, each decided or open, and their wording.

"Held" requires a part whose arm was run at the paper's length, with as many runs, and showed it.
A shorter run leaves a part open; only what cannot be unlearned (that an algorithm which "cannot
balance" balances) may be refuted early.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.formatting import lengths, number, percent

Entry = dict[str, Any]
Summary = dict[str, Any]

DDPG = "authors"
"""Arm by which claims about the paper's DDPG are judged."""


@dataclass(frozen=True)
class Part:
    """One part of what a figure claims."""

    claim: str
    """The paper's claim, in a few words."""
    shows: bool | None
    """True if the data show it; None without data."""
    shown: str
    """Verdict that the data support."""
    at_length: bool = False
    """True if its runs are as long and as many as the paper's."""

    @property
    def held(self) -> bool | None:
        """True or False if decided; None while it is open."""
        return self.shows if self.at_length else None

    @property
    def text(self) -> str:
        """The part as a sentence."""
        word = {True: "held", False: "did not hold", None: "open"}[self.held]
        if self.held is None and self.shows is not None:
            word += f" (so far {'yes' if self.shows else 'no'})"
        return f"{self.claim}: {word}; {self.shown}"


@dataclass(frozen=True)
class FigureVerdict:
    """Verdict on a figure's claims."""

    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()
    """Notes: other controllers, arms that never arrive."""

    @property
    def word(self) -> str:
        """Short form: `Held`, `Did not hold`, `Held in part (2 of 3)` or `Open (so far 1 of 3)`.

        If some parts are open and others decided, it gives the number of each.
        """
        every = len(self.parts)
        if not every:
            return "No claim"
        held, refuted = (sum(p.held is value for p in self.parts) for value in (True, False))
        if held == every:
            return "Held"
        if refuted == every:
            return "Did not hold"
        if held + refuted == every:
            return f"Held in part ({held} of {every})"
        so_far = f"so far {sum(bool(p.shows) for p in self.parts)} of {every}"
        known = [f"{held} held"] if held else []
        known += [f"{refuted} did not hold"] if refuted else []
        return f"Open ({', '.join([so_far, *known])})"


def not_run(claim: str) -> tuple[Part, ...]:
    """Return the only part of a claim whose arm was not run."""
    return (Part(claim, None, f"`{DDPG}` was not run"),)


def at_length(experiment: Experiment, *entries: Entry | None) -> bool:
    """Return True if the runs of all these arms are as long and as many as the paper's."""
    return not any(is_short(experiment, entry) for entry in entries)


def is_short(experiment: Experiment, entry: Entry | None) -> bool:
    """Return True if an arm's runs are missing, or shorter or fewer than requested."""
    if entry is None or entry["runs"] < experiment.full.seeds:
        return True
    return bool(entry["length"] < 0.99 * asked(experiment, entry["arm"]))


def asked(experiment: Experiment, arm: str) -> float:
    """Return the episodes required of an arm's run: the paper's, or enough for ours."""
    full = float(experiment.full.episodes)
    most = next((item.most_steps for item in experiment.arms if item.name == arm), 0)
    return min(full, most / experiment.limit) if most else full


def training(summary: Summary, **wanted: str) -> Entry | None:
    """Return the training results of an arm, or None."""
    return first(summary["training"], **wanted)


def rides(summary: Summary, **wanted: str) -> Entry | None:
    """Return the ride results of a controller, or None."""
    return first(summary["rides"], **wanted)


def first(entries: list[Entry], **wanted: str) -> Entry | None:
    """Return the first entry with these values."""
    fits = (e for e in entries if all(e[key] == value for key, value in wanted.items()))
    return next(fits, None)


def over(experiment: Experiment, entry: Entry) -> str:
    """Return the length that an entry covers, as text."""
    text = f"{entry['runs']} × {lengths(entry)} episodes"
    full = f"{experiment.full.seeds} × {number(asked(experiment, entry['arm']))}"
    return f"{text} of {full}" if is_short(experiment, entry) else text


def of_runs(entry: Entry) -> str:
    """Return a note that a number is a mean over runs, if it is."""
    return f" (mean of {entry['runs']} runs)" if entry["runs"] > 1 else ""


def arrivals(summary: Summary, experiment: Experiment, names: tuple[str, ...]) -> str:
    """Return the shares of goals without noise; name arms that never arrive or were not run."""
    parts = []
    for name in names:
        mine = [entry for entry in summary["rides"] if entry["rider"] == name]
        labels = [experiment.variant(entry["variant"]).label for entry in mine]
        said = [arrival(entry, label) for entry, label in zip(mine, labels, strict=True)]
        if all(entry["reached"][0] == 0.0 for entry in mine):
            said = ["never arrives" if mine else "was not run"]
        parts.append(f"`{name}` {', '.join(said)}")
    return f"Goals without noise: {'; '.join(parts)}."


def arrival(entry: Entry, label: str) -> str:
    """Return one controller's share of goals on a variant."""
    about = [label] if label else []
    about += [f"mean of {entry['runs']} runs"] if entry["runs"] > 1 else []
    return percent(entry["reached"][0]) + (f" ({', '.join(about)})" if about else "")
