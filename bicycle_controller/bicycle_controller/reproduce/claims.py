"""Whether the paper's claims held: one sentence each, in numbers of the summary alone.

A claim about what an algorithm comes to can be refuted by a run that is shorter than the
paper's only in part: where it is short, the sentence says over what length it speaks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.words import lengths, number, percent

Entry = dict[str, Any]
Summary = dict[str, Any]

DEGREES = 57.29577951308232
MOST = 0.99
"""Share of goals that counts as all."""
SETTLED = 0.05
"""rad within which a state counts as zero."""
NOT_RUN = "Not run: nothing was trained in this mode."


def verdict(experiment: Experiment, summary: Summary) -> str:
    """The sentence for an experiment's summary."""
    return CLAIMS[experiment.picture](experiment, summary)


def _training(summary: Summary, **wanted: str) -> Entry | None:
    return _first(summary["training"], **wanted)


def _rides(summary: Summary, **wanted: str) -> Entry | None:
    return _first(summary["rides"], **wanted)


def _first(entries: list[Entry], **wanted: str) -> Entry | None:
    fits = (e for e in entries if all(e[key] == value for key, value in wanted.items()))
    return next(fits, None)


def _over(experiment: Experiment, entry: Entry) -> str:
    """Over what length an entry speaks."""
    full = experiment.full
    text = f"{entry['runs']} × {lengths(entry)} episodes"
    return f"{text} of the paper's {number(full.episodes)}" if _short(experiment, entry) else text


def _short(experiment: Experiment, entry: Entry | None) -> bool:
    """Whether an entry's runs are shorter or fewer than the paper's."""
    full = experiment.full
    return entry is None or entry["length"] < 0.99 * full.episodes or entry["runs"] < full.seeds


def _held(parts: list[bool], short: bool = False) -> str:
    """How far a claim of several parts held; a short run cannot refute one."""
    if parts and all(parts):
        return "Held so far" if short else "Held"
    if any(parts):
        return "Held in part so far" if short else "Held in part"
    return "Not shown by runs this short" if short else "Did not hold"


def _terms(experiment: Experiment, summary: Summary) -> str:
    """Figure 9: every term shrinks, and the heading term is the largest at first."""
    found = _training(summary, arm="authors") or _training(summary, arm="paper")
    if found is None:
        return NOT_RUN
    names = ("lean_angle", "lean_rate", "lean_acceleration", "heading_error")
    first, last = ({n: -found[part][n][0] for n in names} for part in ("first", "last"))
    shrunk = [name for name in names if last[name] < first[name]]
    largest = max(first, key=lambda name: first[name]) == "heading_error"
    others = sum(first[n] for n in names[:3]), sum(last[n] for n in names[:3])
    gap = first["heading_error"] / others[0], last["heading_error"] / others[1]
    words = _held([largest, len(shrunk) == 4], _short(experiment, found))
    return (
        f"{words}: over {_over(experiment, found)} of `{found['arm']}`"
        f" {len(shrunk)} of 4 terms shrank; the heading term went from"
        f" {number(-first['heading_error'])} to {number(-last['heading_error'])} an episode and"
        f" the three lean terms together from {number(-others[0])} to {number(-others[1])}, so"
        f" their ratio went from {number(gap[0])} to {number(gap[1])}."
    )


def _learning(experiment: Experiment, summary: Summary) -> str:
    """Figure 10: DDPG ends above NAF and PPO."""
    ours = _training(summary, arm="authors") or _training(summary, arm="paper")
    others = [_training(summary, arm=name) for name in ("naf", "ppo")]
    rivals = [entry for entry in others if entry is not None]
    if ours is None or not rivals:
        return NOT_RUN
    above = [ours["last"]["return"][0] > entry["last"]["return"][0] for entry in rivals]
    parts = [
        f"`{entry['arm']}` {number(entry['last']['return'][0])}{_half(entry)} after"
        f" {_over(experiment, entry)}"
        for entry in (ours, *rivals)
    ]
    short = any(_short(experiment, entry) for entry in (ours, *rivals))
    text = f"{_held(above, short)}: return in the last tenth of training: {', '.join(parts)}"
    return text + _best_rides(summary, ("authors", "naf", "ppo", "fast", "fixed-speed")) + "."


