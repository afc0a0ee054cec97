"""Model card of a policy: a Markdown page beside the weights, made from recorded facts only."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_controller.evaluation.table import as_markdown
from bicycle_controller.policy.policy import Policy
from bicycle_sim.plants import registry

UNITS = ("rad", "rad/s", "rad", "rad/s", "rad/s^2", "rad", "N m", "m", "N")


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
        f"A bicycle's controller, `{policy.policy_id}`: a network from the six states of the paper"
        f" to its actions, {' - '.join(map(str, widths(policy)))}.",
        "## Use",
        f"```sh\nbicycle evaluate {info.name} --episodes 1000\n```",
        "## Inputs and outputs",
        _scaling(policy),
        "## Trained on",
        _facts(asdict(info.scenario)),
        f"Physics: {info.plant.label}, {info.plant.time_step} s a step.",
        "## Training",
        _facts(info.trained) if info.trained else "Not recorded.",
    ]
    for item in evaluations or []:
        parts += [_heading(item), as_markdown(item)]
    return "\n\n".join(parts) + "\n"


def widths(policy: Policy) -> list[int]:
    """Return the widths of the network's inputs, hidden layers and outputs."""
    count = sum(name.startswith("layer.") for name in policy.tensors) // 2
    return [6, *(len(policy.tensors[f"layer.{index}.bias"]) for index in range(count))]


def _scaling(policy: Policy) -> str:
    """Return a table of the observation's scale and the action's limits."""
    info = policy.info
    lines = ["| | divided by | |", "| --- | --- | --- |"]
    for name, scale, unit in zip(OBSERVATION_FIELDS, info.observation_scale, UNITS, strict=False):
        lines.append(f"| {name} | {scale:g} | {unit} |")
    lines += ["", "| | at most | |", "| --- | --- | --- |"]
    for name, limit, unit in zip(ACTION_FIELDS, info.action_limits, UNITS[6:], strict=True):
        lines.append(f"| {name} | {limit:g} | {unit} |")
    return "\n".join(lines)


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
