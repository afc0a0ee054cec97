"""Page of one figure: the verdict on its claims, its pictures, and all its numbers."""

from __future__ import annotations

from typing import Any

from bicycle_controller.reproduce.claims import verdict
from bicycle_controller.reproduce.formatting import lengths, mean, rate
from bicycle_controller.reproduce.pictures import PICTURE
from bicycle_controller.reproduce.result import ExperimentResult, title
from bicycle_controller.reproduce.style import label
from bicycle_controller.reproduce.verdicts import FigureVerdict, asked, is_short

READING = """\
`paper` is DDPG by tables 2 and 3 as printed, `authors` by what their code ran, `fast` is ours; all
three are trained here. The shipped actor is the package's when the data were made. LQR is the
classical controller that a learned one must beat. "Held" is said only where the arm that a claim
is about was run at the paper's length and showed it. Numbers of several runs are means over them,
with 95 % bootstrap intervals over the runs in brackets (of two or three: from the least to the
largest), which for shares hold Wilson's over all rides as well; a single run's shares have
Wilson's. A run is `short` of the paper's length where its row says so."""


def page(results: list[ExperimentResult], links: dict[str, str], up: str) -> str:
    """Return the page of one experiment.

    Args:
        results: of the experiment, one per mode of the physics.
        links: the data's folders by mode, from the page.
        up: link to RESULTS.md.
    """
    item = results[0].experiment
    command = f"bicycle reproduce {item.name.removeprefix('figure-')}"
    lines = [
        f"# {item.title}" if item.picture == "cause" else f"# {title(item)}: {item.title}",
        "",
    ]
    lines += [f"Made by `{command}`, do not edit; [all figures]({up}).", ""]
    lines += [f"The paper reports: {item.paper}", "", f"What differs: {item.differs}", "", READING]
    for result in results:
        data = links[result.mode]
        lines += ["", f"## {result.mode.capitalize()} physics", ""]
        lines += [*_claims(verdict(item, result.summary)), ""]
        lines += [f"![{item.title}]({data}/{PICTURE})", "", *_provenance(result, data), ""]
        lines += _training_table(result)
        lines += _rides_table(result)
    return "\n".join(lines) + "\n"


def _claims(found: FigureVerdict) -> list[str]:
    """Return the parts of a claim as a list, then the notes."""
    lines = [f"**{found.word}.**", ""] if found.parts else []
    lines += [f"- {part.text}" for part in found.parts]
    if found.parts:
        lines.append("")
    return [*lines, *found.notes] if len(found.notes) < 2 else [*lines, " ".join(found.notes)]


def _provenance(result: ExperimentResult, data: str) -> list[str]:
    """Return the origin of the numbers."""
    run = result.run
    trained = run["training"]
    cpu = sum(entry.get("cpu_s", 0.0) for entry in trained)
    text = f"Data: [{data}]({data}), `{run['command']}` at commit {run['commit'][:10]}"
    text += f", rides from seed {run['ride_seed']}"
    if trained:
        text += f"; {len(trained)} training runs, {cpu / 60:.0f} minutes of processor time in all"
        names = dict.fromkeys(entry.get("processor", "unknown") for entry in trained)
        text += f" ({', '.join('not recorded' if n == 'unknown' else n for n in names)})"
    shipped = [name for name in run["policies"].values() if "lqr" not in name]
    if shipped:
        text += f"; the shipped actor is {', '.join(f'`{name}`' for name in shipped)}"
    return [text + "."]


def _training_table(result: ExperimentResult) -> list[str]:
    """Return the results of training, by arm and variant."""
    rows = result.summary["training"]
    if not rows:
        return []
    head = "| trained | runs × episodes | return, first tenth | last tenth | reached | fell |"
    lines = [head, "| --- " * (head.count("|") - 1) + "|"]
    for row in rows:
        cells = [_named(result, row["arm"], row["variant"]), _length(result, row)]
        cells += [mean(row["first"]["return"]), mean(row["last"]["return"])]
        cells += [rate(row["last"][name]) for name in ("reached", "fallen")]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def _length(result: ExperimentResult, row: dict[str, Any]) -> str:
    """Return runs and their length, and the requested ones if larger."""
    experiment = result.experiment
    text = f"{row['runs']} × {lengths(row)}"
    full = f"{experiment.full.seeds} × {asked(experiment, row['arm']):,.0f}"
    return f"{text} (short: {full})" if is_short(experiment, row) else text


def _rides_table(result: ExperimentResult) -> list[str]:
    """Return the results of rides without noise."""
    head = "| rides without noise | runs × rides | reached | fell | steps | return | median time |"
    lines = [head, "| --- " * (head.count("|") - 1) + "|"]
    for row in result.summary["rides"]:
        each = f"{row['rides'] // row['runs']:,}"
        count = f"{row['runs']} × {each}" if row["runs"] > 1 else each
        cells = [_named(result, row["rider"], row["variant"]), count]
        cells += [rate(row["reached"]), rate(row["fallen"])]
        cells += [mean(row["steps"]), mean(row["return"]), mean(row["time_s"], 1.0, " s")]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _named(result: ExperimentResult, name: str, variant: str) -> str:
    """Return the name of a controller, with the variant if there are several."""
    words = label(name) if label(name) == name else f"{label(name)} (`{name}`)"
    text = result.experiment.variant(variant).label if variant else ""
    return f"{words}, {text}" if text else words
