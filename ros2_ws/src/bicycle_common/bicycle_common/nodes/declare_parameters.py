"""Declare ROS parameters from a settings class, with descriptors; refuse typos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from bicycle_common.nodes.runner import UserError
from bicycle_common.parameters import Parameter, parameters_of
from bicycle_common.validation import nearest

Settings = TypeVar("Settings")

MOST_SHOWN = 200
"""Largest number of characters of a value in an error line."""
_FOREIGN = ("use_sim_time", "qos_overrides.", "start_type_description_service")


def declare(node: Node, settings: type[Settings]) -> Settings:
    """Declare every field of `settings` as a parameter and read the given values.

    Those that are not `live` cannot be set while the node runs, and the answer says why;
    `follow` has the others.

    Raises:
        UserError: on an unknown parameter, a wrong type, or a value out of range.
    """
    known = {item.name: item for item in parameters_of(settings)}
    given: dict[str, RosParameter] = node._parameter_overrides
    for name in given:
        if name not in known and not name.startswith(_FOREIGN):
            raise UserError(
                f"unknown parameter {name!r}{nearest(name, known)}; --help lists them all"
            )
    read = settings(**{item.name: _declare_one(node, item, given) for item in known.values()})

    def refuse(changes: list[RosParameter]) -> SetParametersResult:
        """Refuse changes of what is read once."""
        for change in changes:
            item = known.get(change.name)
            if item is not None and not item.live and change.value != getattr(read, item.name):
                return SetParametersResult(
                    successful=False, reason=f"parameter {item.name} stays as it is: {item.fixed}"
                )
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(refuse)
    return read


def follow(node: Node, settings: Settings, apply: Callable[[Settings], None]) -> None:
    """Let the parameters of `settings` that are `live` change while the node runs.

    Args:
        node: it has declared them.
        settings: values at the start.
        apply: takes the settings after a change, in the node's thread; with a ValueError it
            refuses them.
    """
    known = {item.name: item for item in parameters_of(type(settings))}
    now = settings

    def change(changes: list[RosParameter]) -> SetParametersResult:
        nonlocal now
        values = {one.name: one.value for one in changes if one.name in known}
        try:
            for name, value in values.items():
                known[name].check(value)
            new = replace(now, **values) if values else now  # type: ignore[type-var]
            if new != now:
                apply(new)
        except (ValueError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        now = new
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(change)


def _declare_one(node: Node, item: Parameter, given: dict[str, RosParameter]) -> Any:
    """Declare one parameter; an integer is accepted for a float."""
    override = given.get(item.name)
    if (
        override is not None
        and isinstance(item.default, float)
        and override.type_ == RosParameter.Type.INTEGER
    ):
        value = float(override.value)
        given[item.name] = RosParameter(item.name, RosParameter.Type.DOUBLE, value)
    try:
        node.declare_parameter(item.name, item.default, _descriptor(item))
        value = node.get_parameter(item.name).value
        item.check(value)
    except (InvalidParameterTypeException, ParameterUninitializedException):
        wanted = type(item.default).__name__
        raise UserError(
            f"parameter {item.name} must be a {wanted}, such as {item.default!r}, "
            f"not {_shown(given[item.name])}"
        ) from None
    except InvalidParameterValueException:
        raise UserError(
            f"parameter {item.name} is {_shown(given[item.name])}: choose {item.low:g} to "
            f"{item.high:g}"
        ) from None
    except ValueError as error:
        raise UserError(str(error)) from None
    return value


def _shown(given: RosParameter) -> str:
    """Return a value as text for an error line."""
    text = repr(given.value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."


def _descriptor(item: Parameter) -> ParameterDescriptor:
    """Return the descriptor that `ros2 param describe` shows."""
    descriptor = ParameterDescriptor(description=item.description)
    rules = [] if item.live else [f"not while it runs: {item.fixed}"]
    if item.choices:
        rules.insert(0, "one of " + ", ".join(item.choices))
    descriptor.additional_constraints = "; ".join(rules)
    if item.low is None or item.high is None or isinstance(item.default, bool):
        return descriptor
    if isinstance(item.default, float):
        bounds = FloatingPointRange(from_value=float(item.low), to_value=float(item.high))
        descriptor.floating_point_range = [bounds]
    elif isinstance(item.default, int):
        bounds = IntegerRange(from_value=int(item.low), to_value=int(item.high))
        descriptor.integer_range = [bounds]
    return descriptor
