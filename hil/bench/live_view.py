"""A live view of a run: what goes into the record also goes to Foxglove, over its WebSocket."""

from __future__ import annotations

import json

import foxglove

from host.core.errors import UserError
from host.runs import record

HOST = "127.0.0.1"


class LiveView:
    """Serves a run's messages on a port of this machine. Hand `put` to the Recorder; open
    ws://127.0.0.1:PORT in Foxglove. It never waits for a viewer."""

    def __init__(self, port: int) -> None:
        """`port` 0 takes any free one. Raises UserError where it is taken."""
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="daranti", host=HOST, port=port, context=self._context
            )
        except RuntimeError as error:
            raise UserError(f"cannot serve the live view on port {port}: {error}") from error
        self._channels: dict[str, foxglove.Channel] = {}

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._server.port

    def put(self, topic: str, nanoseconds: int, data: bytes) -> None:
        """One message, as the record keeps it."""
        channel = self._channels.get(topic)
        if channel is None:
            name, fields = record.SCHEMAS[topic]
            channel = foxglove.Channel(
                topic,
                schema=foxglove.Schema(
                    name=name, encoding="jsonschema", data=json.dumps(fields).encode()
                ),
                message_encoding="json",
                context=self._context,
            )
            self._channels[topic] = channel
        channel.log(data, log_time=nanoseconds)

    def close(self) -> None:
        """Disconnects all viewers."""
        self._server.stop()
