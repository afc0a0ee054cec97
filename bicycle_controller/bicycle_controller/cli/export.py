"""Arguments and execution of `bicycle export`."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from bicycle_common.validation import nearest, require
from bicycle_controller.cli import options
from bicycle_controller.evaluation.model_card import card
from bicycle_controller.evaluation.table import as_markdown
from bicycle_controller.policy.policy import Policy, load_policy, save_policy, write_atomically

FORMATS = ("safetensors", "onnx")
EPILOG = """\
POLICY is the name of a shipped policy, a policy file or the folder of a training run (its best).
Written are NAME.safetensors, NAME.onnx and the card NAME.md. The ONNX model takes observations
in SI units and gives actions in N m, m and N; before it is written, ONNX Runtime, torch (where
installed) and numpy must agree about it to 5e-5 of the action limits.

With --csv, POLICY is the folder of a run (its log) or a bag (one topic of it).

examples:
  bicycle export runs/a --csv a.csv
  bicycle export my-ride --csv states.csv --topic bicycle/command
  bicycle evaluate runs/a --episodes 10000 --out a.json
  bicycle export runs/a --name my-policy --evaluation a.json --to policies
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle export`."""
    add = parser.add_argument
    add("policy", metavar="POLICY", help="what to write")
    add("--to", type=Path, metavar="DIR", help="the folder to write to")
    add("--csv", type=Path, metavar="FILE", help="write a run's log or a bag's topic as CSV")
    add("--topic", metavar="NAME", help="with --csv, of a bag (default: bicycle/state)")
    add("--name", metavar="NAME", help="the policy's new name (default: its own)")
    add("--format", action="append", metavar="FORMAT", help="safetensors or onnx (default: both)")
    add(
        "--evaluation",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="what 'bicycle evaluate --out' wrote, for the card; may be repeated",
    )
    options.add_seed(parser, "of the observations compared", default=0)
    options.add_device(parser, "cpu or cuda, where torch compares", default="cpu")
    options.add_json(parser)


def run_command(args: argparse.Namespace) -> int:
    """Write the files, and print their names.

    Returns:
        The exit status.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
        ExportError: if the runtimes disagree.
    """
    if args.csv is not None:
        return _export_csv(args)
    require(args.topic is None, "--topic goes with --csv")
    require(args.to is not None, "give --to DIR for a policy, or --csv FILE for a run or a bag")
    formats = args.format or list(FORMATS)
    for name in formats:
        if name not in FORMATS:
            hint = nearest(name, FORMATS)
            raise ValueError(f"unknown format {name!r}{hint}; known: {', '.join(FORMATS)}")
    require(args.seed >= 0, f"--seed must be zero or more, not {args.seed}")
    policy = source = load_policy(args.policy)
    if args.name is not None:
        policy = Policy(replace(source.info, name=args.name), source.tensors)
    found = [_evaluation(path, {source.policy_id, policy.policy_id}) for path in args.evaluation]
    page = card(policy, [summary | {"controller": policy.policy_id} for summary in found])
    files = {kind: args.to / f"{policy.name}.{kind}" for kind in (*formats, "md")}
    result: dict[str, Any] = {
        "policy_id": policy.policy_id,
        "files": {kind: str(path) for kind, path in files.items()},
    }
    if "onnx" in files:
        result["parity"] = _save_onnx(policy, files["onnx"], args)
    if "safetensors" in files:
        save_policy(policy, files["safetensors"])
    write_atomically(files["md"], page.encode())
    print(json.dumps(result, indent=2) if args.json else _told(result))
    return 0


def _export_csv(args: argparse.Namespace) -> int:
    """Write a table instead of a policy."""
    from bicycle_controller.data import csv_table

    require(args.to is None, "give --csv or --to, not both")
    rows = csv_table.write(csv_table.table_of(Path(args.policy), args.topic), args.csv)
    result = {"file": str(args.csv), "rows": rows}
    print(json.dumps(result, indent=2) if args.json else f"wrote {args.csv}: {rows} rows")
    return 0


def _save_onnx(policy: Policy, path: Path, args: argparse.Namespace) -> dict[str, float]:
    """Write the ONNX model; compare it with torch too if that is installed."""
    from bicycle_controller.policy.export import save_onnx

    try:
        from bicycle_controller.policy.torch_policy import TorchPolicy
    except ModuleNotFoundError:
        return save_onnx(policy, path, seed=args.seed)
    return save_onnx(policy, path, TorchPolicy(policy, args.device), args.seed)


def _evaluation(path: Path, known_as: set[str]) -> dict[str, Any]:
    """Read a summary that `bicycle evaluate --out` wrote for the policy with one of these ids.

    Raises:
        ValueError: if it is not one, or belongs to another policy.
    """
    try:
        summary: dict[str, Any] = json.loads(path.read_text())
        about = str(summary["controller"])
        as_markdown(summary)
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(
            f"{path} is not what 'bicycle evaluate --out' writes ({reason}); evaluate again"
        ) from error
    if about not in known_as:
        other = " or ".join(sorted(known_as))
        raise ValueError(f"{path} is about {about}, not about {other}; evaluate again")
    return summary


def _told(result: dict[str, Any]) -> str:
    """Return the result as a few lines."""
    lines = [f"{result['policy_id']}: wrote {', '.join(result['files'].values())}"]
    for name, value in result.get("parity", {}).items():
        lines.append(f"{name} and numpy differ by at most {value:.1e} of the action limits")
    return "\n".join(lines)
