"""Round trips, changes of seats, and display names."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille.protocol.participant_names import proper_name
from robotouille.replay import read_recording
from robotouille_client import Client
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.rooms.participants.seat_limits import (
    LOOK_SECONDS,
    SEAT_CHANGES,
    SEAT_CHANGES_AT_ONCE,
    DisplayNames,
)
from robotouille_server.transport.peer import Peer
from tests.support.lost_connections import transport_of
from tests.support.operator import Table, table, viewing
from tests.support.servers import Raw, crash, raw, serving
from tests.support.virtual_time import run, virtual


def test_rosters_show_latencies_of_connected_players(tmp_path: Path) -> None:
    async def main() -> list[list[int]]:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server) as ben:
            options = {"task": "multi_agent/01", "clock": "realtime", "step_rate": 1}
            created = await ada.ask({"type": "create", **options}, "created")
            for person in (ada, ben):
                await person.ask({"type": "join", "episode": created["code"]}, "joined")
            room = server.lobby.find(created["code"])
            (peer,) = (session.peer for session in room.members if session.player == "robot1")
            assert peer is not None
            peer.socket.latency = 0.38
            await asyncio.sleep(LOOK_SECONDS + 2)
            await ada.socket.close()
            received = []
            while not received or received[-1] != [0, 0] or [400, 0] not in received:
                roster = await ben.expect("roster")
                received.append([seat.get("latency_ms", 0) for seat in roster["seats"]])
            return received

    received = run(main())
    assert received.count([400, 0]) == 1 and received[-1] == [0, 0]


def test_recording_has_times_of_day_and_round_trips(
    tmp_path: Path,
) -> None:
    def wall() -> float:
        return 1_800_000_000.25 + asyncio.get_running_loop().time()

    async def main() -> float:
        async with serving(tmp_path, wall=wall) as server, raw(server) as ada:
            options = {"task": "synchronous/01", "clock": "realtime", "step_rate": 1}
            created = await ada.ask({"type": "create", **options}, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            began = asyncio.get_running_loop().time()
            room = server.lobby.find(created["code"])
            for session in room.members:
                assert session.peer is not None
                session.peer.socket.latency = 0.0421
            await asyncio.sleep(11.0)
            room.pause()
            await asyncio.sleep(3.0)
            room.resume()
            await asyncio.sleep(15.0)
            room.abort("seen")
            return began

    began = run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = list(recording.notes())
    assert [(n["player"], n["ms"]) for n in notes if n["note"] == "round_trip"] == [
        ("robot1", 42.1)
    ]
    started, resumed = (n for n in notes if n["note"] in ("started", "resumed"))
    assert started["utc_ms"] == pytest.approx((1_800_000_000.25 + began) * 1000, abs=50)
    assert resumed["utc_ms"] - started["utc_ms"] == pytest.approx(resumed["t"], abs=1)


PING_SECONDS = 20
"""Between two pings of the server."""
SLOW = 0.4
"""Seconds for which a client does not read the ping."""


def peers(server: Server, here: Table) -> dict[str, Peer]:
    members = server.lobby.find(here.code).members
    return {member.name: member.peer for member in members if member.peer is not None}


@asynccontextmanager
async def not_listening(client: Client) -> AsyncIterator[None]:
    """Stop a client from reading for a while."""
    transport = transport_of(client)
    transport.pause_reading()
    yield
    transport.resume_reading()


@virtual
async def test_latency_is_the_round_trip_of_a_ping(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    async with viewing(tmp_path) as (server, _, api):
        begun = loop.time()
        async with table(server) as here:
            assert await shown(api, here) == {"ada": None, "bob": None}
            await asyncio.sleep(begun + PING_SECONDS - 0.1 - loop.time())
            assert [peer.latency for peer in peers(server, here).values()] == [0.0, 0.0]
            async with not_listening(here.clients[0]):
                await asyncio.sleep(0.1 + SLOW)
            await asyncio.sleep(1)
            latency = peers(server, here)["ada"].latency
            assert SLOW - 0.1 < latency < SLOW + 0.5
            assert peers(server, here)["bob"].latency < SLOW - 0.1
            assert (await shown(api, here))["ada"] == round(1000 * latency, 1)


async def shown(api: Any, here: Table) -> dict[str, float | None]:
    """Return the latencies that the operator sees, by name."""
    row = await api.row(here.episode)
    return {seat["name"]: seat["latency_ms"] for seat in row["seats"]}


HELLO = {"type": "hello", "protocol": 1, "name": "eve"}


@virtual
async def test_changes_of_a_seat_are_limited(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", "task": "multi_agent/01"}, "created")
        join = {"type": "join", "episode": created["code"].lower().replace("-", " ")}
        await ada.ask({**join, "seat": "robot1"}, "joined")
        room = server.lobby.find(created["code"])
        taken = 0
        for _ in range(10):  # A new connection has a budget of its own.
            async with raw(server) as eve:
                for _ in range(12):
                    answer = await eve.ask(join, "joined")
                    if answer["type"] == "error":
                        assert answer["code"] == "rate/seats"
                        break
                    taken += 1
                    await eve.ask({"type": "leave"}, "left")
        assert taken <= SEAT_CHANGES_AT_ONCE + SEAT_CHANGES
        assert room.journal is not None
        assert room.journal.size < 100_000
        await asyncio.sleep(10)
        async with raw(server) as bob:
            assert (await bob.ask(join, "joined"))["seat"] == "robot2"


@virtual
async def test_unstable_client_must_wait_and_keeps_its_seat(tmp_path: Path) -> None:
    async with serving(tmp_path, grace=300) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", "task": "multi_agent/01"}, "created")
        join = {"type": "join", "episode": created["code"], "seat": "robot1"}
        joined = await ada.ask(join, "joined")
        resume, refused = joined["resume"], None
        for _ in range(SEAT_CHANGES_AT_ONCE + SEAT_CHANGES):
            async with raw(server, hello=False) as again:
                answer = await again.ask({**HELLO, "resume": resume}, "welcome", "bye")
                if answer["type"] == "bye":
                    refused = answer
                    break
                resume = (await again.expect("joined"))["resume"]
        assert refused is not None
        assert (refused["code"], refused["retry"]) == ("rate/seats", True)
        assert "lost and regained its connection too often" in refused["reason"]
        await asyncio.sleep(5)
        async with raw(server, hello=False) as again:
            assert (await again.ask({**HELLO, "resume": resume}, "welcome"))["resumed"] is True
            assert (await again.expect("joined"))["seat"] == "robot1"


@virtual
async def test_person_gets_a_seat_out_of_the_way(tmp_path: Path) -> None:
    """The first seat stands at the only sink. Bots and participants of studies get it."""
    async with serving(tmp_path) as server:

        async def seat_of(
            kind: str, *, seat: str | None = None, ready: bool = False, **labels: str
        ) -> str:
            async with raw(server, hello=False) as one:
                await one.ask({**HELLO, "kind": kind}, "welcome")
                create = {"type": "create", "task": "multi_agent/07", "seats": 4}
                created = await one.ask({**create, "labels": labels}, "created")
                join = {"type": "join", "episode": created["code"], "seat": seat}
                return (await one.ask({**join, "ready": ready}, "joined"))["seat"]

        assert await seat_of("human") == "robot2"
        assert await seat_of("human", ready=True) == "robot1"
        assert await seat_of("bot") == "robot1"
        assert await seat_of("human", seat="robot1") == "robot1"
        assert await seat_of("human", study="pilot") == "robot1"


TASK = "multi_agent/01"


async def enter(client: Raw, code: str, **request: Any) -> dict[str, Any]:
    joined = await client.ask({"type": "join", "episode": code, **request}, "joined")
    assert joined["type"] == "joined", joined
    return joined


async def opened(client: Raw) -> str:
    return str((await client.ask({"type": "create", "task": TASK}, "created"))["code"])


def seated(server: Server, code: str) -> list[str]:
    return [seat.name for seat in server.lobby.find(code).episode.seats.values()]


async def hello(client: Raw, name: str, **fields: Any) -> dict[str, Any]:
    return await client.ask({"type": "hello", "protocol": 1, "name": name, **fields}, "welcome")


@asynccontextmanager
async def two_of_a_name(folder: Path) -> AsyncIterator[tuple[Server, Raw, Raw, str]]:
    """Serve an episode that two clients called `ada` may join."""
    async with (
        serving(folder) as server,
        raw(server, name="ada") as one,
        raw(server, name="ada") as two,
    ):
        yield server, one, two, await opened(one)


@virtual
async def test_second_participant_of_a_name_gets_a_number(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        raw(server, name="ada") as one,
        raw(server, name="\u202eADA\u200b") as two,
        raw(server, name="ａｄａ") as three,
    ):
        code = await opened(one)
        assert (await enter(one, code))["name"] == "ada"
        assert (await enter(two, code))["name"] == "ADA 2"
        assert (await enter(three, code, role="spectator"))["name"] == "ada 3"
        assert seated(server, code) == ["ada", "ADA 2"]
        await two.send({"type": "say", "text": "hi"})
        assert (await three.expect("said"))["name"] == "ADA 2"
        await three.send({"type": "say", "text": "hi"})
        while "seat" in (said := await one.expect("said")):
            pass
        assert said["name"] == "ada 3"


@virtual
async def test_name_is_unique_per_episode_and_reusable(tmp_path: Path) -> None:
    async with two_of_a_name(tmp_path) as (_, one, two, code):
        await enter(one, code, role="spectator")
        assert (await enter(two, code, role="spectator"))["name"] == "ada 2"
        await two.ask({"type": "leave"}, "left")
        assert (await enter(two, await opened(two)))["name"] == "ada"
        await two.ask({"type": "leave"}, "left")
        await one.ask({"type": "leave"}, "left")
        assert (await enter(two, code))["name"] == "ada"
        assert (await enter(one, code))["name"] == "ada 2"


@virtual
async def test_refused_join_reserves_no_name(tmp_path: Path) -> None:
    async with two_of_a_name(tmp_path) as (_, one, two, code):
        await enter(one, code)
        refused = await two.ask({"type": "join", "episode": code, "seat": "robot1"}, "joined")
        assert refused["code"] == "seat/taken"
        for _ in range(2):
            assert (await enter(two, code))["name"] == "ada 2"
            await two.ask({"type": "leave"}, "left")


@virtual
async def test_returning_participant_keeps_the_name(tmp_path: Path) -> None:
    async with two_of_a_name(tmp_path) as (server, one, two, code):
        await enter(one, code)
        token = (await enter(two, code))["resume"]
        await two.socket.close()
        await asyncio.sleep(0.1)
        async with raw(server, hello=False) as again:
            await hello(again, "ada", resume=token)
            joined = await again.expect("joined")
            assert joined["name"] == "ada 2"
        await crash(server)
    async with serving(tmp_path, seed=2) as server:
        async with raw(server, hello=False) as again, raw(server, name="Ada") as third:
            await hello(again, "somebody else", resume=joined["resume"])
            assert (await again.expect("joined"))["name"] == "ada 2"
            assert seated(server, code) == ["ada", "ada 2"]
            assert (await enter(third, code, role="spectator"))["name"] == "Ada 3"
            await again.ask({"type": "leave"}, "left")
            assert (await enter(again, await opened(again)))["name"] == "ada"


@virtual
async def test_invisible_name_is_refused(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server, hello=False) as client:
        answer = await hello(client, "\u200b \u202e\u3164")
        assert (answer["code"], answer["field"]) == ("message/invalid-field", "name")
        assert answer["message"] == "the name has no visible character"
        assert (await hello(client, "ada"))["type"] == "welcome"


def test_thousands_of_equal_names_are_numbered_quickly() -> None:
    names, asked = DisplayNames(lambda: [("robot1", "ada"), ("robot2", "")]), []
    for _ in range(5000):
        name = names.choose("eve")
        names.watch(name)
        asked.append(name)
    assert len(set(asked)) == 5000


@pytest.mark.parametrize("name", ["Operator", "SERVER", "\uff53ystem", "robot2", "Robot\u00b2"])
@pytest.mark.parametrize("role", ["player", "spectator"])
@virtual
async def test_nobody_can_pose_as_the_operator_or_another_seat(
    tmp_path: Path, name: str, role: str
) -> None:
    async with serving(tmp_path) as server, raw(server, hello=False) as eve:
        await hello(eve, name)
        created = await eve.ask({"type": "create", "task": "multi_agent/01"}, "created")
        join = {"type": "join", "episode": created["code"], "role": role}
        assert (await eve.ask(join, "joined"))["name"] == f"{proper_name(name)} 2"


@pytest.mark.parametrize("chat", ["off", "signals", "free"])
@pytest.mark.parametrize("role", ["player", "spectator"])
@virtual
async def test_names_do_not_replace_chat(tmp_path: Path, role: str, chat: str) -> None:
    names = []
    async with serving(tmp_path) as server, raw(server) as host:
        order = {"type": "create", "task": "multi_agent/01", "chat": chat}
        code = (await host.ask(order, "created"))["code"]
        token = server.tokens.mint_role(Role.PLAYER, "p-1", seconds=3600, episode=code)
        join = {"type": "join", "episode": code, "role": role}
        for name in ("eve", "wait at the stove"):
            async with raw(server, hello=False) as eve:
                greeting = {"type": "hello", "protocol": 1, "name": name, "token": token}
                await eve.ask(greeting, "welcome")
                names.append((await eve.ask(join, "joined"))["name"])
                await eve.ask({"type": "leave"}, "left")
    assert names == ["eve", "wait at the stove" if chat == "free" else "eve"]


@virtual
async def test_participant_may_have_the_name_of_the_own_seat(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server, hello=False) as client:
        await hello(client, "Robot2")
        created = await client.ask({"type": "create", "task": "multi_agent/01"}, "created")
        join = {"type": "join", "episode": created["code"], "seat": "robot2"}
        assert (await client.ask(join, "joined"))["name"] == "Robot2"
