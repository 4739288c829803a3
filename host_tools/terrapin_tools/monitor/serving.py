"""Live telemetry for Foxglove, by its SDK: a WebSocket server on loopback, to which clients can send nothing.

with FoxgloveServer(Decoder(dbc), 8765, "socketcan:can0") as server:
    server.write(frames)
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.extras import need
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import Frames
from terrapin_tools.logs.writing import JsonTopics

__all__ = ["FoxgloveServer"]


class FoxgloveServer(AbstractContextManager["FoxgloveServer"]):
    """The topics of an MCAP log, live. `port` 0 takes one that is free. A client that is slow loses the oldest of 1,024
    messages; the others, and who writes, do not wait for it. UserError without the SDK, or where the port is taken."""

    def __init__(self, decoder: Decoder, port: int, name: str) -> None:
        need("--serve", "foxglove", "foxglove")
        import foxglove

        self._sdk, self._context = foxglove, foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=name, host="127.0.0.1", port=port, capabilities=[], context=self._context
            )
        except (OSError, RuntimeError) as error:
            reason = str(error).rpartition(": ")[2].partition(" (os")[0]
            raise UserError(f"--port: {port}: {reason}, expected one that is free", status=1) from None
        self._topics = JsonTopics(decoder, self._channel, self._put)

    @property
    def address(self) -> str:
        """What Foxglove's "Open connection" takes."""
        return f"ws://127.0.0.1:{self._server.port}"

    def _channel(self, topic: str, schema: Mapping[str, Any], metadata: Mapping[str, str]) -> Any:
        described = self._sdk.Schema(name=schema["title"], encoding="jsonschema", data=json.dumps(schema).encode())
        return self._sdk.Channel(
            topic, schema=described, message_encoding="json", context=self._context, metadata=dict(metadata)
        )

    def _put(self, channel: Any, time: float, value: Mapping[str, Any]) -> None:
        if channel.has_sinks():  # somebody has subscribed
            channel.log(dict(value), log_time=max(0, round(time * 1e9)))

    def write(self, frames: Frames) -> None:
        """To all who have subscribed; never waits for them."""
        self._topics.write(frames)

    def close(self) -> None:
        self._server.stop()

    def __exit__(self, *error: object) -> None:
        self.close()