def _half(entry: Entry) -> str:
    """± half of the interval over runs."""
    middle, low, _ = entry["last"]["return"]
    return "" if low is None else f" ± {number(middle - low)}"


def _best_rides(summary: Summary, names: tuple[str, ...]) -> str:
    """What the best policies reach without noise."""
    found = [_rides(summary, rider=name) for name in names]
    parts = [f"`{e['rider']}` {percent(e['reached'][0])}" for e in found if e is not None]
    return f"; goals without noise: {', '.join(parts)}" if parts else ""


def _states(experiment: Experiment, summary: Summary) -> str:
    """Figure 11: the states come to rest near zero."""
    parts, held = [], []
    for entry in summary["states"]:
        if not entry["reached"]:
            parts.append(f"`{entry['rider']}` never arrives")
            continue
        lean, error = entry["lean_angle"]["end"], entry["heading_error"]["end"]
        if entry["role"] != "lqr":
            held += [True, lean < SETTLED and error < SETTLED]
        parts.append(
            f"`{entry['rider']}` arrives upright, its mean lean in the last second"
            f" {number(DEGREES * lean)}° and its heading error {number(DEGREES * error)}°"
        )
    words = f"{_held(held)} (stable; settled within {number(DEGREES * SETTLED)}°)"
    return f"{words}: {'; '.join(parts)}."


def _displacement(experiment: Experiment, summary: Summary) -> str:
    """Figure 12: the more displacement, the better."""
    least, most = experiment.variants[0], experiment.variants[-1]
    parts, held = [], []
    for rider in ("authors", "fast", "fixed-speed", "lqr-20cm", "lqr"):
        low, high = (_rides(summary, rider=rider, variant=v.name) for v in (least, most))
        if low is None or high is None:
            continue
        if _training(summary, arm=rider) is not None:
            held.append(high["reached"][0] > low["reached"][0])
        rates = f"{percent(low['reached'][0])} and {percent(high['reached'][0])}"
        parts.append(f"`{rider}` {rates}, falls {percent(low['fallen'][0])}")
    short = any(_short(experiment, entry) for entry in summary["training"])
    words = _held(held, short) if held else "Not tested (nothing was trained with both)"
    shown = "; ".join(parts)
    return (
        f"{words}: goals without noise with {least.label} and {most.label}, and falls with the"
        f" former: {shown}."
    )


def _goals(experiment: Experiment, summary: Summary) -> str:
    """Figures 13 and 14: trained, the bicycle arrives from anywhere."""
    found = [
        _rides(summary, rider=name)
        for name in ("authors", "fast", "fixed-speed", "lqr", "lqr-20cm")
    ]
    entries = [entry for entry in found if entry is not None]
    learned = [entry for entry in entries if entry["role"] != "lqr"]
    parts = [
        f"`{entry['rider']}` {percent(entry['reached'][0])} in {number(entry['steps'][0])} steps"
        for entry in entries
    ]
    trained = _training(summary, arm="authors")
    ours = [e["reached"][0] for e in learned if e["role"] == "best"]
    theirs = [e["reached"][0] for e in learned if e["role"] != "best"]
    text = f"{_held([max(ours, default=0.0) >= MOST])} for ours (at least {percent(MOST)})"
    if theirs:
        words = _held([max(theirs) >= MOST], _short(experiment, trained))
        text += f"; {words[0].lower()}{words[1:]} for the authors' settings"
    text += f": goals and mean steps without noise: {', '.join(parts)}"
    if trained is not None:
        steps = [number(trained[part]["steps"][0]) for part in ("first", "last")]
        text += f"; steps of an episode of `authors` over {_over(experiment, trained)}: from"
        text += f" {steps[0]} to {steps[1]}"
    return text + "."


