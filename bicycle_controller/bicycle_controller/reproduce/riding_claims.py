"""Claims of figures 12 to 16, and the robustness results: the goals that bicycles reach."""

from __future__ import annotations

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
    is_short,
    not_run,
    of_runs,
    over,
    rides,
    training,
)

MOST = 0.99
"""Share of goals that counts as all."""


def displacement(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Figure 12: the more displacement, the better; without it the bicycle falls."""
    least, most = experiment.variants[0], experiment.variants[-1]
    trained = [training(summary, arm=DDPG, variant=v.name) for v in experiment.variants]
    low, high = (rides(summary, rider=DDPG, variant=v.name) for v in (least, most))
    better = falls = None
    rates = dropped = f"`{DDPG}` was not run with {least.label}"
    if low is not None and high is not None:
        better = high["reached"][0] > low["reached"][0]
        falls = low["fallen"][0] > high["fallen"][0]
        where = f"with {least.label} and {most.label}"
        rates, dropped = (
            f"`{DDPG}` {percent(low[name][0])} and {percent(high[name][0])} {where}"
            for name in ("reached", "fallen")
        )
    learned, end = None, trained[-1]
    shown = f"`{DDPG}` was not run with {most.label}"
    if end is not None:
        rate = [end[part]["reached"][0] for part in ("first", "last")]
        learned = rate[1] > rate[0]
        shown = f"`{DDPG}` from {percent(rate[0])} to {percent(rate[1])} of episodes"
        shown += f" over {over(experiment, end)}"
    full = at_length(experiment, trained[0], end)
    parts = (
        Part("the larger d, the more goals", better, rates, at_length(experiment, *trained)),
        Part("without it the bicycle falls", falls, dropped, full),
        Part("in training it comes to arrive", learned, shown, at_length(experiment, end)),
    )
    names = (DDPG, "fast", "lqr", "lqr-20cm")
    return FigureVerdict(parts, (arrivals(summary, experiment, names),))


def goals(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Judge figures 13 and 14: the trained bicycle arrives from anywhere."""
    names = (DDPG, "fast", "fixed-speed", "lqr", "lqr-20cm")
    arrival_note = arrivals(summary, experiment, names)
    trained, ridden = training(summary, arm=DDPG), rides(summary, rider=DDPG)
    if trained is None or ridden is None:
        return FigureVerdict(not_run("it arrives from anywhere"), (arrival_note,))
    start, end = ({n: trained[p][n][0] for n in ("return", "steps")} for p in ("first", "last"))
    full, rate = at_length(experiment, trained), ridden["reached"][0]
    shown = f"`{DDPG}` reaches {percent(rate)}{of_runs(ridden)} after {over(experiment, trained)}"
    arrives = Part(f"it arrives from anywhere ({percent(MOST)})", rate >= MOST, shown, full)
    shown = f"from {number(start['return'])} to {number(end['return'])}"
    small = end["return"] > 0.1 * start["return"]
    returns = Part("the return converges to zero (to a tenth)", small, shown, full)
    shown = f"from {number(start['steps'])} to {number(end['steps'])}"
    steps = Part("the steps fall (to half)", end["steps"] < 0.5 * start["steps"], shown, full)
    return FigureVerdict((arrives, returns, steps), (arrival_note,))


def turn(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Figure 15: the pedal helps, by slowing down to turn."""
    names = ("pedal", "no-pedal")
    trained = [training(summary, arm=DDPG, variant=name) for name in names]
    ridden = [rides(summary, rider=DDPG, variant=name) for name in names]
    slow = first(summary["profiles"], rider=DDPG, variant="pedal")
    arrival_note = arrivals(
        summary, experiment, (DDPG, "fast", "learned-speed", "lqr-displacement-pedal")
    )
    earns = slows = None
    shown = speeds = f"`{DDPG}` was not run"
    if ridden[0] is not None and ridden[1] is not None:
        returns = [entry["return"][0] for entry in ridden if entry is not None]
        earns = returns[0] > returns[1]
        shown = f"`{DDPG}` returns {number(returns[0])} with and {number(returns[1])} without"
    if slow is not None:
        slows = slow["least"] < slow["start"] - 0.1 and slow["end"] > slow["least"] + 0.1
        speeds = _speeds(DDPG, slow, "least")
    lengths = [over(experiment, entry) for entry in trained if entry is not None]
    said = [f"`{DDPG}`: {' and '.join(lengths)}."] if lengths else []
    ours = first(summary["profiles"], rider="fast", variant="pedal")
    said += [_speeds("fast", ours, "least") + "."] if ours is not None else []
    parts = (
        Part("the pedal earns more", earns, shown, at_length(experiment, *trained)),
        Part("it slows, turns and speeds up", slows, speeds, at_length(experiment, trained[0])),
    )
    return FigureVerdict(parts, (*said, arrival_note))


def _speeds(rider: str, profile: Entry, where: str) -> str:
    """Return a controller's speed at the start, at its least or after 100 steps, and the end."""
    middle = f"{number(profile['least'])} m/s at step {profile['least_at']}"
    if where != "least":
        middle = f"{number(profile['at_100'])} m/s after 100 steps"
    end = f"{number(profile['end'])} m/s at step {profile['end_at']}"
    return f"`{rider}` goes from {number(profile['start'])} m/s to {middle} and {end}"


def speed(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Figure 16: return up, steps and distance down; slower first, then around 2 m/s."""
    names = (DDPG, "fast", "learned-speed", "lqr-displacement-pedal")
    notes = [arrivals(summary, experiment, names)]
    for name in names:
        found = first(summary["profiles"], rider=name)
        notes += [_speeds(name, found, "100") + "."] if found is not None else []
    trained, slow = training(summary, arm=DDPG), first(summary["profiles"], rider=DDPG)
    if trained is None or slow is None:
        return FigureVerdict(not_run("return, steps and distance improve"), tuple(notes))
    full, parts = at_length(experiment, trained), []
    claims = (("return", "rises", 1.0), ("steps", "fall", -1.0), ("distance", "falls", -1.0))
    for name, moves, better in claims:
        start, end = (trained[part][name][0] for part in ("first", "last"))
        shown = f"from {number(start)} to {number(end)}"
        parts.append(Part(f"{name} {moves}", better * end > better * start, shown, full))
    shown = f"{number(slow['at_100'])} m/s after {number(slow['start'])} m/s"
    parts.append(Part("slower after 100 steps", slow["at_100"] < slow["start"], shown, full))
    shown = f"{number(slow['end'])} m/s at step {slow['end_at']}"
    parts.append(Part("then around 2 m/s", 1.5 < slow["end"] < 2.5, shown, full))
    notes.insert(0, f"`{DDPG}`: {over(experiment, trained)}{of_runs(trained)}.")
    return FigureVerdict(tuple(parts), tuple(notes))


def robustness(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Compare the learned controllers with the classical one, and name their weakest point."""
    parts = []
    for rider in dict.fromkeys(entry["rider"] for entry in summary["rides"]):
        mine = [entry for entry in summary["rides"] if entry["rider"] == rider]
        worst = min(mine, key=lambda entry: entry["reached"][0])
        text = experiment.variant(worst["variant"]).label
        parts.append(f"`{rider}` {percent(worst['reached'][0])} ({text})")
        trained = training(summary, arm=rider)
        if trained is not None and is_short(experiment, trained):
            parts[-1] += f" after {over(experiment, trained)}"
    return FigureVerdict((), (f"Fewest goals, and where: {', '.join(parts)}.",))


def cause(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Return the results of the rides with each change; the paper claims nothing about it."""
    names = tuple(dict.fromkeys(entry["rider"] for entry in summary["rides"]))
    return FigureVerdict((), (arrivals(summary, experiment, names),))
