"""A server that is killed, or restarted, goes on with every episode; nobody loses anything."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille import GroundAction
from robotouille.replay.recording import read_recording
from robotouille.world.world import State
from robotouille_client import Changed, Client, Game, Heard, connect
from robotouille_client.bots import RandomPolicy, play
from robotouille_server import Server
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import run


async def two_seats(ada: Client, bob: Client, **options) -> tuple[Game, Game]:  # type: ignore[no-untyped-def]
    created = await ada.create("multi_agent/02", **options)
    return await ada.join(created.code), await bob.join(created.code)


class Tripwire(RandomPolicy):
    """Plays at random, and says when it has decided so and so often."""

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


@pytest.mark.parametrize("clock", ["turn", "lockstep", "realtime"])
def test_a_game_outlives_its_server(tmp_path: Path, clock: str) -> None:
    """Killed three times: the same states, no step lost, no action done twice."""

    async def main() -> tuple[dict, dict]:  # type: ignore[type-arg]
        states: dict[int, str] = {}
        async with serving(tmp_path) as first:
            port = first.port
            async with (
                connect(first.url, name="ada", seed=1) as ada,
                connect(first.url, name="bob", seed=2) as bob,
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


def test_after_a_restart_a_client_gets_only_what_it_has_not_seen(tmp_path: Path) -> None:
    async def main() -> None:
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
                pictures = [e for e in game.poll() if isinstance(e, Changed)]
                assert pictures == []
                assert (game.step, game.state.digest) == (3, digest)
                room = next(iter(second.lobby.rooms.values()))
                assert room.episode.state.digest == digest
                assert (await game.act(None)).applied

    run(main())


def test_an_action_that_was_not_confirmed_is_done_once_after_the_restart(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as first:
            async with connect(first.url, name="ada") as ada, connect(first.url, name="bob") as bob:
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

    run(main())
    moves = [m for frame in the_recording(tmp_path).steps for m in frame["moves"]]
    assert [m["player"] for m in moves] == ["robot1"]


def test_an_episode_that_was_created_is_there_after_a_crash(tmp_path: Path) -> None:
    """Its code was told: it must be good, with its rules, though nobody had joined."""

    async def main() -> None:
        async with serving(tmp_path) as first:
            async with raw(first) as client:
                request = {"type": "create", "task": "synchronous/02", "max_steps": 77}
                created = await client.ask(request, "created")
            await crash(first)
        async with serving(tmp_path, seed=2) as second, connect(second.url, name="ada") as ada:
            game = await ada.join(created["code"])
            assert game.episode == created["episode"]
            assert game.clock["max_steps"] == 77

    run(main())


def test_the_clock_waits_for_those_who_were_there(tmp_path: Path) -> None:
    """After a restart nobody loses steps because the other one is back sooner."""

    async def main() -> None:
        async with serving(tmp_path) as first:
            async with connect(first.url, name="ada") as ada:
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

    run(main())


def test_chat_is_not_lost_and_not_said_twice(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as first:
            async with connect(first.url, name="ada") as ada, connect(first.url, name="bob") as bob:
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
                        heard = [e.text for e in game.poll() if isinstance(e, Heard)]
                        assert heard == ["before", "after"]

    run(main())


def test_a_restart_hands_over_and_clients_follow(tmp_path: Path) -> None:
    """SIGTERM's way: the old process lets go, the next one goes on, the game never ends."""

    async def main() -> None:
        async with serving(tmp_path) as first:
            async with connect(first.url, name="ada") as ada, connect(first.url, name="bob") as bob:
                one, two = await two_seats(ada, bob)
                await asyncio.gather(one.act(one.actions[0]), two.act(None))
                port = first.port
                await first.stop("the server is restarted", hand_over=True)
                async with serving(tmp_path, seed=2, port=port):
                    await asyncio.gather(one.act(one.actions[0]), two.act(None))
                    assert one.step == two.step == 2
                    assert one.state == two.state
                    assert not one.ended

    run(main())
    assert the_recording(tmp_path).verify().ok


def test_while_the_old_process_drains_the_next_one_asks_to_wait(tmp_path: Path) -> None:
    """Both are there at a time: an episode belongs to the old one until it lets go."""

    async def main() -> None:
        async with serving(tmp_path) as old, connect(old.url, name="bob") as bob:
            async with connect(old.url, name="ada", seed=5) as ada:
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
                    assert ada._socket is not None
                    ada._socket.transport.abort()
                    await asyncio.gather(one.act(one.actions[0]), two.act(None))
                    assert len(new.lobby.rooms) == 1
                    assert (one.step, one.state) == (two.step, two.state)
                draining.cancel()

    run(main())


async def raw_error(client: Client, message: dict) -> str:  # type: ignore[type-arg]
    from robotouille import ProtocolError

    try:
        await client.create("synchronous/01")
    except ProtocolError as error:
        return error.code
    return ""


def test_a_finished_episode_whose_server_died_is_closed_at_the_next_start(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, max_steps=2) as server, connect(server.url, name="ada") as ada:
            game = await ada.join((await ada.create("synchronous/01")).code)
            for _ in range(2):
                await game.act(None)
        (whole,) = tmp_path.glob("*.rbt")
        from robotouille.replay.container import unwrap

        part = whole.with_suffix(".rbt.part")
        part.write_bytes(unwrap(whole.read_bytes()))
        whole.unlink()
        async with serving(tmp_path, seed=2) as server:
            assert not server.lobby.rooms

    run(main())
    assert the_recording(tmp_path).verify().complete
    assert not list(tmp_path.glob("*.part"))


def test_what_cannot_be_restored_is_left_alone_and_named(tmp_path: Path) -> None:
    broken = tmp_path / "20260101T000000Z_x_00ff00ff00ff00ff.rbt.part"
    broken.write_bytes(b"RBTL\x01" + b"\x10\x00\x00\x00garbagegarbagegarbagegarbage")
    torn = tmp_path / "20260101T000000Z_x_00ff00ff00ff0000.rbt.part"
    torn.write_bytes(b"RBTL\x01\x99\x00")

    async def main() -> None:
        async with serving(tmp_path) as server:
            assert not server.lobby.rooms
            (reason,) = server.lobby.unrestored.values()
            assert "checksum" in reason

    run(main())
    assert broken.exists()
    assert not torn.exists()


def test_episodes_that_nobody_came_to_leave_no_file(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            await ada.create("synchronous/01")
            assert len(list(tmp_path.glob("*.part"))) == 1

    run(main())
    assert not list(tmp_path.iterdir())


def test_who_missed_the_end_is_told_after_a_restart(tmp_path: Path) -> None:
    """The server dies just after a game's end, before everybody has heard of it."""

    async def main() -> None:
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

    run(main())


def test_a_seat_whose_answer_was_lost_in_the_crash_is_not_lost(tmp_path: Path) -> None:
    """`join` was recorded, but `joined` never arrived: the token from before it is good enough."""

    async def main() -> None:
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

    run(main())


def test_somebody_who_watched_goes_on_watching(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as first, connect(first.url, name="ada", seed=1) as ada:
            async with connect(first.url, name="eve", seed=2) as eve:
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

    run(main())
