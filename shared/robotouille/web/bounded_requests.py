"""HTTP requests that an HTTP server parses within bounds, before it knows who sends them.

uvicorn parses all that one read delivers, up to 256 KiB, without a pause. A body in chunks of one
byte takes 0.2 s in such a read, and a head of 64 KiB with thousands of lines takes 20 ms. In this
time, no game is served.
"""

from __future__ import annotations

import re

import h11

MAX_HEAD_BYTES = 16 * 1024
MAX_HEAD_LINES = 128

_END = re.compile(rb"\n\r?\n")


class BoundedRequests(h11.Connection):
    """Parser of a server's connection that refuses long heads and bodies in chunks.

    Other bodies need no bound: the parser passes on what has arrived of them as one piece.
    """

    def __init__(self) -> None:
        super().__init__(h11.SERVER, MAX_HEAD_BYTES)

    def next_event(self) -> h11.Event | type[h11.NEED_DATA] | type[h11.PAUSED]:
        """Return the next part of a request.

        Raises:
            h11.RemoteProtocolError: The request is malformed, has a long head or comes in chunks.
        """
        if self.their_state is h11.IDLE:
            self._check_head()
        event = super().next_event()
        if isinstance(event, h11.Request) and b"transfer-encoding" in dict(event.headers):
            raise h11.RemoteProtocolError("send the body with Content-Length", 411)
        return event

    def _check_head(self) -> None:
        received = self.trailing_data[0]
        end = _END.search(received, 0, MAX_HEAD_BYTES)
        head = received[: end.end()] if end else received
        if len(head) > MAX_HEAD_BYTES:
            raise h11.RemoteProtocolError(f"the head has more than {MAX_HEAD_BYTES} bytes", 431)
        if head.count(b"\n") > MAX_HEAD_LINES:
            raise h11.RemoteProtocolError(f"the head has more than {MAX_HEAD_LINES} lines", 431)
