"""Rooms: age of deltas, spectators, removed and muted participants, and notes."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from robotouille.episode import Episode
from robotouille.errors import GoalTooHardError, TooHardError, TooManyObjectsError
from robotouille.replay.recording import read_recording
from robotouille.replay.timeline import note_lines
from robotouille_client import ChatReceived, ChatRejected, GameEnded, connect
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.publisher import ROSTER_SECONDS
from tests.support.disks import TroubledFolder
from tests.support.lost_connections import cut
from tests.support.operator import table, viewing
from tests.support.servers import Raw, raw, serving, with_clients
from tests.support.virtual_time import VirtualTimeLoop, virtual

WRITING = 0.3


class SlowDisk(TroubledFolder):
    """Folder in which appends take time."""

    slow = False

    def before_append(self, name: str) -> None:
        if self.slow:
            pass_time(WRITING)


def pass_time(seconds: float) -> None:
    """Pass virtual time while nothing else happens."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop._jumping.now += seconds


def ages(server: Server) -> tuple[float, float]:
    """Return the number of deltas sent, and the sum of their ages in seconds."""
    for family in text_string_to_metric_families(server.metrics.page().decode()):
        if family.name == "robotouille_delta_age_seconds":
            values = {sample.name: sample.value for sample in family.samples}
            return values[f"{family.name}_count"], values[f"{family.name}_sum"]
    raise AssertionError("there is no such metric")


@virtual
async def test_age_of_a_delta_includes_writing(tmp_path: Path) -> None:
    disk = SlowDisk(tmp_path)
    async with with_clients(tmp_path, "ada", storage=disk) as (server, ada):
        game = await ada.join((await ada.create("synchronous/01")).code)
        for _ in range(3):
            await game.act(game.actions[0])
        count, total = ages(server)
        assert count == 3
        assert total < WRITING, "nothing has taken any time yet"
        disk.slow = True
        for _ in range(3):
            await game.act(game.actions[0])
        later_count, later_total = ages(server)
        assert later_count == 6
        assert 3 * WRITING <= later_total - total + 1e-6 < 3 * WRITING + 0.1
        disk.slow = False


@virtual
async def test_rosters_report_lost_and_regained_spectators(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "eve", "zoe") as (server, ada, eve, zoe):
        game = await ada.join((await ada.create("multi_agent/01")).code)
        for one in (eve, zoe):
            await one.join(game.code, role="spectator")
        await asyncio.sleep(2 * ROSTER_SECONDS)
        assert game.spectator_names == ("eve", "zoe")
        game.poll()
        for session in server.lobby.find(game.code).members[1:]:
            assert session.peer is not None
            session.peer.drop("test")
        await asyncio.sleep(0.1)
        assert (game.spectators, len(game.poll())) == (0, 1), "both at once, in one roster"
        await asyncio.sleep(5)
        assert game.spectator_names == ("eve", "zoe")


