"""RESULTS.md and a page per figure, regenerated completely from the data folders.

RESULTS.md consists of the handwritten `OUT/summary.md`, whose fields are filled with numbers
here, and a table with one row per figure; the pages are in `docs/reproduction` beside it.
"""

from __future__ import annotations

import os
from pathlib import Path

from bicycle_controller.policy.policy import write_atomically
from bicycle_controller.reproduce import experiment as experiments
from bicycle_controller.reproduce.experiment import MODES
from bicycle_controller.reproduce.overview import causes, overview
from bicycle_controller.reproduce.page import page
from bicycle_controller.reproduce.result import ExperimentResult, collect, title
from bicycle_controller.reproduce.summary_fields import filled

BY_HAND = "summary.md"
"""Handwritten summary in the folder of results."""
PAGES = Path("docs", "reproduction")
"""Folder of the figures' pages, relative to RESULTS.md."""
HEAD = "# The paper's experiments, reproduced\n"
BELOW = """\
Made by `bicycle reproduce` from the CSV and JSON files that each figure's page names; a test makes
all of it again. Above, the sentences are written by hand and their numbers are filled in."""


def write_results(out: Path, path: Path) -> None:
    """Write `path` and the figures' pages from all results in `out`.

    Raises:
        ValueError: if `summary.md` has a field without data.
    """
    pages = render_pages(out, path.parent)
    write_atomically(path, render(out, path.parent).encode())
    (path.parent / PAGES).mkdir(parents=True, exist_ok=True)
    for name, text in pages.items():
        write_atomically(path.parent / PAGES / name, text.encode())


def render(out: Path, where: Path) -> str:
    """Return RESULTS.md for the folder `where`."""
    results = collect(out)
    by_hand = out / BY_HAND
    lines = [HEAD]
    if by_hand.exists():
        lines += [filled(by_hand.read_text().strip(), results, by_hand), ""]
    lines += [BELOW, ""]
    figures = [item for item in results if item.experiment.picture != "cause"]
    for mode in MODES:
        mine = [item for item in figures if item.mode == mode]
        if mine:
            lines += [*overview(mine, mode, PAGES), ""]
    if len(figures) < len(results):
        lines += [*causes([item for item in results if item not in figures], PAGES), ""]
    missing = _missing(results)
    if missing:
        lines += [f"Not run here: {', '.join(missing)}.", ""]
    return "\n".join(lines).rstrip() + "\n"


def render_pages(out: Path, where: Path) -> dict[str, str]:
    """Return the figures' pages, by file name."""
    results = collect(out)
    texts = {}
    for name in dict.fromkeys(item.experiment.name for item in results):
        mine = [item for item in results if item.experiment.name == name]
        links = {item.mode: os.path.relpath(item.folder, where / PAGES) for item in mine}
        up = os.path.relpath(where / "RESULTS.md", where / PAGES)
        texts[f"{name}.md"] = page(mine, links, up)
    return texts


def _missing(results: list[ExperimentResult]) -> list[str]:
    """Return the names of experiments without results."""
    there = {(item.experiment.name, item.mode) for item in results}
    return [
        f"{title(experiments.load(name))} ({mode})"
        for name in [*experiments.names(), *experiments.causes()]
        for mode in MODES
        if (name, mode) not in there
    ]
