"""Arguments and execution of `bicycle import`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.validation import require_choice
from bicycle_controller.cli import options
from bicycle_controller.config.algorithms import NATURAL_SCALE
from bicycle_controller.policy import foreign_network
from bicycle_controller.policy.policy import save_policy, write_atomically
from bicycle_controller.policy.policy_file import PolicyInfo
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import SCENARIOS, named

SCALES: dict[str, Any] = {
    "si": (1.0,) * 6,
    "natural": NATURAL_SCALE,
    "authors": (np.pi / 2, 1.0, np.pi / 6, 1.0, 1.0, 1.0),
}
EPILOG = f"""\
FILE is a .zip of stable-baselines3 (PPO, A2C, DDPG, TD3, SAC, TQC with an MlpPolicy), or what
torch.save wrote of the state_dict of a torch.nn.Sequential of Linear layers. Nothing in it is run.
Written is NAME.safetensors, or NAME.onnx where the network is not relu and tanh (PPO). Either
rides: ride.sh controller.policy:=DIR/NAME.safetensors. An ONNX file needs no import.

scenarios: {", ".join(SCENARIOS)}

example:
  bicycle import model.zip --scenario learned-speed --observation-scale natural --to policies
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bicycle import`."""
    add = parser.add_argument
    add("file", type=Path, metavar="FILE", help="what to read")
    options.add_scenario(parser, "what it was trained on", required=True)
    add(
        "--observation-scale",
        default="si",
        metavar="SCALE",
        help="the environment's observation_scale: si, natural, authors or six numbers (si)",
    )
    add("--to", type=Path, required=True, metavar="DIR", help="the folder to write to")
    add("--name", metavar="NAME", help="the policy's name (default: the file's)")
    add("--hidden", metavar="KIND", help="relu or tanh, where the file does not say (relu)")
    add("--output", metavar="KIND", help="tanh or clip, where the file does not say (tanh)")
    which = ", as the environment had it"
    options.add_plant(parser, "choi, or whipple with --bicycle", "faithful", which)
    options.add_json(parser)


def run_command(args: argparse.Namespace) -> int:
    """Write the policy and print its id.

    Returns:
        The exit status.

    Raises:
        ValueError: on a user's mistake; one line with the remedy.
    """
    for name, known in (("hidden", foreign_network.HIDDEN), ("output", foreign_network.OUTPUT)):
        if getattr(args, name) is not None:
            require_choice(f"--{name}", getattr(args, name), known)
    plant = options.named_plant(args) or registry.default()
    scenario = named(args.scenario).suited(plant.input_names)
    network = foreign_network.read(args.file, args.hidden, args.output)
    info = PolicyInfo(
        name=args.name or args.file.stem,
        scenario=scenario,
        plant=plant,
        observation_scale=foreign_network.scale_of(args.observation_scale, SCALES),
        action_limits=tuple(scenario.action_limits.tolist()),
        trained={"imported": args.file.name},
    )
    policy = foreign_network.to_policy(network, info)
    path = args.to / f"{info.name}.{'onnx' if policy is None else 'safetensors'}"
    if policy is None:
        write_atomically(path, foreign_network.to_onnx(network, info))
    else:
        save_policy(policy, path)
    sizes = "-".join(str(len(bias)) for _, bias in network.layers)
    result = {"file": str(path), "layers": sizes, "hidden": network.hidden}
    result["output"] = network.output
    if args.json:
        print(json.dumps(result, indent=2))
    else:
        print(f"{args.file}: a network 6-{sizes}, {network.hidden} and {network.output}")
        print(f"wrote {path}")
    return 0
