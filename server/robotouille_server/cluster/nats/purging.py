"""Deletion of all messages of one subject, also with NATS servers that get it wrong.

When a NATS server before 2.9.18 starts again, it repeats the deletion for all subjects, and the
other servers follow it (nats-server issue 4196). That would cost all running episodes their
journals. Debian 12 has such a server.
"""

from __future__ import annotations

import asyncio
import json

from nats.errors import Error as NatsError
from nats.js import JetStreamContext
from nats.js.errors import NotFoundError

REPEATS_CORRECTLY = (2, 10)
"""First version of NATS whose servers all repeat a deletion correctly."""
RETRY_SECONDS = 1.0


class CarefulJetStream(JetStreamContext):
    """JetStream whose `purge_stream` is safe with all servers."""

    async def purge_stream(
        self,
        name: str,
        seq: int | None = None,
        subject: str | None = None,
        keep: int | None = None,
    ) -> bool:
        """Delete the messages of a stream, or those of one subject.

        With an old server, messages are deleted one at a time, the first one first: what is left of
        an interrupted deletion is not a recording, and nobody takes it for one.
        """
        version = self._nc.connected_server_version
        if (version.major, version.minor) >= REPEATS_CORRECTLY or subject is None:
            return await super().purge_stream(name, seq, subject, keep)
        begun = False
        while True:
            try:
                found = await self.get_msg(name, 1, subject=subject, next=True)
                # Overwriting the message would cost more, and nothing in it is secret.
                request = json.dumps({"seq": found.seq, "no_erase": True}).encode()
                await self._api_request(f"{self._prefix}.STREAM.MSG.DELETE.{name}", request)
                begun = True
            except NotFoundError:
                return True
            except (NatsError, OSError):
                if not begun:
                    raise
                await asyncio.sleep(RETRY_SECONDS)
