"""Limits of recordings: whatever participants send, readers can read the file."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from robotouille.certification.certificate import load_certificate
from robotouille.episode import quota, seats
from robotouille.errors import RecordingError
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import read_recording
from robotouille.world.unmet import NEEDS
from robotouille.world.world import World
from robotouille_server.rooms.recording import journal
from robotouille_server.rooms.recording.storage import Folder
from tests.support.random_play import random_stream
from tests.support.servers import raw, serving, with_clients
from tests.support.virtual_time import virtual

IMPOSSIBLE = {"name": "move", "args": ["robot1", "table1", "table2"]}


def act(seq: int, **more: Any) -> dict[str, Any]:
    return {"type": "act", "seq": seq, "action": IMPOSSIBLE, **more}


@virtual
async def test_seat_beyond_its_quota_is_notified_and_plays_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(seats, "SEAT_QUOTA_BYTES", 20_000)
    monkeypatch.setattr(quota, "NEWCOMER_BYTES", 0)
    async with serving(tmp_path) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", "task": "synchronous/01"}, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        await ada.expect("snapshot")
        answers = [await ada.ask(act(n, reasoning="x" * 8000), "rejected") for n in (1, 2, 3)]
        assert "code" not in answers[1]
        assert answers[2]["code"] == "rate/words"
        assert "send no more reasoning" in (await ada.expect("notice"))["text"]
        for seq in range(3, 200):
            assert "code" not in await ada.ask(act(seq), "rejected")
        there = {"name": "move", "args": ["robot1", "table3", "table1"]}
        await ada.ask({**act(200), "action": there}, "delta")
        assert (await ada.ask({"type": "say", "text": "hi"}, "said"))["code"] == "rate/words"
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = [note["note"] for note in recording.notes()]
    assert notes.count("rejected") == 2
    assert notes.count("quota") == 1
    assert len(recording.stream) < 40_000


@pytest.mark.parametrize(
    ("limit", "most"),
    [
        ("MAX_RECORDING_BYTES", 30_000),
        ("MAX_RECORDING_FRAMES", 60),
        ("MAX_RECORDING_NOTES", 10),
        ("MAX_RECORDING_REASONS", 5),
        ("MAX_RECORDING_TEXTS", 5_000),
    ],
)
@virtual
async def test_episode_ends_at_the_maximum_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, most: int
) -> None:
    monkeypatch.setattr(journal, limit, most)
    async with serving(tmp_path) as server, raw(server) as ada:
        order = {"type": "create", "task": "synchronous/01", "clock": "realtime"}
        created = await ada.ask({**order, "step_rate": 60}, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        for number in range(1, 1000):
            await ada.send({"type": "say", "text": f"{number} " + "x" * 400})
            await ada.send(act(number))
            if (await ada.expect("said", "ended"))["type"] == "ended":
                break
        else:
            pytest.fail("it went on")
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert recording.outcome is not None
    assert recording.outcome["reason"] == "aborted"
    assert recording.outcome["detail"] == "the recording has reached its maximum size"
    reached = {
        "MAX_RECORDING_BYTES": len(recording.stream),
        "MAX_RECORDING_FRAMES": recording.count,
        "MAX_RECORDING_NOTES": recording.totals.notes,
        "MAX_RECORDING_REASONS": recording.totals.reasons,
        "MAX_RECORDING_TEXTS": recording.totals.texts,
    }
    assert most < reached[limit]
    assert len(recording.stream) < 35_000


@virtual
async def test_episode_ends_after_too_many_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal, "MAX_RECORDING_CHANGES", 20)
    async with serving(tmp_path) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", "task": "synchronous/01"}, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        ends = ["table3", "table1"]
        for seq in range(1, 100):
            walk = {"name": "move", "args": ["robot1", *ends]}
            ends.reverse()
            if (await ada.ask({**act(seq), "action": walk}, "delta", "ended"))["type"] == "ended":
                break
        else:
            pytest.fail("it went on")
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert 20 < recording.totals.changes < 30


@virtual
async def test_episode_ends_after_too_many_created_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal, "MAX_RECORDING_CREATED", 5)
    async with with_clients(tmp_path, "ada") as (_, ada):
        created = await ada.create("asynchronous/07", clock="lockstep", timing="benchmark")
        game = await ada.join(created.code)
        for line in load_certificate("asynchronous/07").plan or ():
            if game.ended:
                break
            await game.act(game.world.parse(game.state, game.seat, line))
        assert game.outcome is not None
        assert game.outcome["detail"] == "the recording has reached its maximum size"
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert 5 < recording.totals.created < 50


class BlockedFolder(Folder):
    """Folder in which no recording is closed until `unblocked` is set."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.unblocked = threading.Event()
        self.threads = set[int]()

    def replace(self, name: str, content: bytes) -> None:
        self.threads.add(threading.get_ident())
        self.unblocked.wait()
        super().replace(name, content)


