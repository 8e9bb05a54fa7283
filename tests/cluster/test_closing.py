"""Recordings that close while NATS has no quorum."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path

from structlog.testing import capture_logs

from robotouille_server.cluster.episodes.closing import Closing
from robotouille_server.cluster.episodes.directory import Directory
from robotouille_server.rooms.recording.storage import Folder
from robotouille_server.runtime.logs import configure_logs
from tests.support.buses import SimulatedNats
from tests.support.virtual_time import virtual


@virtual
async def test_each_reason_why_a_recording_is_not_stored_is_reported_once(tmp_path: Path) -> None:
    nats = SimulatedNats(random.Random(1))
    bus = nats.bus("node")
    closing = Closing(bus, Directory(bus), Folder(tmp_path))
    nats.lose_quorum()
    configure_logs("warning", "console")
    try:
        with capture_logs() as logs:
            finishing = asyncio.create_task(closing.finish("episode", "a.rbt.part", kept=False))
            await asyncio.sleep(30)
            assert not finishing.done()
            nats.regain_quorum()
            assert await finishing == ""
    finally:
        configure_logs("error", "console")
    assert {log["event"] for log in logs} == {"recording not stored yet"}
    reasons = [log["error"] for log in logs]
    assert len(reasons) == len(set(reasons))
