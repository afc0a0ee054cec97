"""RESULTS.md, from the data folders alone: regenerated whole, so that no number is left over."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bicycle_controller.policy import write_atomically
from bicycle_controller.reproduce import experiment as experiments
from bicycle_controller.reproduce.claims import verdict
from bicycle_controller.reproduce.experiment import MODES, Experiment
from bicycle_controller.reproduce.pictures import PICTURE
from bicycle_controller.reproduce.style import label
from bicycle_controller.reproduce.words import lengths, mean, percent, rate

HEAD = """\
# The paper's experiments, reproduced

Written by `bicycle reproduce`; do not edit. Every number comes from the CSV and JSON files that
its section names, and a test makes this page again from them. Intervals are 95 %: Student's t
over training runs, Wilson's for shares of rides. A run is `short` of the paper's length where
its row says so.

`paper` is DDPG by tables 2 and 3 as printed, `authors` by what their code ran, `fast` is ours;
all three are trained here. `fixed-speed` is the actor that the package shipped when a section's
data were made; the section names its id. LQR is the classical controller that a learned one must
beat.
"""
COLUMNS = "| figure | physics | the paper reports | its DDPG here | ours | LQR | did it hold? |"
GROUPS = (("paper", "authors"), ("best",), ("lqr",))


@dataclass(frozen=True)
class Result:
    """One experiment in one mode of the physics, from its folder."""

    experiment: Experiment
    mode: str
    folder: Path
    summary: dict[str, Any]
    run: dict[str, Any]


def collect(out: Path) -> list[Result]:
    """What the folder of results holds, in the paper's order."""
    found = []
    for name in experiments.names():
        for mode in MODES:
            folder = out / name / mode
            if (folder / "summary.json").exists():
                texts = [(folder / f"{part}.json").read_text() for part in ("summary", "run")]
                parts = [json.loads(text) for text in texts]
                found.append(Result(experiments.load(name), mode, folder, *parts))
    return found


def write_results(out: Path, path: Path) -> None:
    """Write `path` from all results in `out`."""
    write_atomically(path, render(out, path.parent).encode())


def render(out: Path, where: Path) -> str:
    """The page; its links are relative to the folder `where`."""
    results = collect(out)
    lines = [HEAD, COLUMNS, "| --- " * (COLUMNS.count("|") - 1) + "|"]
    lines += [_overview(item) for item in results]
    missing = _missing(results)
    if missing:
        lines += ["", f"Not run here: {', '.join(missing)}."]
    for name in dict.fromkeys(item.experiment.name for item in results):
        mine = [item for item in results if item.experiment.name == name]
        lines += ["", *_section(mine, where)]
    return "\n".join(lines) + "\n"


def _missing(results: list[Result]) -> list[str]:
    """What there are no results of."""
    there = {(item.experiment.name, item.mode) for item in results}
    return [
        f"{_title(experiments.load(name))} ({mode})"
        for name in experiments.names()
        for mode in MODES
        if (name, mode) not in there
    ]


def _title(item: Experiment) -> str:
    return item.name.replace("figure-", "Figure ").replace("robustness", "Robustness")


def _overview(item: Result) -> str:
    """A row of the first table."""
    cells = [_title(item.experiment), item.mode, item.experiment.paper]
    cells += [_cell(item, roles) for roles in GROUPS]
    return "| " + " | ".join([*cells, verdict(item.experiment, item.summary)]) + " |"


def _cell(item: Result, roles: tuple[str, ...]) -> str:
    """The best that controllers of these roles came to, over all variants."""
    found: dict[str, list[dict[str, Any]]] = {}
    for entry in item.summary["rides"]:
        if entry["role"] in roles:
            found.setdefault(entry["rider"], []).append(entry)
    texts = []
    for rider, entries in found.items():
        rates = [entry["reached"][0] for entry in entries]
        spread = percent(rates[0])
        if len(rates) > 1:
            spread = f"{percent(min(rates))} to {percent(max(rates))}"
        texts.append(f"{rider}: {spread} of goals")
    return "; ".join(texts) or "not run"


def _section(results: list[Result], where: Path) -> list[str]:
    """Everything about one experiment."""
    item = results[0].experiment
    command = f"bicycle reproduce {item.name.removeprefix('figure-')}"
    lines = [f"## {_title(item)}: {item.title}", ""]
    lines += [f"`{command}` · The paper reports: {item.paper}", ""]
    lines += [f"What differs: {item.differs}"]
    for result in results:
        data = os.path.relpath(result.folder, where)
        words = verdict(item, result.summary)
        lines += ["", f"### {_title(item)}, {result.mode} physics", "", words, ""]
        lines += [f"![{item.title}]({data}/{PICTURE})", "", *_provenance(result, data), ""]
        lines += _training_table(result)
        lines += _rides_table(result)
    return lines


def _provenance(result: Result, data: str) -> list[str]:
    """Where the numbers come from."""
    run = result.run
    trained = run["training"]
    cpu = sum(entry.get("cpu_s", 0.0) for entry in trained)
    text = f"Data: [{data}]({data}), `{run['command']}` at commit {run['commit'][:10]}"
    text += f", rides from seed {run['ride_seed']}"
    if trained:
        text += f"; {len(trained)} training runs, {cpu / 60:.0f} minutes of processor time in all"
    shipped = [name for name in run["policies"].values() if "lqr" not in name]
    if shipped:
        text += f"; the shipped actor is {', '.join(f'`{name}`' for name in shipped)}"
    return [text + "."]


def _training_table(result: Result) -> list[str]:
    """What training came to, by arm and variant."""
    rows = result.summary["training"]
    if not rows:
        return []
    head = "| trained | runs × episodes | return, first tenth | last tenth | reached | fell |"
    lines = [head, "| --- " * (head.count("|") - 1) + "|"]
    for row in rows:
        cells = [_named(result, row["arm"], row["variant"]), _length(result, row)]
        cells += [mean(row["first"]["return"]), mean(row["last"]["return"])]
        cells += [mean(row["last"][name], 100.0, " %") for name in ("reached", "fallen")]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def _length(result: Result, row: dict[str, Any]) -> str:
    """Runs and their length, and the paper's where it is longer."""
    full = result.experiment.full
    most = next(arm.most_steps for arm in result.experiment.arms if arm.name == row["arm"])
    asked = min(full.episodes, most / result.experiment.limit) if most else full.episodes
    text = f"{row['runs']} × {lengths(row)}"
    short = row["length"] < 0.99 * asked or row["runs"] < full.seeds
    return f"{text} (short: {full.seeds} × {asked:,.0f})" if short else text


def _rides_table(result: Result) -> list[str]:
    """What rides without noise came to."""
    head = "| rides without noise | rides | reached | fell | steps | return | median time |"
    lines = [head, "| --- " * (head.count("|") - 1) + "|"]
    for row in result.summary["rides"]:
        cells = [_named(result, row["rider"], row["variant"]), f"{row['rides']:,}"]
        cells += [rate(row["reached"]), rate(row["fallen"])]
        cells += [mean(row["steps"]), mean(row["return"]), mean(row["time_s"], 1.0, " s")]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _named(result: Result, name: str, variant: str) -> str:
    """A controller, and the variant where there are several."""
    words = label(name) if label(name) == name else f"{label(name)} (`{name}`)"
    text = result.experiment.variant(variant).label if variant else ""
    return f"{words}, {text}" if text else words
