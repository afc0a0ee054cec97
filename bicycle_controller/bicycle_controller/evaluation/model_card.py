"""Model card of a policy: a Markdown page beside the weights, made from recorded facts only."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from bicycle_common.observation import ACTION_FIELDS
from bicycle_controller.evaluation.table import as_markdown
from bicycle_controller.policy.inputs import UNITS, parse
from bicycle_controller.policy.policy import Policy
from bicycle_sim.plants import registry


def card(policy: Policy, evaluations: list[dict[str, Any]] | None = None) -> str:
    """Return the page.

    Args:
        policy: its metadata are the source.
        evaluations: summaries as `bicycle evaluate --json` prints them.

    Returns:
        Markdown.
    """
    info = policy.info
    parts = [
        f"# {info.name}",
        f"A bicycle's controller, `{policy.policy_id}`: a network from {_seen(policy)}"
        f" to its actions, {' - '.join(map(str, widths(policy)))}.",
        "## Use",
        f"```sh\nbicycle evaluate {info.name} --episodes 1000\n```",
        "## Inputs and outputs",
        _scaling(policy),
        "## Trained on",
        _facts(asdict(info.scenario)),
        f"Physics: {info.plant.label}, {info.plant.time_step} s a step.{_plants(policy)}",
        "## Training",
        _facts(info.trained) if info.trained else "Not recorded.",
    ]
    for item in evaluations or []:
        parts += [_heading(item), as_markdown(item)]
    return "\n\n".join(parts) + "\n"


def widths(policy: Policy) -> list[int]:
    """Return the widths of the network's inputs, hidden layers and outputs."""
    count = sum(name.startswith("layer.") for name in policy.tensors) // 2
    return [
        len(policy.info.inputs),
        *(len(policy.tensors[f"layer.{index}.bias"]) for index in range(count)),
    ]


def _seen(policy: Policy) -> str:
    """Return the controller's inputs, in words."""
    inputs = policy.inputs
    if inputs.plain:
        return "the six states of the paper"
    words = "what it sees"
    if inputs.memory:
        words += f" and saw in the last {inputs.memory} periods"
    return words + (
        f", told {len(inputs.plant_parameters)} numbers of the bicycle,"
        if inputs.plant_parameters
        else ""
    )


def _plants(policy: Policy) -> str:
    """Return the other plants of its training, in words."""
    info = policy.info
    text = f" Trained to ride any bicycle of: {', '.join(info.plants)}." if info.plants else ""
    if info.speeds is not None:
        text += f" Speeds {info.speeds[0]:g} to {info.speeds[1]:g} m/s."
    return text


def _scaling(policy: Policy) -> str:
    """Return a table of the inputs' scale and the action's limits."""
    info = policy.info
    lines = ["| | divided by | |", "| --- | --- | --- |"]
    rows: dict[tuple[str, float], list[int]] = {}
    for name, scale in zip(info.inputs, info.observation_scale, strict=True):
        field, age = parse(name)
        rows.setdefault((field, scale), []).append(age)
    for (field, scale), ages in rows.items():
        lines.append(f"| {field}{_ages(ages)} | {scale:g} | {UNITS.get(field, '')} |")
    lines += ["", "| | at most | |", "| --- | --- | --- |"]
    for name, limit in zip(ACTION_FIELDS, info.action_limits, strict=True):
        lines.append(f"| {name} | {limit:g} | {UNITS[name]} |")
    return "\n".join(lines)


def _ages(ages: list[int]) -> str:
    """Return the ages of one input in words; nothing if it is of now."""
    if ages == [0]:
        return ""
    runs = ages == list(range(ages[0], ages[-1] + 1)) and len(ages) > 1
    shown = f"{ages[0]} to {ages[-1]}" if runs else ", ".join(map(str, ages))
    return f", {shown} periods ago"


def _facts(data: dict[str, Any]) -> str:
    """Return a list with one line per entry."""
    return "\n".join(f"- {name}: `{_plain(value)}`" for name, value in data.items())


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _heading(summary: dict[str, Any]) -> str:
    """Return the conditions of an evaluation, as far as they differ from the plain scenario."""
    disturbed = {k: v for k, v in summary["disturbance"].items() if k != "kick_time" and _on(v)}
    physics = registry.from_dict(summary["physics"]).label
    extra = "".join(f", {name} {_plain(value)}" for name, value in disturbed.items())
    seed = summary["seed"]
    return f"## Evaluation: {summary['scenario']['name']}, {physics} physics, seed {seed}{extra}"


def _on(value: Any) -> bool:
    return any(value) if isinstance(value, (list, tuple)) else bool(value)
