"""Table at the top of RESULTS.md: one row per figure, one number per controller."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bicycle_controller.reproduce.claims import verdict
from bicycle_controller.reproduce.formatting import number, percent
from bicycle_controller.reproduce.learning_claims import unsettled
from bicycle_controller.reproduce.result import ExperimentResult, title
from bicycle_controller.reproduce.verdicts import is_short, training

Entry = dict[str, Any]

COLUMNS = (
    "figure, {mode} physics",
    "counted",
    "the paper",
    "authors' settings",
    "Tables 2 and 3",
    "ours",
    "LQR",
    "did it hold?",
)
GROUPS = ("authors", "paper", "best", "lqr")
"""Roles of the controllers' columns."""
NONE = "-"


def overview(results: list[ExperimentResult], mode: str, pages: Path) -> list[str]:
    """Return the table of one mode's results; its links lead into the folder `pages`."""
    head = " | ".join(COLUMNS).format(mode=mode)
    lines = [f"| {head} |", "| --- " * len(COLUMNS) + "|"]
    for item in results:
        counted, cell = COUNTED[item.experiment.picture]
        link = f"[{title(item.experiment)}]({(pages / item.experiment.name).as_posix()}.md)"
        cells = [link, counted, item.experiment.reports]
        cells += [cell(item, role) or NONE for role in GROUPS]
        lines.append(
            "| " + " | ".join([*cells, verdict(item.experiment, item.summary).word]) + " |"
        )
    return lines


def causes(results: list[ExperimentResult], pages: Path) -> list[str]:
    """Return the table of changes made to find the cause of a failed claim."""
    lines = ["| why | the paper | physics | what came of it |", "| --- " * 4 + "|"]
    for item in results:
        link = f"[{item.experiment.title}]({(pages / item.experiment.name).as_posix()}.md)"
        cells = [link, item.experiment.reports, item.mode]
        cells += verdict(item.experiment, item.summary).notes
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _marked(item: ExperimentResult, text: str, arm: str, variant: str = "") -> str:
    """Return a number, marked if its runs are shorter or fewer than the paper's."""
    wanted = {"arm": arm} | ({"variant": variant} if variant else {})
    entry = training(item.summary, **wanted)
    if entry is None or not is_short(item.experiment, entry):
        return text
    return f"{text} (short)"


def _goals(item: ExperimentResult, role: str) -> str:
    """Return the largest share of goals that a controller of this role reaches without noise."""
    return _of_variant(item, role, item.experiment.variants[0].name)


def _of_variant(item: ExperimentResult, role: str, variant: str) -> str:
    mine = [e for e in _rides(item, role) if e["variant"] == variant]
    if not mine:
        return ""
    best = max(mine, key=lambda entry: entry["reached"][0])
    return _marked(item, percent(best["reached"][0]), best["rider"], variant)


def _by_displacement(item: ExperimentResult, role: str) -> str:
    """Return the goals without displacement, and with the most."""
    ends = item.experiment.variants[0], item.experiment.variants[-1]
    cells = [_of_variant(item, role, variant.name) or NONE for variant in ends]
    return "" if set(cells) == {NONE} else " → ".join(cells)


def _worst(item: ExperimentResult, role: str) -> str:
    """Return the best share of goals of this role, on the variant where it is smallest."""
    worst: dict[str, float] = {}
    for entry in _rides(item, role):
        rate = entry["reached"][0]
        worst[entry["rider"]] = min(worst.get(entry["rider"], rate), rate)
    if not worst:
        return ""
    best = max(worst, key=lambda rider: worst[rider])
    return _marked(item, percent(worst[best]), best)


def _returns(item: ExperimentResult, role: str) -> str:
    """Return the best return of an episode in the last tenth of training."""
    mine = [entry for entry in item.summary["training"] if entry["role"] == role]
    if not mine:
        return ""
    best = max(mine, key=lambda entry: entry["last"]["return"][0])
    return _marked(item, number(best["last"]["return"][0]), best["arm"])


def _settled(item: ExperimentResult, role: str) -> str:
    """Return the final distance from zero of the least settled state, as a share of its range."""
    mine = [entry for entry in item.summary["states"] if entry["role"] == role]
    arrived = [entry for entry in mine if entry["reached"]]
    if not mine:
        return ""
    if not arrived:
        return _marked(item, "never arrives", mine[0]["rider"])
    best = min(arrived, key=lambda entry: unsettled(entry)[1])
    return _marked(item, percent(unsettled(best)[1]), best["rider"])


def _rides(item: ExperimentResult, role: str) -> list[Entry]:
    return [entry for entry in item.summary["rides"] if entry["role"] == role]


COUNTED: dict[str, tuple[str, Callable[[ExperimentResult, str], str]]] = {
    "terms": ("return of an episode at the end of training", _returns),
    "learning": ("goals without noise", _goals),
    "states": ("largest state at the end of a ride, of its range", _settled),
    "displacement": ("goals with d = 0 → ±20 cm", _by_displacement),
    "goals": ("goals without noise", _goals),
    "turn": ("goals with the pedal", _goals),
    "speed": ("goals without noise", _goals),
    "robustness": ("goals where they are fewest", _worst),
}
"""Measures that a row counts, and their functions."""