@virtual
async def test_removed_spectator_cannot_return(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        async with raw(server, name="ada") as ada, raw(server, name="eve") as eve:
            created = await ada.ask({"type": "create"}, "created")
            watch = {"type": "join", "episode": created["code"], "role": "spectator"}
            joined = await eve.ask(watch, "joined")
            room = server.lobby.find(created["code"])
            assert room.spectators == 1
            room.kick(next(s for s in room.members if s.name == "eve"), "rude")
            assert (await eve.expect("left"))["reason"] == "rude"
            assert (await eve.ask(watch, "joined"))["code"] == "episode/banned"
            await eve.socket.close()
            await asyncio.sleep(1)
            async with raw(server, hello=False) as again:
                hello = {"type": "hello", "protocol": 1, "name": "eve"}
                answer = await again.ask({**hello, "resume": joined["resume"]}, "welcome")
                assert answer["code"] == "auth/expired", answer
                await asyncio.sleep(1)
                assert (room.spectators, room.members) == (0, [])


@virtual
async def test_participant_removed_while_away_is_told_on_return(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "eve") as (server, ada, eve):
        created = await ada.create("multi_agent/02")
        await ada.join(created.code)
        game = await eve.join(created.code)
        room = server.lobby.find(created.code)
        session = next(s for s in room.members if s.name == "eve")
        cut(eve)
        while session.peer is not None:
            await asyncio.sleep(0.001)
        room.kick(session, "rude")
        await asyncio.sleep(60)
        assert eve.connected.is_set()
        assert game.ended
        assert isinstance(game.poll()[-1], GameEnded)
        assert game.seat is not None
        assert not room.episode.seat(game.seat).taken


@virtual
async def test_absent_spectators_make_room_for_others(tmp_path: Path) -> None:
    async with serving(tmp_path, max_spectators=2) as server:
        async with raw(server) as ada, raw(server) as eve:
            created = await ada.ask({"type": "create", "grace": 86400.0}, "created")
            watch = {"type": "join", "episode": created["code"], "role": "spectator"}
            async with raw(server) as one, raw(server) as two:
                for spectator in (one, two):
                    assert (await spectator.ask(watch, "joined"))["type"] == "joined"
                assert (await eve.ask(watch, "joined"))["code"] == "episode/full"
            await asyncio.sleep(10)
            assert (await eve.ask(watch, "joined"))["type"] == "joined"


@virtual
async def test_spectators_who_resume_and_vanish_stay_bounded(tmp_path: Path) -> None:
    most = 3
    async with serving(tmp_path, max_spectators=most) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", "grace": 86400.0}, "created")
        watch = {"type": "join", "episode": created["code"], "role": "spectator"}
        tokens = []
        for number in range(4 * most):
            async with raw(server, name=f"eve {number}") as eve:
                tokens.append((await eve.ask(watch, "joined"))["resume"])
        before = len(server.sessions.by_id)
        for token in tokens:
            async with raw(server, hello=False) as eve:
                answer = await eve.ask({**HELLO, "resume": token}, "welcome")
                assert answer.get("resumed", False) == (token in tokens[-most:])
        await asyncio.sleep(1)
        assert len(server.sessions.by_id) == before == 1 + most
        # The spectators who vanished last can come back.
        async with raw(server, hello=False) as eve:
            assert (await eve.ask({**HELLO, "resume": tokens[-1]}, "joined"))["role"] == "spectator"


HELLO = {"type": "hello", "protocol": 1, "name": "eve"}


def session_of(server: Server, episode: str, name: str) -> Session:
    return next(s for s in server.lobby.find(episode).members if s.name == name)


async def says(connection: Raw, text: str) -> str:
    """Send a chat message; return the code of the refusal, or an empty string."""
    await connection.send({"type": "say", "text": text})
    while True:
        answer = await connection.expect("said", "error")
        if answer["type"] == "error" or answer["text"] == text:
            return str(answer.get("code", ""))


@virtual
async def test_muted_chat_is_neither_sent_nor_recorded(tmp_path: Path) -> None:
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


@virtual
async def test_mute_survives_reconnections_and_restarts(tmp_path: Path) -> None:
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


@virtual
async def test_client_library_reports_the_refusal(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, connect(server.url, name="eve") as eve:
        created = await eve.create("synchronous/01", chat="phrases", phrases=["thanks"])
        game = await eve.join(created.code)
        game.say("something else")
        while not isinstance(event := await game.next_event(), ChatRejected):
            pass
        assert event.code == "chat/phrase"
        assert "thanks" in event.reason or "phrase" in event.reason
        game.say("thanks")
        while not isinstance(event := await game.next_event(), ChatReceived):
            pass
        assert event.text == "thanks"


@virtual
async def test_operator_sees_who_is_muted(tmp_path: Path) -> None:
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


@virtual
async def test_note_is_recorded_and_not_sent(tmp_path: Path) -> None:
    text = "".join(chr(33 + n % 90) for n in range(20_000))
    async with with_clients(tmp_path, "ada", "bob", "eve") as (_, ada, bob, eve):
        opened = await ada.create("multi_agent/01", clock="lockstep", max_steps=1)
        game = await ada.join(opened.code)
        other = await bob.join(opened.code)
        watching = await eve.join(opened.code, role="spectator")
        watching.note("plan", "spectators cannot write notes")
        game.note("plan", text)
        game.say("ready")
        await asyncio.gather(game.act(None), other.act(None))
        received = [str(event) for each in (other, watching) for event in each.poll()]
        assert any("ready" in event for event in received)
        assert not any(text[:100] in event for event in received)
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = [note for note in recording.notes() if note["note"] == "noted"]
    assert "".join(note["text"] for note in notes) == text
    assert [note.get("more", False) for note in notes] == [True, True, False]
    assert {(note["player"], note["topic"]) for note in notes} == {("robot1", "plan")}
    assert any("robot1 notes (plan): !" in line for line in note_lines(recording))


@pytest.mark.parametrize("error", [GoalTooHardError, TooManyObjectsError])
@virtual
async def test_episode_that_cannot_be_played_any_further_is_aborted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[TooHardError]
) -> None:
    def fail(*_: object) -> None:
        raise error("the goal is too hard to check")

    async with serving(tmp_path) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", "task": "synchronous/01"}, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        await ada.expect("snapshot")
        monkeypatch.setattr(Episode, "submit", fail)
        await ada.send({"type": "act", "seq": 1, "action": None})
        async with asyncio.timeout(5):
            ended = await ada.expect("ended")
        assert ended["outcome"]["reason"] == "aborted"
        assert ended["outcome"]["detail"] == "the goal is too hard to check"
