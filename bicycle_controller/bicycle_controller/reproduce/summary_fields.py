"""Fields of the handwritten summary: `{10 faithful authors reached}` becomes a number.

A field names figure, physics and the requested value: `verdict`, or a controller and a measure
of its rides (`reached`, `fallen`, `return`, `steps`, `time_s`, `speed`) or of its training
(`runs`, `first-return`, `last-return`). A slash appends a controller's variant:
`{12 faithful fast/d-0-cm reached}`.
"""

from __future__ import annotations

import re
from pathlib import Path

from bicycle_controller.reproduce.claims import verdict
from bicycle_controller.reproduce.formatting import number, percent
from bicycle_controller.reproduce.result import ExperimentResult
from bicycle_controller.reproduce.verdicts import over, rides, training

FIELD = re.compile(r"\{([^{}]+)\}")
SHARES = ("reached", "fallen", "orbits")
RIDES = ("return", "steps", "time_s", "speed")


def filled(text: str, results: list[ExperimentResult], source: Path) -> str:
    """Return the text with its fields replaced by their values.

    Raises:
        ValueError: if a field requests something that the results do not contain.
    """

    def value(match: re.Match[str]) -> str:
        try:
            return _value(match[1].split(), results)
        except (LookupError, TypeError, ValueError):
            raise ValueError(
                f"{source}: the results hold nothing for {match[0]!r}: name a figure, a mode of"
                " the physics, a controller and a measure, or verdict"
            ) from None

    return FIELD.sub(value, text)


def _value(words: list[str], results: list[ExperimentResult]) -> str:
    figure, mode, *asked = words
    name = f"figure-{figure}" if figure.isdigit() else figure
    (item,) = [r for r in results if (r.experiment.name, r.mode) == (name, mode)]
    if asked == ["verdict"]:
        return verdict(item.experiment, item.summary).word
    controller, measure = asked
    rider, _, variant = controller.partition("/")
    where = {"variant": variant} if variant else {}
    if measure == "runs" or measure.startswith(("first-", "last-")):
        trained = training(item.summary, arm=rider, **where)
        if trained is None:
            raise KeyError(rider)
        if measure == "runs":
            return over(item.experiment, trained)
        part, _, column = measure.partition("-")
        mean = trained[part][column][0]
        return percent(mean) if column in SHARES else number(mean)
    entry = rides(item.summary, rider=rider, **where)
    if entry is None or measure not in (*SHARES, *RIDES):
        raise KeyError(measure)
    return percent(entry[measure][0]) if measure in SHARES else number(entry[measure][0])
