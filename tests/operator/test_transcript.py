"""Transcripts are read from recordings that only grow."""

from __future__ import annotations

import threading
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from robotouille.episode import Clock
from robotouille.replay.container import MAGIC, frame_ends
from robotouille_server.admin import admin_service as desk
from robotouille_server.admin import transcript
from robotouille_server.admin.transcript import READ, Transcript
from tests.support.games import recorded_game
from tests.support.operator import table, viewing
from tests.support.virtual_time import run


def test_a_transcript_read_in_pieces_is_the_one_read_at_once() -> None:
    stream = recorded_game("multi_agent/01", seed=3, clock=Clock.TURN, steps=40)
    whole, piecemeal = Transcript(str), Transcript(str)
    whole.read(stream)
    for end in range(len(MAGIC), len(stream) + 1, 37):
        piecemeal.read(stream[:end])
    piecemeal.read(stream)
    assert piecemeal.lines == whole.lines
    assert whole.lines[-1].text == "over, step_limit"
    assert {line.kind for line in whole.lines} >= {"act", "note"}
    steps = [line.step for line in whole.lines]
    assert steps == sorted(steps)


def test_of_a_long_recording_only_the_end_is_read() -> None:
    stream = recorded_game("asynchronous/06", seed=1, steps=2 * READ)
    assert len(list(frame_ends(stream))) > READ
    asked: list[list[str]] = []

    def sentence(row: list[str]) -> str:
        asked.append(row)
        return " ".join(row)

    end = Transcript(sentence)
    end.read(stream)
    assert len(asked) <= READ
    assert end.lines[-2].step == 2 * READ or end.lines[-1].text == "over, goal"


def test_the_games_do_not_wait_for_a_recording_that_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Decompressing, looking for its frames and decoding them takes long where much was played."""
    in_loop: dict[str, bool] = {}

    def noticed(module: ModuleType, name: str) -> None:
        real = getattr(module, name)

        def call(*args: Any) -> Any:
            in_loop[name] = threading.current_thread() is threading.main_thread()
            return real(*args)

        monkeypatch.setattr(module, name, call)

    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:
            await play.until(lambda game: game.step >= 3)
            lines = (await api.get(f"/api/episodes/{play.episode}"))["lines"]
            assert any(line["kind"] == "note" for line in lines)

    noticed(desk, "unwrap")
    noticed(transcript, "frame_ends")
    noticed(transcript, "frame_value")
    run(main())
    assert in_loop == {"unwrap": False, "frame_ends": False, "frame_value": False}
