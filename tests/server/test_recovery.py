"""Recovery: a killed or restarted server continues every episode."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille import GroundAction
from robotouille.replay.container import MAGIC
from robotouille.replay.recording import read_recording
from robotouille.world.world import State
from robotouille_client import ChatReceived, Client, Game, StateChanged, connect
from robotouille_client.bots import RandomPolicy, play
from robotouille_server import Server
from tests.support.lost_connections import cut
from tests.support.samples import quick_sample
from tests.support.servers import crash, raw, serving, with_clients
from tests.support.virtual_time import run, virtual


async def two_seats(ada: Client, bob: Client, **options) -> tuple[Game, Game]:  # type: ignore[no-untyped-def]
    created = await ada.create("multi_agent/02", **options)
    return await ada.join(created.code), await bob.join(created.code)


class Tripwire(RandomPolicy):
    """Random player that reports after some decisions."""

    def __init__(self, player: str, reached: dict[int, asyncio.Event]) -> None:
        super().__init__(player, 3)
        self._reached = reached
        self._decisions = 0

    def act(self, state: State) -> GroundAction | None:
        self._decisions += 1
        if self._decisions in self._reached:
            self._reached[self._decisions].set()
        return super().act(state)


def the_recording(folder: Path):  # type: ignore[no-untyped-def]
    (file,) = folder.glob("*.rbt*")
    return read_recording(file)


@pytest.mark.parametrize("clock", quick_sample(["lockstep", "turn", "realtime"]))
def test_episode_survives_three_kills(tmp_path: Path, clock: str) -> None:

    async def main() -> tuple[dict, dict]:  # type: ignore[type-arg]
        states: dict[int, str] = {}
        async with serving(tmp_path) as first:
            port = first.port
            async with (
                connect(first.url, name="ada") as ada,
                connect(first.url, name="bob") as bob,
            ):
                games = await two_seats(ada, bob, clock=clock, max_steps=120)
                reached = {decisions: asyncio.Event() for decisions in (3, 6, 9)}
                players = [
                    asyncio.create_task(
                        play(game, lambda s, p: Tripwire(p, reached), threaded=False)
                    )
                    for game in games
                ]
                server: Server = first
                for seed, event in enumerate(reached.values(), 2):
                    await event.wait()
                    states[games[0].step] = games[0].state.digest
                    await crash(server)
                    again = serving(tmp_path, seed=seed, port=port)
                    server = await again.__aenter__()
                    assert len(server.lobby.rooms) == 1
                outcomes = await asyncio.gather(*players)
                await again.__aexit__(None, None, None)
        return states, outcomes[0]

    states, outcome = run(main())
    recording = the_recording(tmp_path)
    verification = recording.verify()
    assert verification.ok, verification.fault
    assert verification.complete
    assert (outcome["reason"], outcome["steps"]) == ("step_limit", 120)
    assert len(states) == 3
    recorded = {step: state.digest for step, state in recording.states()}
    assert states.items() <= recorded.items()
    moves = [(m["player"], m["seq"]) for f in recording.steps for m in f["moves"]]
    assert len(moves) == len(set(moves)) > 20
    restarts = [note for note in recording.notes() if note["note"] == "restarted"]
    assert len(restarts) == 3


@virtual
async def test_client_gets_only_missed_messages_after_a_restart(tmp_path: Path) -> None:
    async with serving(tmp_path) as first, connect(first.url, name="ada") as ada:
        game = await ada.join((await ada.create("synchronous/01")).code)
        for _ in range(3):
            await game.act(game.actions[0])
        digest, port = game.state.digest, first.port
        game.poll()
        await crash(first)
        async with serving(tmp_path, seed=2, port=port) as second:
            await asyncio.sleep(3)
            await ada.connected.wait()
            pictures = [e for e in game.poll() if isinstance(e, StateChanged)]
            assert pictures == []
            assert (game.step, game.state.digest) == (3, digest)
            room = next(iter(second.lobby.rooms.values()))
            assert room.episode.state.digest == digest
            assert (await game.act(None)).applied


@virtual
async def test_unconfirmed_action_is_applied_once(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (first, ada, bob):
        one, two = await two_seats(ada, bob)
        pending = one.submit(one.actions[0])
        await asyncio.sleep(0.1)
        port = first.port
        await crash(first)
        async with serving(tmp_path, seed=2, port=port):
            await asyncio.sleep(3)
            await two.act(None)
            assert (await pending).applied
            assert one.step == two.step == 1
    moves = [m for frame in the_recording(tmp_path).steps for m in frame["moves"]]
    assert [m["player"] for m in moves] == ["robot1"]


@virtual
async def test_new_episode_survives_a_crash(tmp_path: Path) -> None:
    async with serving(tmp_path) as first:
        async with raw(first) as client:
            request = {"type": "create", "task": "synchronous/02", "max_steps": 77}
            created = await client.ask(request, "created")
        await crash(first)
    async with serving(tmp_path, seed=2) as second, connect(second.url, name="ada") as ada:
        game = await ada.join(created["code"])
        assert game.episode == created["episode"]
        assert game.clock["max_steps"] == 77


@virtual
async def test_clock_waits_for_returning_players(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada") as (first, ada):
        async with connect(first.url, name="bob") as bob:
            one, _ = await two_seats(ada, bob, clock="realtime")
            while one.step < 5:
                await asyncio.sleep(0.1)
            port = first.port
            await crash(first)
        async with serving(tmp_path, seed=2, port=port, recovery_seconds=8):
            await asyncio.sleep(3)
            step = one.step
            assert one.paused
            assert one.pause is not None
            assert one.pause.reason == "restart"
            await asyncio.sleep(3)
            assert one.step == step
            await asyncio.sleep(4)
            assert not one.paused
            assert one.step > step


@virtual
async def test_chat_is_sent_exactly_once(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (first, ada, bob):
        one, two = await two_seats(ada, bob)
        one.say("before")
        await asyncio.sleep(0.1)
        port = first.port
        await crash(first)
        async with serving(tmp_path, seed=2, port=port):
            await asyncio.sleep(3)
            two.say("after")
            await asyncio.sleep(1)
            for game in (one, two):
                received = [e.text for e in game.poll() if isinstance(e, ChatReceived)]
                assert received == ["before", "after"]


@virtual
async def test_restart_hands_over_and_clients_follow(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (first, ada, bob):
        one, two = await two_seats(ada, bob)
        await asyncio.gather(one.act(one.actions[0]), two.act(None))
        port = first.port
        await first.stop("the server is restarted", hand_over=True)
        async with serving(tmp_path, seed=2, port=port):
            await asyncio.gather(one.act(one.actions[0]), two.act(None))
            assert one.step == two.step == 2
            assert one.state == two.state
            assert not one.ended
    assert the_recording(tmp_path).verify().ok


@virtual
async def test_next_process_asks_to_wait_while_the_old_one_drains(tmp_path: Path) -> None:
    async with serving(tmp_path) as old, connect(old.url, name="bob") as bob:
        async with connect(old.url, name="ada") as ada:
            one, two = await two_seats(ada, bob)
            port = old.port
            draining = asyncio.create_task(old.drain(60))
            await asyncio.sleep(1)
            refused = await raw_error(bob, {"type": "create", "ref": 900})
            assert refused == "server/draining"
            async with serving(tmp_path, seed=2, port=port) as new:
                assert not new.lobby.rooms
                async with raw(new) as visitor:
                    answer = await visitor.ask({"type": "join", "episode": one.code}, "joined")
                    assert answer["code"] == "server/handover"
                await asyncio.gather(one.act(one.actions[0]), two.act(None))
                cut(ada)
                await asyncio.gather(one.act(one.actions[0]), two.act(None))
                assert len(new.lobby.rooms) == 1
                assert (one.step, one.state) == (two.step, two.state)
            draining.cancel()


async def raw_error(client: Client, message: dict) -> str:  # type: ignore[type-arg]
    from robotouille import ProtocolError

    try:
        await client.create("synchronous/01")
    except ProtocolError as error:
        return error.code
    return ""


@virtual
async def test_invalid_recording_is_reported_and_kept(tmp_path: Path) -> None:
    broken = tmp_path / "20260101T000000Z_x_00ff00ff00ff00ff.rbt.part"
    broken.write_bytes(MAGIC + b"\x10\x00\x00\x00garbagegarbagegarbagegarbage")
    torn = tmp_path / "20260101T000000Z_x_00ff00ff00ff0000.rbt.part"
    torn.write_bytes(MAGIC + b"\x99\x00")
    async with serving(tmp_path) as server:
        assert not server.lobby.rooms
        (reason,) = server.lobby.unrestored.values()
        assert "checksum" in reason
    assert broken.exists()
    assert not torn.exists()


@virtual
async def test_unused_episodes_leave_no_file(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
        await ada.create("synchronous/01")
        assert len(list(tmp_path.glob("*.part"))) == 1
    assert not list(tmp_path.iterdir())


@virtual
async def test_missed_end_is_shown_after_a_restart(tmp_path: Path) -> None:
    async with serving(tmp_path) as first, connect(first.url, name="ada") as ada:
        async with raw(first) as bob:
            one = await ada.join((await ada.create("multi_agent/02", max_steps=1)).code)
            joined = await bob.ask({"type": "join", "episode": one.code}, "joined")
            await bob.send({"type": "act", "seq": 1, "action": None})
            assert (await one.act(None)).applied
        port = first.port
        await crash(first)
        async with serving(tmp_path, seed=2, port=port) as second:
            assert not second.lobby.rooms
            async with raw(second, hello=False) as bob:
                hello = {"type": "hello", "protocol": 1, "name": "bob"}
                welcome = await bob.ask({**hello, "resume": joined["resume"]}, "welcome")
                assert welcome["resumed"] is True
                snapshot = await bob.expect("snapshot")
                assert snapshot["outcome"]["reason"] == "step_limit"


@virtual
async def test_seat_survives_a_lost_joined_message(tmp_path: Path) -> None:
    async with serving(tmp_path) as first:
        async with raw(first, hello=False) as bob:
            hello = {"type": "hello", "protocol": 1, "name": "bob"}
            welcome = await bob.ask(hello, "welcome")
            created = await bob.ask({"type": "create", "task": "multi_agent/02"}, "created")
            await bob.ask({"type": "join", "episode": created["code"]}, "joined")
        await crash(first)
    async with serving(tmp_path, seed=2) as second, raw(second, hello=False) as bob:
        again = await bob.ask({**hello, "resume": welcome["resume"]}, "welcome")
        assert again["resumed"] is True
        assert (await bob.expect("joined"))["seat"] == "robot1"


@virtual
async def test_spectator_continues_after_a_restart(tmp_path: Path) -> None:
    async with serving(tmp_path) as first, connect(first.url, name="ada") as ada:
        async with connect(first.url, name="eve") as eve:
            one = await ada.join((await ada.create("synchronous/01")).code)
            other = await eve.join(one.code, role="spectator")
            await one.act(one.actions[0])
            port = first.port
            await crash(first)
            async with serving(tmp_path, seed=2, port=port) as second:
                await asyncio.sleep(3)
                await one.act(one.actions[0])
                await asyncio.sleep(0.1)
                assert other.state == one.state
                room = second.lobby.find(one.code)
                assert room.spectators == 1
                assert not other.ended
