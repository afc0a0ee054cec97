"""`service.sh`: list, type and call of any service, for installations without `ros2`."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.service")

import argparse
import importlib
import sys
from typing import Any

from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes.runner import UserError, resolved_service
from bicycle_common.nodes.topics import Service
from bicycle_common.validation import nearest
from bicycle_tools.nodes.calling import PATIENCE, Caller, ToolError, run_tool
from bicycle_tools.nodes.filling import FillingError, filled
from bicycle_tools.nodes.flatten import flatten, shown
from bicycle_tools.settled import Settled

DISCOVERY, LONGEST_DISCOVERY = 1.0, 5.0
"""Time without a new service after which no more are expected, and longest wait for all (s)."""
COMMON = ("rcl_interfaces/srv/", "type_description_interfaces/srv/")
"""Types of the services that every node offers; not listed by default."""


def services(caller: Caller) -> dict[str, str]:
    """Return the names of all services and their types."""
    found = caller.node.get_service_names_and_types()
    return {name: ", ".join(types) for name, types in sorted(found)}


def show_list(caller: Caller, given: argparse.Namespace) -> int:
    """Print all services with their types."""
    caller.spin_until(Settled(lambda: services(caller), DISCOVERY), LONGEST_DISCOVERY)
    found = services(caller)
    if not given.all:
        found = {name: kind for name, kind in found.items() if not kind.startswith(COMMON)}
    width = max(map(len, found), default=0)
    for name, kind in found.items():
        print(f"{name:<{width}}  {kind}")
    return 0


def find(caller: Caller, name: str, patience: float) -> Service:
    """Return a service that somebody offers.

    Raises:
        ToolError: if nobody does, its type is not installed, or ROS allows no such name.
    """
    try:
        full = name if name.startswith("/") else resolved_service(caller.node, name)
    except UserError as error:
        raise ToolError(2, str(error)) from None
    if not caller.spin_until(lambda: full in services(caller), patience):
        hint = nearest(full, services(caller))
        raise ToolError(1, f"nobody offers {full}{hint}: see service.sh list")
    return Service(full, service_class(services(caller)[full]))


def service_class(kind: str) -> type[Any]:
    """Return the class of `pkg/srv/Type`.

    Raises:
        ToolError: if it is not installed.
    """
    package, _, short = kind.partition("/srv/")
    try:
        found: type[Any] = getattr(importlib.import_module(f"{package}.srv"), short)
    except (ImportError, AttributeError, TypeError, ValueError):
        raise ToolError(1, f"the service type {kind!r} is not installed here") from None
    return found


def show_type(caller: Caller, given: argparse.Namespace) -> int:
    """Print the type of a service and the fields of its request."""
    service = find(caller, given.service, given.timeout)
    print(services(caller)[service.name])
    for field, kind in service.type.Request.get_fields_and_field_types().items():
        print(f"  {field}: {kind}")
    return 0


def call(caller: Caller, given: argparse.Namespace) -> int:
    """Call a service and print its answer; return 1 if the answer reports a failure.

    Raises:
        ToolError: if nobody offers it or the values do not fit.
    """
    kind, values = given.type, given.values
    if kind and "/srv/" not in kind:
        if values:
            raise ToolError(2, f"{kind!r} is no type of a service: write pkg/srv/Type")
        kind, values = "", kind
    try:
        request = filled(service_class(kind).Request, values) if kind else None
        service = find(caller, given.service, given.timeout)
        if request is None:
            request = filled(service.type.Request, values)
    except FillingError as error:
        raise ToolError(2, str(error)) from None
    if kind and kind != services(caller)[service.name]:
        raise ToolError(2, f"{service.name} is of type {services(caller)[service.name]}")
    answer = caller.call(service, request, given.timeout, "see service.sh list")
    for name, value in flatten(answer):
        print(f"{name}: {shown(value)}")
    return int(getattr(answer, "success", True) is False)


def parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="service.sh")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="list|type|call")
    listed = verbs.add_parser("list")
    listed.add_argument("--all", action="store_true")
    listed.set_defaults(action=show_list, timeout=PATIENCE)
    for name, action in (("type", show_type), ("call", call)):
        verb = verbs.add_parser(name)
        verb.add_argument("service")
        verb.add_argument("--timeout", type=float, default=PATIENCE)
        verb.set_defaults(action=action)
        if name == "call":
            verb.add_argument("type", nargs="?", default="")
            verb.add_argument("values", nargs="?", default="")
    given, ros = parser.parse_with_ros(arguments)
    if not 0.0 < given.timeout < 1e6:
        parser.error(f"--timeout is {given.timeout}: choose a positive number of seconds")
    return given, ros


def main() -> int:
    """Run the command line; return the exit status."""
    given, ros = parse(sys.argv[1:])
    return run_tool("service.sh", ros, lambda caller: int(given.action(caller, given)))
