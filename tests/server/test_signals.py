"""Signals: `need`, `yours`, `look`, `wait` and `thanks`, and what bots tell each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille.world.presentation.signals import Intent, Signal
from robotouille_client import ChatReceived, ChatRejected, TeamTold, connect
from tests.support.servers import raw, serving
from tests.support.virtual_time import virtual

TASK = "multi_agent/01"


async def event(game: Any, kind: type | tuple[type, ...]) -> Any:
    """Return the next event of a kind, or of one of several."""
    while True:
        found = await game.next_event()
        if isinstance(found, kind):
            return found


@virtual
async def test_everybody_receives_a_signal_with_its_sentence(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        connect(server.url, name="Ada") as ada,
        connect(server.url, name="Bob") as bob,
        connect(server.url, name="Eve") as eve,
    ):
        room = await ada.create(TASK)
        one, two = await ada.join(room.code), await bob.join(room.code)
        watched = await eve.join(room.code, role="spectator")
        for intent, target, sentence in (
            ("need", "stove1", "I need the stove, please"),
            ("yours", "lettuce1", "You take the lettuce, please"),
            ("look", "robot2", "Look at robot 2"),
            ("wait", "", "Wait, please"),
            ("thanks", "", "Thank you"),
        ):
            one.signal(intent, target)
            for game in (two, watched):
                assert await event(game, ChatReceived) == ChatReceived(
                    "Ada", "robot1", sentence, Signal(Intent(intent), target)
                )
        await ada.close_episode(room.code)
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    said = [note for note in recording.notes() if note["note"] == "said"]
    assert [(s["intent"], s.get("target", "")) for s in said[:2]] == [
        ("need", "stove1"),
        ("yours", "lettuce1"),
    ]
    assert recording.verify().ok


@pytest.mark.parametrize(
    ("fields", "code", "text"),
    [
        ({"intent": "need"}, "chat/target", "'need' needs a target"),
        ({"intent": "look", "target": "oven9"}, "chat/target", "there is no 'oven9'"),
        ({"intent": "need", "target": "robot2"}, "chat/target", "cannot point at a player"),
        ({"intent": "thanks", "target": "robot1"}, "chat/target", "at its sender"),
        ({"intent": "shout"}, "message/invalid-field", "need"),
        ({"intent": "wait", "seat": "robot2"}, "seat/unknown", "not yours"),
    ],
)
@virtual
async def test_invalid_signals_are_refused(
    tmp_path: Path, fields: dict[str, Any], code: str, text: str
) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", "task": TASK}, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        error = await ada.ask({"type": "signal", **fields}, "error")
        assert error["code"] == code
        assert text in error["message"]


@pytest.mark.parametrize(
    ("rule", "may_say", "may_signal"),
    [("free", True, True), ("signals", False, True), ("off", False, False)],
)
@virtual
async def test_rules_decide_what_may_be_sent(
    tmp_path: Path, rule: str, may_say: bool, may_signal: bool
) -> None:
    async with serving(tmp_path) as server, connect(server.url, name="Ada") as ada:
        game = await ada.join((await ada.create(TASK, chat=rule)).code)
        for send, allowed in (
            (lambda: game.say("hello"), may_say),
            (lambda: game.signal("wait"), may_signal),
        ):
            send()
            answer = await event(game, (ChatReceived, ChatRejected))
            assert isinstance(answer, ChatReceived) == allowed


@virtual
async def test_only_bots_receive_what_a_bot_tells_its_team(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        connect(server.url, name="one", kind="bot") as one,
        connect(server.url, name="two", kind="bot") as two,
        connect(server.url, name="Ada", kind="human") as ada,
    ):
        room = await one.create(TASK, seats=3)
        games = [await client.join(room.code) for client in (one, two, ada)]
        # A person's note is recorded and sent to nobody, and so is a bot's that says more.
        games[2].note("team", "planner 1")
        games[0].note("team", "Let us meet at the stove")
        games[0].note("team", "meet-at-the-stove 2")
        games[0].note("team", "planner 2")
        # The sender hears it, too: all bots plan again at the same point of the course.
        for game in games[:2]:
            assert await event(game, TeamTold) == TeamTold("robot1", "planner 2")
        # Repetition is no way to talk, either.
        for _ in range(60):
            games[0].note("team", "planner 3")
        games[0].say("done")
        told = 0
        while not isinstance(found := await games[1].next_event(), ChatReceived):
            told += isinstance(found, TeamTold)
        assert told < 20
        while not isinstance(found := await games[2].next_event(), ChatReceived):
            assert not isinstance(found, TeamTold)
