"""The stack's services for Foxglove's Service Call panel, in JSON."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import foxglove
from foxglove.websocket import MessageSchema, ServiceRequest, ServiceSchema
from foxglove.websocket import Service as Offer
from rclpy.client import Client
from rclpy.node import Node
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    AbstractWString,
    NamespacedType,
)

from bicycle_common.nodes import topics
from bicycle_common.nodes.topics import Service
from bicycle_tools.foxglove_pose import MOST_BYTES
from bicycle_tools.nodes.filling import FillingError, filled

OFFERED = (topics.RESET, topics.PAUSE, topics.STEP, topics.PUSH, topics.LOAD_POLICY)
"""Services that clients may call."""
PATIENCE = 10.0
"""Time limit of an answer (s)."""


class Services:
    """Calls services for clients; a refusal is the panel's error message.

    Args:
        node: that calls.
        put: queues a call for the node's thread; the server's own threads call here.
    """

    def __init__(self, node: Node, put: Callable[[Callable[[], None]], None]) -> None:
        self._put = put
        self._clients = {one.name: node.create_client(one.type, one.name) for one in OFFERED}
        self.offers = [self._offer(node.resolve_service_name(one.name), one) for one in OFFERED]

    def _offer(self, name: str, service: Service) -> Offer:
        kind = f"{service.type.__module__.split('.')[0]}/srv/{service.type.__name__}"
        parts = (("Request", service.type.Request), ("Response", service.type.Response))
        request, response = (
            MessageSchema(
                encoding="json",
                schema=foxglove.Schema(
                    name=f"{kind}_{part}",
                    encoding="jsonschema",
                    data=_text(json_schema(message_class())),
                ),
            )
            for part, message_class in parts
        )
        schema = ServiceSchema(name=kind, request=request, response=response)
        return Offer(name, schema=schema, handler=functools.partial(self._handle, service))

    def _handle(self, service: Service, request: ServiceRequest) -> bytes:
        """Answer a client; runs in a thread of the server and waits for the node's.

        Raises:
            ValueError: with the line for the client.
        """
        answer: Future[bytes] = Future()
        self._put(functools.partial(self._begin, service, bytes(request.payload), answer))
        try:
            return answer.result(PATIENCE)
        except TimeoutError:
            raise ValueError(f"{service.name} has not answered for {PATIENCE:g} s") from None

    def _begin(self, service: Service, data: bytes, answer: Future[bytes]) -> None:
        client: Client = self._clients[service.name]
        try:
            if len(data) > MOST_BYTES:
                raise FillingError(f"it has {len(data)} bytes, more than {MOST_BYTES}")
            question = filled(service.type.Request, data.decode(errors="replace"))
        except FillingError as error:
            answer.set_exception(ValueError(str(error)))
            return
        if not client.service_is_ready():
            script = "controller.sh" if service is topics.LOAD_POLICY else "sim.sh"
            answer.set_exception(ValueError(f"nobody offers {service.name}: start {script}"))
            return
        client.call_async(question).add_done_callback(
            lambda done: answer.set_result(_text(as_json(done.result())))
        )


def _text(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False).encode()


def json_schema(message: Any) -> dict[str, Any]:
    """Return the JSON schema of a message, with its default values."""
    fields = list(message.get_fields_and_field_types())
    types = dict(zip(fields, message.SLOT_TYPES, strict=True))
    return {
        "type": "object",
        "properties": {name: _schema(types[name], getattr(message, name)) for name in fields},
    }


def _schema(kind: Any, value: Any) -> dict[str, Any]:
    if isinstance(kind, AbstractNestedType):
        return {"type": "array"}
    if isinstance(kind, NamespacedType):
        return json_schema(value)
    if isinstance(kind, (AbstractString, AbstractWString)):
        return {"type": "string", "default": value}
    names = {bool: "boolean", int: "integer", float: "number"}
    return {"type": names.get(type(value), "number"), "default": as_json(value)}


def as_json(value: Any) -> Any:
    """Return a message or a value of one as plain data; numbers that are not finite are null."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: as_json(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return [as_json(item) for item in value]
