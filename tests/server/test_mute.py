"""Whom an operator mutes talks no more in that episode, whatever they do, until it is undone."""

from __future__ import annotations

from pathlib import Path

from robotouille.replay.recording import read_recording
from robotouille_client import Heard, NotSaid, connect
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.session import Session
from tests.support.operator import table, viewing
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run

HELLO = {"type": "hello", "protocol": 1, "name": "eve"}


def session_of(server: Server, episode: str, name: str) -> Session:
    return next(s for s in server.lobby.find(episode).members if s.name == name)


async def says(connection: Raw, text: str) -> str:
    """The code with which a chat message is refused; empty if it is told."""
    await connection.send({"type": "say", "text": text})
    while True:
        answer = await connection.expect("said", "error")
        if answer["type"] == "error" or answer["text"] == text:
            return str(answer.get("code", ""))


def test_what_a_muted_participant_says_is_neither_told_nor_recorded(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, name="ada") as ada:
            created = await ada.ask({"type": "create", "task": "multi_agent/02"}, "created")
            join = {"type": "join", "episode": created["code"]}
            async with raw(server, name="eve") as eve:
                for one in (ada, eve):
                    await one.ask(join, "joined")
                room = server.lobby.find(created["code"])
                assert await says(eve, "first") == ""
                room.mute(session_of(server, room.id, "eve"))
                assert await says(eve, "second") == "seat/muted"
                assert await says(ada, "still here") == ""
                room.unmute(session_of(server, room.id, "eve"))
                assert await says(eve, "third") == ""
                assert (await ada.expect("said"))["text"] == "third"
                room.abort("done")
                await eve.expect("ended")
            await server.lobby.closed()
        (path,) = tmp_path.glob("*.rbt")
        recording = read_recording(path)
        assert recording.verify().complete
        notes = list(recording.notes())
        assert [n["text"] for n in notes if n["note"] == "said"] == ["first", "still here", "third"]
        moderated = [n for n in notes if n["note"] == "moderated"]
        assert [(n["what"], n["name"]) for n in moderated] == [("muted", "eve"), ("unmuted", "eve")]

    run(main())


def test_it_survives_lost_connections_and_restarts_and_another_session(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            token = server.tokens.mint_role(Role.HOST, "p-1", seconds=3600)
            async with raw(server, hello=False) as eve:
                await eve.ask({**HELLO, "token": token}, "welcome")
                created = await eve.ask({"type": "create"}, "created")
                join = {"type": "join", "episode": created["code"]}
                joined = await eve.ask(join, "joined")
                room = server.lobby.find(created["code"])
                room.mute(session_of(server, room.id, "eve"))
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2) as server:
            async with raw(server, hello=False) as eve, raw(server, hello=False) as other:
                await eve.ask({**HELLO, "resume": joined["resume"]}, "welcome")
                assert await says(eve, "again") == "seat/muted"
                await other.ask({**HELLO, "token": token}, "welcome")
                await other.ask({**join, "role": "spectator"}, "joined")
                assert await says(other, "under another name") == "seat/muted"

    run(main())


def test_in_python_what_is_not_told_is_an_event(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="eve") as eve:
            created = await eve.create("synchronous/01", chat="phrases", phrases=["thanks"])
            game = await eve.join(created.code)
            game.say("something else")
            while not isinstance(event := await game.next_event(), NotSaid):
                pass
            assert event.code == "chat/phrase"
            assert "thanks" in event.reason or "phrase" in event.reason
            game.say("thanks")
            while not isinstance(event := await game.next_event(), Heard):
                pass
            assert event.text == "thanks"

    run(main())


def test_an_operator_mutes_and_sees_who_is_muted(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:

            async def muted() -> list[bool]:
                return [seat["muted"] for seat in (await api.row(play.episode))["seats"]]

            seats = (await api.row(play.episode))["seats"]
            path = f"/api/episodes/{play.episode}/mute"
            assert await muted() == [False, False]
            await api.do(path, session=seats[1]["session"], muted=True)
            assert await muted() == [False, True]
            await api.do(path, session=seats[1]["session"], muted=False)
            assert await muted() == [False, False]
            answer = await api.post(path, session="nobody", muted=True)
            assert (answer.status_code, answer.json()["code"]) == (404, "session/unknown")

    run(main())
