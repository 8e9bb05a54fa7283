"""Open files are looked after while their episodes go on, and not a moment longer."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

import pytest

from robotouille.protocol import messages
from robotouille_server.rooms.lobby import INSPECTION_SECONDS
from robotouille_server.rooms.recordings.journal import Journal
from tests.support.servers import serving
from tests.support.virtual_time import run


def test_a_file_that_a_thread_closes_is_not_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All files are removed: the first is written anew, and before it is the others' turn their
    episodes end."""
    folder = tmp_path / "recordings"
    looked: list[Journal] = []
    look = Journal.look

    async def main() -> None:
        async with serving(folder) as server:
            order = messages.Create(task="synchronous/01")
            rooms = [server.lobby.create(order, owner="") for _ in range(3)]

            def look_and_end_the_others(journal: Journal) -> bool:
                looked.append(journal)
                anew = look(journal)
                for room in rooms:
                    if room.journal not in looked:
                        room.abort("the study is over")
                return anew

            monkeypatch.setattr(Journal, "look", look_and_end_the_others)
            shutil.rmtree(folder)
            await asyncio.sleep(INSPECTION_SECONDS + 1)
            await server.lobby.closed()
            assert len(looked) == 1
            assert [file.name for file in folder.iterdir()] == [looked[0].name]

    run(main())