def _turn(experiment: Experiment, summary: Summary) -> str:
    """Figure 15: the pedal helps, by slowing down to turn."""
    parts, held = [], []
    for rider in ("authors", "fast"):
        pair = [_rides(summary, rider=rider, variant=name) for name in ("pedal", "no-pedal")]
        with_pedal, without = pair
        if with_pedal is None or without is None:
            continue
        held.append(with_pedal["return"][0] > without["return"][0])
        returns = [number(entry["return"][0]) for entry in (with_pedal, without)]
        rates = [percent(entry["reached"][0]) for entry in (with_pedal, without)]
        parts.append(
            f"`{rider}` returns {returns[0]} with and {returns[1]} without ({rates[0]} and"
            f" {rates[1]} of goals)"
        )
    if not held:
        return NOT_RUN
    short = any(_short(experiment, entry) for entry in summary["training"])
    for rider in ("fast", "authors"):
        slow = _first(summary["profiles"], rider=rider, variant="pedal")
        if slow is not None:
            slows = slow["least"] < slow["start"] - 0.1 and slow["end"] > slow["least"] + 0.1
            held.append(slows)
            parts.append(
                f"`{rider}` goes from {number(slow['start'])} m/s to {number(slow['least'])} m/s"
                f" at step {slow['least_at']} and {number(slow['end'])} m/s at the end"
            )
            break
    return f"{_held(held, short)}: {'; '.join(parts)}."


def _speed(experiment: Experiment, summary: Summary) -> str:
    """Figure 16: return up, steps and distance down; slower first, then around 2 m/s."""
    trained = _training(summary, arm="authors")
    parts, held = [], []
    if trained is not None:
        first, last = trained["first"], trained["last"]
        held.append(last["return"][0] > first["return"][0])
        held.append(last["distance"][0] < first["distance"][0])
        for name in ("return", "steps", "distance"):
            values = f"{number(first[name][0])} to {number(last[name][0])}"
            parts.append(f"{name} from {values}")
        parts[-1] += f" over {_over(experiment, trained)} of `authors`"
    for rider in ("authors", "fast", "lqr-displacement-pedal"):
        ridden = _rides(summary, rider=rider)
        slow = _first(summary["profiles"], rider=rider)
        if ridden is not None and slow is not None:
            if rider != "lqr-displacement-pedal":
                held.append(slow["at_100"] < slow["start"])
            parts.append(
                f"`{rider}` reaches {percent(ridden['reached'][0])}, its speed"
                f" {number(slow['start'])} m/s at the start, {number(slow['at_100'])} after 100"
                f" steps, {number(slow['end'])} at step {slow['end_at']}"
            )
    words = _held(held, _short(experiment, trained))
    return f"{words}: {'; '.join(parts)}." if held else NOT_RUN


def _robustness(experiment: Experiment, summary: Summary) -> str:
    """The learned controllers against the classical one, and their weakest point."""
    parts = []
    for (rider,) in dict.fromkeys((entry["rider"],) for entry in summary["rides"]):
        mine = [entry for entry in summary["rides"] if entry["rider"] == rider]
        worst = min(mine, key=lambda entry: entry["reached"][0])
        text = experiment.variant(worst["variant"]).label
        parts.append(f"`{rider}` at worst {percent(worst['reached'][0])} ({text})")
    best, classical = (_worst(summary, name) for name in ("fixed-speed", "lqr"))
    better = best is not None and classical is not None and best >= classical
    words = "is at least as robust as" if better else "is less robust than"
    return f"By its worst case the shipped actor {words} LQR: {', '.join(parts)}."


def _worst(summary: Summary, rider: str) -> float | None:
    found = [e["reached"][0] for e in summary["rides"] if e["rider"] == rider]
    return min(found, default=None)


CLAIMS: dict[str, Callable[[Experiment, Summary], str]] = {
    "terms": _terms,
    "learning": _learning,
    "states": _states,
    "displacement": _displacement,
    "goals": _goals,
    "turn": _turn,
    "speed": _speed,
    "robustness": _robustness,
}
