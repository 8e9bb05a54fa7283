"""Participants with several seats over one connection."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import ProtocolError, WrongArgumentError
from robotouille.protocol import messages
from robotouille.replay.recording import read_recording
from robotouille_client import Client, Game, connect
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.participants.seat_limits import SEAT_CHANGES_AT_ONCE, SeatTurnover
from tests.support.handshakes import hello, mint_token, opened
from tests.support.lost_connections import cut
from tests.support.servers import Raw, crash, raw, serving, with_clients
from tests.support.virtual_time import virtual

HELLO = {"type": "hello", "protocol": 1, "name": "ada"}
THREE = {"type": "create", "task": "training/03_multi_agent@3", "clock": "lockstep"}
NO_BUDGET = {"task": "training/03_multi_agent@3", "clock": "lockstep", "move_budget": 0.0}
ENCODINGS = pytest.mark.parametrize("text", [True, False], ids=["json", "msgpack"])


async def created(connection: Raw, **fields: Any) -> dict[str, Any]:
    """Create an episode of three; return the `join` message."""
    answer = await connection.ask({**THREE, "move_budget": 0.0, **fields}, "created")
    return {"type": "join", "episode": answer["code"]}


def act(seq: int, seat: str | None = None, **fields: Any) -> dict[str, Any]:
    named = {"seat": seat} if seat is not None else {}
    return {"type": "act", "seq": seq, "action": None, **named, **fields}


def taken(server: Server, join: dict[str, Any]) -> list[str]:
    seats = server.lobby.find(join["episode"]).episode.seats.values()
    return [seat.name for seat in seats]


# Joining


@ENCODINGS
@virtual
async def test_all_free_seats(tmp_path: Path, text: bool) -> None:
    async with (
        serving(tmp_path) as server,
        raw(server, text=text) as bob,
        raw(server, text=text, name="ada") as ada,
        raw(server, text=text, name="ada") as late,
    ):
        join = await created(bob)
        assert (await bob.ask({**join, "seat": "robot2"}, "joined"))["seat"] == "robot2"
        joined = await ada.ask({**join, "seats": "all", "ref": 7}, "joined")
        assert (joined["ref"], joined["seat"]) == (7, "robot1")
        assert joined["seats"] == ["robot1", "robot3"]
        snapshot = await ada.expect("snapshot")
        assert snapshot["seat"] == "robot1"
        assert [answer["seat"] for answer in snapshot["answers"]] == ["robot3"]
        assert snapshot["phase"] == "running"
        assert [seat["name"] for seat in snapshot["seats"]] == ["ada", "raw", "ada"]
        assert (await late.ask({**join, "seats": "all"}, "joined"))["code"] == "episode/full"


@pytest.mark.parametrize(
    ("fields", "code", "field"),
    [
        ({"seats": ["robot1", "robot2"]}, "seat/taken", "seat"),
        ({"seats": ["robot2", "robot1", "robot3"]}, "seat/taken", "seat"),
        ({"seats": ["robot1", "robot9"]}, "seat/unknown", "seat"),
        ({"seats": ["robot1", "robot1"]}, "message/invalid-field", "seats"),
        ({"seats": ["robot1", "robot3"], "seat": "robot1"}, "message/invalid-field", "seats"),
        ({"seats": "all", "role": "spectator"}, "message/invalid-field", "seats"),
        ({"seats": ["all"]}, "seat/unknown", "seat"),
    ],
    ids=str,
)
@virtual
async def test_all_requested_seats_or_none(
    tmp_path: Path, fields: dict[str, Any], code: str, field: str
) -> None:
    async with serving(tmp_path) as server, raw(server) as bob, raw(server) as ada:
        join = await created(bob)
        await bob.ask({**join, "seat": "robot2"}, "joined")
        room = server.lobby.find(join["episode"])
        assert room.journal is not None
        size = room.journal.size
        refused = await ada.ask({**join, **fields}, "joined")
        assert (refused["type"], refused["code"]) == ("error", code)
        assert refused["field"] == field
        assert taken(server, join) == ["", "raw", ""]
        assert room.journal.size == size
        joined = await ada.ask({**join, "seats": ["robot3", "robot1"]}, "joined")
        assert joined["seats"] == ["robot1", "robot3"]


@virtual
async def test_token_for_one_seat_takes_no_more(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as host, opened(server) as ada:
        join = await created(host)
        await hello(ada, token=mint_token(server, Role.PLAYER, seat="robot2"))
        for seats in ("all", ["robot1", "robot2"], ["robot1"]):
            refused = await ada.ask({**join, "seats": seats}, "joined")
            assert (refused["code"], refused["field"]) == ("auth/seat", "seats")
        assert taken(server, join) == ["", "", ""]
        assert (await ada.ask({**join, "seats": ["robot2"]}, "joined"))["seat"] == "robot2"


@virtual
async def test_changes_are_charged_to_all_seats(tmp_path: Path) -> None:
    """A refused join must not use up the changes of another participant's seat."""
    async with serving(tmp_path) as server, raw(server) as bob:
        join = await created(bob)
        room = server.lobby.find(join["episode"])
        turnover = SeatTurnover(room.world.players, 0.0)
        for _ in range(2 * SEAT_CHANGES_AT_ONCE):
            refused = messages.Join(episode="x", seats=["robot1", "robot9"])
            with pytest.raises(ProtocolError, match="robot9"):
                turnover.choose(room.episode, refused, 0.0)
        both = messages.Join(episode="x", seats=["robot1", "robot2"])
        for _ in range(SEAT_CHANGES_AT_ONCE):
            turnover.choose(room.episode, both, 0.0)
        with pytest.raises(ProtocolError, match="changed hands too often") as caught:
            turnover.choose(room.episode, both, 0.0)
        assert caught.value.code == "rate/seats"
        free = messages.Join(episode="x")
        assert list(turnover.choose(room.episode, free, 0.0)) == ["robot3"]
        await bob.ask({**join, "seat": "robot3"}, "joined")


