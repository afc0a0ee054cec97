"""Device of a controller's network."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from bicycle_common.validation import nearest
from bicycle_controller.policy.policy import Policy

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller


def actor_on(controller: Controller, device: str) -> Controller:
    """Return the same controller with its network on `device`; one without a network unchanged.

    If there is no such device it stays on the CPU, and a line on standard error says so.

    Raises:
        ValueError: on anything but cpu, cuda or cuda:N.
    """
    kind, _, number = device.partition(":")
    if kind not in ("cpu", "cuda") or (number and not (kind == "cuda" and number.isdigit())):
        hint = nearest(device, ("cpu", "cuda"))
        raise ValueError(f"unknown device {device!r}{hint}; known: cpu, cuda, cuda:N")
    if kind == "cpu" or not isinstance(controller, Policy):
        return controller
    import torch

    from bicycle_controller.policy.torch_policy import TorchPolicy

    if int(number or 0) < torch.cuda.device_count():
        return TorchPolicy(controller, device)
    print(f"no device {device}: {controller.policy_id} runs on the CPU", file=sys.stderr)
    return controller
