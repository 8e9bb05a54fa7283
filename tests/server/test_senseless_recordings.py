"""Recordings that are well framed and make no sense are named, and stop no server."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille import World
from robotouille.episode import Clock, Episode, Rules
from robotouille.replay.container import pack_frame
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

TWO = World("multi_agent/01")

NAME = "20260101T000000Z_multi_agent-01_lettuce_burger_0123456789abcdef.rbt.part"
ROSTER = {"note": "roster", "t": 1, "player": "robot1", "name": "x", "kind": "human",
          "present": True}  # fmt: skip
FRAMES: dict[str, tuple[dict[str, Any], str]] = {
    "an unknown controller": (
        {"kind": "notes", "notes": [{**ROSTER, "controller": "wizard"}]},
        "wizard",
    ),
    "words of nobody": (
        {"kind": "notes", "notes": [{"note": "said", "t": 0, "name": "x", "player": "robot9",
                                     "text": "x"}]},
        "robot9",
    ),
    "an impossible outcome": (
        {"kind": "footer", "outcome": {"reason": "goal", "steps": 2, "seconds": 1.0, "seats": 5}},
        "outcome",
    ),
}  # fmt: skip


def begun() -> tuple[Episode, Recorder, bytes]:
    """A game of two that runs, its recorder, and what that has recorded."""
    episode = Episode(TWO, Rules(clock=Clock.REALTIME), 0.0)
    recorder = Recorder(TWO)
    head = header(TWO.task, episode.rules, episode="0123456789abcdef", created="20260101T000000Z")
    content = recorder.begin(head)
    for player in TWO.players:
        episode.join(player, player.upper(), "human", 0.0, session=f"s-{player}")
    episode.tick(0.5)
    return episode, recorder, content + recorder.record(episode.events())


def is_named_and_others_play(folder: Path, content: bytes, fault: str) -> None:
    """A server that finds such a file says what is wrong with it, and opens other episodes."""
    file = folder / NAME
    file.write_bytes(content)

    async def main() -> None:
        async with serving(folder) as server, raw(server) as ada:
            assert list(server.lobby.unrestored) == [NAME]
            reason = server.lobby.unrestored[NAME]
            assert fault in reason
            assert "internal error" not in reason
            assert (await ada.ask({"type": "create"}, "created"))["type"] == "created"

    run(main())
    assert file.read_bytes() == content


def test_what_comes_before_the_fault_is_good(tmp_path: Path) -> None:
    (tmp_path / NAME).write_bytes(begun()[2])

    async def main() -> None:
        async with serving(tmp_path) as server:
            assert not server.lobby.unrestored
            assert list(server.lobby.rooms) == ["0123456789abcdef"]

    run(main())


@pytest.mark.parametrize("what", FRAMES)
def test_a_frame_that_makes_no_sense(tmp_path: Path, what: str) -> None:
    frame, fault = FRAMES[what]
    is_named_and_others_play(tmp_path, begun()[2] + pack_frame(frame), fault)


def test_a_move_of_nobody(tmp_path: Path) -> None:
    episode, recorder, content = begun()
    episode.submit("robot1", 1, episode.state.actions("robot1")[0], 0.55)
    episode.tick(0.75)
    whole = Recording(content + recorder.record(episode.events()))
    step = next(frame for frame in whole.steps if frame["moves"])
    (move,) = step["moves"]
    forged = pack_frame({**step, "moves": [{**move, "player": "robot9"}]})
    is_named_and_others_play(tmp_path, content + forged, "robot9")