# Playing


@ENCODINGS
@virtual
async def test_each_seat_acts(tmp_path: Path, text: bool) -> None:
    async with serving(tmp_path) as server, raw(server, text=text) as ada:
        join = await created(ada)
        await ada.ask({**join, "seats": "all"}, "joined")
        await ada.expect("snapshot")
        await ada.send(act(1))
        await ada.send(act(5, "robot3"))
        assert (await ada.ask(act(1, "robot2"), "delta"))["step"] == 1
        foreign = await ada.ask(act(6, "robot4"), "rejected")
        assert (foreign["code"], foreign["seat"]) == ("seat/unknown", "robot4")
        wrong = {"name": "move", "args": ["robot1", "table1", "table1"]}
        rejected = await ada.ask(act(6, "robot2", action=wrong), "rejected")
        assert (rejected["seat"], rejected["seq"]) == ("robot2", 6)
        stale = await ada.ask(act(4, "robot3"), "rejected")
        assert (stale["code"], stale["seat"]) == ("action/stale", "robot3")
        snapshot = await ada.expect("snapshot")
        assert (snapshot["seq"], snapshot["last_seq"], snapshot["last_step"]) == (6, 1, 1)
        second, third = snapshot["answers"]
        assert (second["seat"], second["seq"], second["step"]) == ("robot2", 6, 1)
        assert second["reasons"] == rejected["reasons"]
        assert third == {"seat": "robot3", "seq": 5, "step": 1}