@virtual
async def test_games_that_end_at_once_are_closed_one_after_another(tmp_path: Path) -> None:
    folder, stream = BlockedFolder(tmp_path), random_stream(1)
    recorder = Recorder(World("synchronous/01"))
    closing = []
    for number in range(4):
        name = f"{number}.rbt.part"
        writing = journal.Journal(folder, name, recorder, begin=stream)
        assert writing.write()
        closing.append(writing.finish(kept=True))
    folder.unblocked.set()
    assert await asyncio.gather(*closing) == [f"{number}.rbt" for number in range(4)]
    assert len(folder.threads) == 1
    assert threading.get_ident() not in folder.threads


def test_closed_recording_is_never_replaced_by_another(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    first, second = (random_stream(seed) for seed in (1, 2))
    name = journal.close_recording(folder, "game.rbt.part", first, len(first))
    closed = (tmp_path / name).read_bytes()
    assert journal.close_recording(folder, "game.rbt.part", first, len(first)) == name
    with pytest.raises(RecordingError, match=f"another recording than {name}, which exists"):
        journal.close_recording(folder, "game.rbt.part", second, len(second))
    assert (tmp_path / name).read_bytes() == closed


def test_writers_limit_is_below_the_readers_limit() -> None:
    from robotouille.replay.container import (
        MAX_CHANGES,
        MAX_CREATED,
        MAX_FILE,
        MAX_FRAMES,
        MAX_NOTES,
        MAX_REASONS,
        MAX_TEXTS,
    )

    most_seats = 16
    words = most_seats * quota.MAX_SEAT_BYTES + quota.MAX_AUDIENCE_BYTES
    assert words < journal.MAX_RECORDING_BYTES
    assert journal.MAX_RECORDING_BYTES + 2**25 < MAX_FILE
    assert journal.MAX_RECORDING_FRAMES + 2**15 < MAX_FRAMES
    assert journal.MAX_RECORDING_NOTES + 2**14 < MAX_NOTES
    assert journal.MAX_RECORDING_REASONS + 2**18 < MAX_REASONS
    assert journal.MAX_RECORDING_TEXTS + 2**24 < MAX_TEXTS
    assert journal.MAX_RECORDING_CHANGES + 2**18 < MAX_CHANGES
    assert journal.MAX_RECORDING_CREATED + 2**16 < MAX_CREATED
    # One hostile participant cannot end the episode of the others.
    assert 2 * 4 * quota.MAX_SEAT_BYTES < journal.MAX_RECORDING_TEXTS
    assert 2 * quota.MAX_SEAT_BYTES / quota.NOTE_BYTES < journal.MAX_RECORDING_NOTES
    shortest_reason = len(NEEDS) + len("x") + len("p")
    assert 2 * quota.MAX_SEAT_BYTES / shortest_reason < journal.MAX_RECORDING_REASONS
