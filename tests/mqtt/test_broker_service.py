"""A server on a broker, from its beginning to its end: in virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotouille_server.mqtt.models import Presence
from tests.support.brokers import told
from tests.support.virtual_time import run

NAME = "robotouille/v1/lab"


def test_presence_is_retained_and_ends_with_the_server(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            await asyncio.sleep(1)
            url = server.url
            assert server.metrics.mqtt_connected
        first, last = broker.published[0], broker.published[-1]
        assert (first.topic, first.retain, first.qos) == (f"{NAME}/presence", True, 1)
        presence = Presence.model_validate(first.content)
        assert (presence.state, presence.url, presence.workers) == ("online", url, 1)
        assert (last.topic, last.content, last.retain) == (first.topic, {"state": "stopped"}, True)
        assert not server.metrics.mqtt_connected

    run(main())