@virtual
async def test_other_participants_seat_does_not_act(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        join = await created(ada)
        await bob.ask({**join, "seat": "robot2"}, "joined")
        await ada.ask({**join, "seats": "all"}, "joined")
        episode = server.lobby.find(join["episode"]).episode
        for connection, seat in ((ada, "robot2"), (bob, "robot1")):
            rejected = await connection.ask(act(1, seat), "rejected")
            assert rejected["code"] == "seat/unknown"
            note = {"type": "note", "topic": "x", "text": "y", "seat": seat}
            refused = await connection.ask(note, "rejected")
            assert (refused["code"], refused["field"]) == ("seat/unknown", "seat")
        assert "seat" not in rejected, "whoever has one seat is not told which"
        assert [seat.seq for seat in episode.seats.values()] == [0, 0, 0]


@virtual
async def test_each_seat_gets_its_text_view(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        join = await created(ada)
        await ada.ask({**join, "seats": ["robot2", "robot1"], "view": "text"}, "joined")
        seen = [await ada.expect("observation") for _ in range(2)]
        assert [view["seat"] for view in seen] == ["robot1", "robot2"]
        assert [view["text"].splitlines()[0] for view in seen] == [
            "You are robot1.",
            "You are robot2.",
        ]
        async with raw(server) as bob:
            await bob.ask(join, "joined")
            for connection, seat in ((ada, "robot1"), (ada, "robot2"), (bob, "robot3")):
                await connection.send(act(1, seat))
            later = [await ada.expect("observation") for _ in range(2)]
            received = [(view["seat"], view["step"], view["seq"]) for view in later]
            assert received == [("robot1", 1, 1), ("robot2", 1, 1)]


@virtual
async def test_rejection_in_a_step_names_the_seat(tmp_path: Path) -> None:
    """Two of Ada's robots go to the same place; the second is rejected."""
    async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
        code = (await ada.create(**NO_BUDGET)).code
        game = await ada.join(code, seats="all", view="text")
        state = server.lobby.find(code).episode.state
        there: dict[str, dict[str, str]] = {}
        for seat in game.own_seats:
            for action in state.actions(seat):
                if action.name == "move":
                    there.setdefault(action.arguments[-1], {})[seat] = action.sentence
        both = next(seats for seats in there.values() if len(seats) > 1)
        (one, first), (two, second) = list(both.items())[:2]
        idle = [game.submit(None, seat) for seat in game.own_seats if seat not in (one, two)]
        results = await asyncio.gather(game.act(first, one), game.act(second, two), *idle)
        assert [result.applied for result in results] == [True, False, True]
        assert results[1].step == 1
        assert game.observations.keys() == set(game.own_seats)


@ENCODINGS
@virtual
async def test_client_library_plays_all_seats(tmp_path: Path, text: bool) -> None:
    encoding = "json" if text else "msgpack"
    async with (
        serving(tmp_path) as server,
        connect(server.url, name="ada", encoding=encoding) as ada,  # type: ignore[arg-type]
        connect(server.url, name="eve") as eve,
    ):
        code = (await ada.create(**NO_BUDGET)).code
        game = await ada.join(code, seats="all", view="both")
        assert (game.seat, game.own_seats) == ("robot1", ("robot1", "robot2", "robot3"))
        assert game.name == "ada"
        for _ in range(5):
            results = await asyncio.gather(*(game.act(None, seat) for seat in game.own_seats))
            assert [result.applied for result in results] == [True] * 3
        game.note("plan", "robot3 cuts", seat="robot3")
        game.say("hello")
        with pytest.raises(WrongArgumentError, match=r"^seats: must be 'all' or a list"):
            await eve.join(code, seats="robot1")
        with pytest.raises(ProtocolError, match="seats are taken"):
            await eve.join(code, seats="all")
        await ada.leave()
        assert (await eve.join(code, seats=["robot3", "robot2"])).own_seats == (
            "robot2",
            "robot3",
        )
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = list(recording.notes())
    sat = [(n["player"], n["name"], n["session"]) for n in notes if n["note"] == "roster"][:3]
    assert [player for player, _, _ in sat] == ["robot1", "robot2", "robot3"]
    assert len({(name, session) for _, name, session in sat}) == 1
    assert [(n["player"], n["text"]) for n in notes if n["note"] in ("said", "noted")] == [
        ("robot3", "robot3 cuts"),
        ("robot1", "hello"),
    ]


# Coming and going


async def seated(client: Client, **options: Any) -> Game:
    """Join two seats of an episode of three."""
    code = (await client.create(**{**NO_BUDGET, **options})).code
    return await client.join(code, seats=["robot1", "robot3"])


@virtual
async def test_lost_connection_affects_all_seats(tmp_path: Path) -> None:
    """Unanswered actions of each seat are applied once."""
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
        game = await seated(ada)
        other = await bob.join(game.code)
        while not game.running:
            await game.next_event()
        first, second = game.submit(None, "robot1"), game.submit(None, "robot3")
        await asyncio.sleep(1)
        cut(ada)
        await asyncio.sleep(0.05)
        episode = server.lobby.find(game.code).episode
        assert [seat.present for seat in episode.seats.values()] == [False, True, False]
        assert (await other.act(None)).step == 1
        assert [result.step for result in await asyncio.gather(first, second)] == [1, 1]
        assert [seat.present for seat in episode.seats.values()] == [True] * 3
        assert {seat.generation for seat in episode.seats.values() if seat.name == "ada"} == {1}


@pytest.mark.parametrize("hand_over", [True, False])
@virtual
async def test_restart_gives_all_seats_back(tmp_path: Path, hand_over: bool) -> None:
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(tmp_path))
        port = server.port
        ada = await stack.enter_async_context(connect(server.url, name="ada"))
        bob = await stack.enter_async_context(connect(server.url, name="bob"))
        game = await seated(ada)
        other = await bob.join(game.code)
        while not game.running:
            await game.next_event()
        waiting = [game.submit(None, seat) for seat in game.own_seats]
        await asyncio.sleep(1)
        if hand_over:
            await server.stop("restart", hand_over=True)
        else:
            await crash(server)
        await stack.enter_async_context(serving(tmp_path, seed=2, port=port))
        assert (await other.act(None)).step == 1
        assert [result.step for result in await asyncio.gather(*waiting)] == [1, 1]
        assert (game.own_seats, game.name) == (("robot1", "robot3"), "ada")
    (file,) = tmp_path.glob("*.rbt")
    assert read_recording(file).verify().ok


@virtual
async def test_old_token_gives_back_all_seats_or_none(tmp_path: Path) -> None:
    """Both seats were lost, and one has another participant now."""
    async with serving(tmp_path, grace=1.0) as server, raw(server) as host:
        join = await created(host, grace=1.0)
        await host.ask({**join, "seat": "robot2"}, "joined")
        async with raw(server, name="ada") as ada:
            joined = await ada.ask({**join, "seats": ["robot1", "robot3"]}, "joined")
        await asyncio.sleep(5)
        assert taken(server, join) == ["", "raw", ""]
        async with raw(server, name="eve") as eve:
            await eve.ask({**join, "seat": "robot3"}, "joined")
            async with raw(server, hello=False) as again:
                back = {**HELLO, "resume": joined["resume"]}
                assert (await again.ask(back, "welcome"))["code"] == "auth/expired"
                await again.ask(HELLO, "welcome")
                wanted = {**join, "seats": joined["seats"]}
                assert (await again.ask(wanted, "joined"))["code"] == "seat/taken"
                assert taken(server, join) == ["", "raw", "eve"]


@virtual
async def test_removed_participant_loses_all_seats(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server, name="ada") as ada:
        join = await created(ada)
        await ada.ask({**join, "seats": "all"}, "joined")
        room = server.lobby.find(join["episode"])
        room.kick(room.members[0], "rude")
        assert (await ada.expect("left"))["reason"] == "rude"
        assert taken(server, join) == ["", "", ""]
        assert (await ada.ask({**join, "seats": "all"}, "joined"))["code"] == "episode/banned"


@virtual
async def test_substitutes_play_all_seats(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        connect(server.url, name="ada", reconnect=False) as ada,
        connect(server.url, name="bob") as bob,
    ):
        game = await seated(ada, absence="bot", substitute="random")
        other = await bob.join(game.code)
        while not other.running:
            await other.next_event()
        cut(ada)
        for step in range(1, 4):
            assert (await other.act(None)).step == step
        controllers = [seat.controller for seat in other.seats]
        assert controllers == ["substitute", "bot", "substitute"]


@virtual
async def test_quota_is_per_seat(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        join = await created(ada)
        await ada.ask({**join, "seats": "all"}, "joined")
        seat = server.lobby.find(join["episode"]).episode.seat("robot2")
        seat.quota.take(10**9)
        refused = await ada.ask(act(1, "robot2", reasoning="well"), "rejected")
        assert (refused["code"], refused["seat"]) == ("rate/words", "robot2")
        await ada.send(act(2, "robot3", reasoning="well"))
        await ada.send(act(2, "robot2"))
        assert (await ada.ask(act(2), "delta", "rejected"))["step"] == 1
