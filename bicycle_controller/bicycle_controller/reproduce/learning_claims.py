"""Claims of figures 9, 10 and 11: the results of training."""

from __future__ import annotations

import numpy as np

from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.formatting import number, percent
from bicycle_controller.reproduce.verdicts import (
    DDPG,
    Entry,
    FigureVerdict,
    Part,
    Summary,
    arrivals,
    at_length,
    first,
    not_run,
    of_runs,
    over,
    rides,
    training,
)

BALANCED = 0.05
"""Share of falls below which a policy counts as balancing."""
TERMS = ("lean_angle", "lean_rate", "lean_acceleration", "heading_error")
RANGES = {
    "steer_angle": 0.8,
    "steer_rate": 3.0,
    "lean_angle": 0.3,
    "lean_rate": 1.0,
    "lean_acceleration": 5.0,
    "heading_error": 2.0,
}
"""Natural ranges of the states: rad, rad/s and rad/s²."""
SETTLED = 0.05
"""Share of its range within which a state counts as zero."""


def terms(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Figure 9: every term shrinks, and the heading term is the largest at first."""
    found = training(summary, arm=DDPG)
    notes = [_lost(experiment, summary, arm) for arm in ("paper", "fast")]
    if found is None:
        return FigureVerdict(not_run("the terms tend to zero"), tuple(notes))
    start, end = ({n: -found[part][n][0] for n in TERMS} for part in ("first", "last"))
    shrunk = [name for name in TERMS if end[name] < start[name]]
    lean = sum(start[n] for n in TERMS[:3]), sum(end[n] for n in TERMS[:3])
    gap = start["heading_error"] / lean[0], end["heading_error"] / lean[1]
    largest = max(start, key=lambda name: start[name]) == "heading_error"
    full = at_length(experiment, found)
    shown = (
        f"{number(-start['heading_error'])} an episode, the three lean terms {number(-lean[0])}"
    )
    most = Part("the heading term is the most negative at first", largest, shown, full)
    shown = f"{len(shrunk)} of 4 shrank, heading to {number(-end['heading_error'])}, lean to"
    shown += f" {number(-lean[1])}"
    shrink = Part("all four terms tend to zero", len(shrunk) == 4, shown, full)
    shown = f"their ratio went from {number(gap[0])} to {number(gap[1])}"
    closes = Part("the gap between them closes", gap[1] < gap[0], shown, full)
    said = f"`{DDPG}`: {over(experiment, found)}{of_runs(found)}."
    notes = [said, *notes, arrivals(summary, experiment, ("paper", DDPG))]
    return FigureVerdict((most, shrink, closes), tuple(notes))


def _lost(experiment: Experiment, summary: Summary, arm: str) -> str:
    """Return a note on the terms that dominate an arm's return."""
    found = training(summary, arm=arm)
    if found is None:
        return f"`{arm}` was not run."
    start, end = (number(found[part]["return"][0]) for part in ("first", "last"))
    return f"`{arm}`: return from {start} to {end} over {over(experiment, found)}{of_runs(found)}."


def learning(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Figure 10: DDPG ends above NAF and PPO and varies less than PPO; NAF does not balance."""
    arms = {name: training(summary, arm=name) for name in (DDPG, "naf", "ppo")}
    ddpg, naf, ppo = arms.values()
    last = {n: e["last"]["return"][0] for n, e in arms.items() if e is not None}
    best = None if len(last) < 3 else last[DDPG] > max(last["naf"], last["ppo"])
    ends = ", ".join(f"`{name}` {number(value)}" for name, value in last.items())
    spread = {n: (_spread(e, "first"), _spread(e, "last")) for n, e in arms.items()}
    (_, ours), (before, theirs) = spread[DDPG], spread["ppo"]
    shown = f"in the last tenth of training {ends or 'nothing'}"
    full = at_length(experiment, ddpg, naf, ppo)
    above = Part("DDPG ends with the highest return", best, shown, full)
    shown = f"standard deviation {_number(ours)} against {_number(theirs)}"
    full = at_length(experiment, ddpg, ppo)
    closer = Part("DDPG's runs end closer together than PPO's", _less(ours, theirs), shown, full)
    shown = f"standard deviation from {_number(before)} to {_number(theirs)}"
    full = at_length(experiment, ppo)
    grows = Part("PPO's runs drift apart", _less(before, theirs), shown, full)
    parts = (above, closer, grows, _unbalanced(experiment, summary, naf))
    lengths = [f"`{n}`: {over(experiment, e)}" for n, e in arms.items() if e is not None]
    said = f"{', '.join(lengths)}." if lengths else "None of the three was run."
    names = ("paper", DDPG, "naf", "ppo", "fast", "fixed-speed", "lqr", "lqr-20cm")
    return FigureVerdict(parts, (said, arrivals(summary, experiment, names)))


def _unbalanced(experiment: Experiment, summary: Summary, naf: Entry | None) -> Part:
    """Return the part that NAF does not balance: one run that does refutes it, however short."""
    ridden = rides(summary, rider="naf")
    claim = "NAF does not come to balance"
    if ridden is None or naf is None:
        return Part(claim, None, "`naf` was not run")
    able = sum(fallen < BALANCED for fallen in ridden["fallen_by_run"])
    shown = f"{able} of {ridden['runs']} runs fall in less than {percent(BALANCED)} of rides"
    return Part(claim, not able, shown, able > 0 or at_length(experiment, naf))


def _spread(entry: Entry | None, part: str) -> float | None:
    """Return the standard deviation of the return over an arm's runs, if at least two."""
    values = [] if entry is None else entry[part]["return_by_run"]
    return float(np.std(values, ddof=1)) if len(values) > 1 else None


def _less(one: float | None, other: float | None) -> bool | None:
    return None if one is None or other is None else one < other


def _number(value: float | None) -> str:
    return "unknown" if value is None else number(value)


def states(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Figure 11: the states come to rest near zero."""
    trained = training(summary, arm=DDPG)
    notes = []
    for entry in summary["states"]:
        if not entry["reached"]:
            notes.append(f"`{entry['rider']}` never arrives.")
            continue
        restless = [n.replace("_", " ") for n in RANGES if _end(entry, n) > SETTLED]
        text = f"all within {percent(SETTLED)} of their range in the last second"
        if restless:
            text = f"not settled: {', '.join(restless)}"
        notes.append(f"`{entry['rider']}` arrives upright, {text}.")
    ride = first(summary["states"], rider=DDPG)
    if trained is None or ride is None:
        return FigureVerdict(not_run("all six states converge to zero"), tuple(notes))
    worst, left = unsettled(ride)
    full = at_length(experiment, trained)
    shown = f"`{DDPG}` {'arrives' if ride['reached'] else 'never arrives'} after"
    shown += f" {over(experiment, trained)}"
    arrives = Part("the ride arrives, stable", ride["reached"], shown, full)
    shown = f"{worst.replace('_', ' ')} ends within {percent(left)} of its range"
    settled = ride["reached"] and left <= SETTLED
    rests = Part("all six states converge to zero", settled, shown, full)
    return FigureVerdict((arrives, rests), tuple(notes))


def unsettled(entry: Entry) -> tuple[str, float]:
    """Return the state that ends a ride farthest from zero, as name and share of its range."""
    worst = max(RANGES, key=lambda name: _end(entry, name))
    return worst, _end(entry, worst)


def _end(entry: Entry, name: str) -> float:
    """Return the mean size of a state in the last second, as a share of its range."""
    return float(entry[name]["end"]) / RANGES[name]
