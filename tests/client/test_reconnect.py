"""The client library finds its way back; a bot's code does not notice."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille import ProtocolError
from robotouille.replay.recording import read_recording
from robotouille_client import Changed, Client, Game, Heard, Over, connect
from robotouille_client.bots import RandomPolicy, play
from robotouille_client.errors import ConnectionFailedError
from robotouille_server import ServerSettings, serve
from tests.support.lost_connections import cut, start
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import run


def test_a_lost_connection_comes_back_into_its_seat(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            async with connect(server.url, name="bob") as bob:
                one, two = await start(server, ada, bob)
                for _ in range(3):
                    await asyncio.gather(one.act(one.actions[0]), two.act(None))
                cut(ada)
                await two.act(two.actions[0])
                await asyncio.sleep(2)
                await ada.connected.wait()
                result = await asyncio.gather(one.act(one.actions[0]), two.act(None))
                assert all(r.applied for r in result)
                assert one.seat == "robot1"
                assert one.state == two.state
                assert [s.present for s in two.seats] == [True, True]

    run(main())


def test_an_action_in_flight_is_done_once(tmp_path: Path) -> None:
    """Cut after the action is sent, before it is answered: it is sent again and acts once."""

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            async with connect(server.url, name="bob") as bob:
                one, two = await start(server, ada, bob)
                pending = one.submit(one.actions[0])
                await asyncio.sleep(0.1)
                cut(ada)
                await asyncio.sleep(3)
                await two.act(two.actions[0])
                assert (await pending).applied
                await asyncio.gather(one.act(None), two.act(None))
                assert (one.step, one.state) == (two.step, two.state)
        (file,) = tmp_path.glob("*.rbt")
        moves = [
            m for f in read_recording(file).steps for m in f["moves"] if m["player"] == "robot1"
        ]
        assert len(moves) == 1

    run(main())


@pytest.mark.parametrize("clock", ["turn", "lockstep", "realtime"])
def test_bots_finish_although_their_lines_break(tmp_path: Path, clock: str) -> None:
    async def main() -> list[dict]:  # type: ignore[type-arg]
        async with serving(tmp_path, max_steps=60) as server:
            async with (
                connect(server.url, name="ada") as ada,
                connect(server.url, name="bob") as bob,
            ):
                games = await start(server, ada, bob, clock=clock)

                async def trouble() -> None:
                    for client in (ada, bob, ada, bob, bob):
                        await asyncio.sleep(0.7)
                        cut(client)

                players = [
                    play(game, lambda s, p: RandomPolicy(p, 3), threaded=False) for game in games
                ]
                *outcomes, _ = await asyncio.gather(*players, trouble())
                return outcomes

    outcomes = run(main())
    assert [o["reason"] for o in outcomes] == ["step_limit"] * 2
    (file,) = tmp_path.glob("*.rbt")
    assert read_recording(file).verify().ok


def test_a_line_that_breaks_after_the_end_breaks_nothing_else(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, max_steps=2) as server, connect(server.url, name="ada") as ada:
            game = await ada.join((await ada.create("synchronous/01")).code)
            while not game.over:
                await game.act(None)
            cut(ada)
            await asyncio.sleep(2)
            assert ada.connected.is_set()
            assert ada.game is game
            await ada.leave()
            assert (await ada.join((await ada.create("synchronous/02")).code)).step == 0

    run(main())


def test_who_was_away_too_long_loses_the_seat_and_joins_anew(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, grace=1.0) as server:
            async with connect(server.url, name="bob") as bob:
                ada = Client(server.url, name="ada", reconnect=False)
                async with ada:
                    one, two = await start(server, ada, bob)
                    cut(ada)
                    assert isinstance([e async for e in one][-1], Over)
                await asyncio.sleep(5)
                assert [s.name for s in two.seats] == ["", "bob"]
                async with connect(server.url, name="carol") as carol:
                    game = await carol.join(two.code)
                    assert game.seat == "robot1"
                    assert game.state == two.state

    run(main())


def test_two_connections_with_one_token(tmp_path: Path) -> None:
    """The later wins, and the earlier is told."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, hello=False) as first:
            hello = {"type": "hello", "protocol": 1, "name": "ada"}
            welcome = await first.ask(hello, "welcome")
            async with raw(server, hello=False) as second:
                again = await second.ask({**hello, "resume": welcome["resume"]}, "welcome")
                assert again["resumed"] is True
                assert again["session"] == welcome["session"]
                assert "elsewhere" in (await first.expect("bye"))["reason"]
                assert (await second.ask({"type": "list"}, "episodes"))["type"] == "episodes"

    run(main())


def test_no_server_there() -> None:
    async def main() -> None:
        with pytest.raises(
            ConnectionFailedError, match=r"nobody answers at ws://127\.0\.0\.1:9: is a"
        ):
            async with connect("ws://127.0.0.1:9", name="ada"):
                pass

    asyncio.run(main())


def test_chat_and_text_view(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            async with connect(server.url, name="ada", encoding="json") as ada:
                async with connect(server.url, name="bob") as bob:
                    created = await ada.create("multi_agent/01")
                    one = await ada.join(created.code, view="text")
                    two = await bob.join(created.code, view="both")
                    two.say("I cook, you cut")
                    await heard(one, "I cook, you cut")
                    assert not one.has_state
                    assert one.observation is not None
                    sentence = one.observation.actions[0]
                    results = await asyncio.gather(one.act(sentence), two.act(None))
                    assert all(r.applied for r in results)
                    assert one.observation.step == 1
                    assert one.observation.text == two.state.text_view("robot1")
                    refused = await one.act("Boil the sea")
                    assert not refused.applied
                    assert refused.code == "action/unknown"

    run(main())


async def heard(game: Game, text: str) -> None:
    async for event in game:
        if isinstance(event, Heard):
            assert event.text == text
            return


def test_a_corrupted_copy_is_noticed_and_mended(tmp_path: Path) -> None:
    """The state hash differs: the client asks for a snapshot by itself."""

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            created = await ada.create("synchronous/01")
            game = await ada.join(created.code)
            await game.act(game.actions[0])
            assert game._reader is not None
            clear = next(i for i, bit in enumerate(game._reader._atoms) if game.state.facts & bit)
            game._reader._facts ^= game._reader._atoms[clear]
            room = server.lobby.find(created.code)
            while game.step < 10:
                await game.act(None)
            await asyncio.sleep(1)
            changes = [e for e in game.poll() if isinstance(e, Changed)]
            assert any(e.previous is None for e in changes[1:]), "no snapshot came"
            assert game.state.digest == room.episode.state.digest

    run(main())


def test_errors_of_requests_are_raised(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            with pytest.raises(ProtocolError, match="did you mean"):
                await ada.create("synchronous/01_cheese_sandwitch")
            with pytest.raises(ProtocolError) as error:
                await ada.join("NOPE")
            assert error.value.code == "episode/unknown"

    run(main())


def test_after_a_crash_of_the_server_a_game_that_is_gone_is_over(tmp_path: Path) -> None:
    """The server is killed and started anew: the client comes back, and learns that it is over."""

    async def main() -> None:
        async with serving(tmp_path / "first") as server:
            port = server.port
            async with connect(server.url, name="ada") as ada:
                game = await ada.join((await ada.create("synchronous/01")).code)
                await game.act(game.actions[0])
                pending = game.submit(None)
                await crash(server)
                settings = ServerSettings(port=port, recordings=tmp_path / "second")
                async with serve(settings):
                    last = [event async for event in game][-1]
                    assert isinstance(last, Over)
                    assert "no episode" in last.reason
                    assert not (await pending).applied or game.step == 2
                    assert not (await game.act(None)).applied
                    assert (await ada.create("synchronous/02")).code

    run(main())


@pytest.mark.parametrize("how", ["sentence", "place"])
def test_an_action_sent_again_after_its_step_is_not_called_unknown(
    tmp_path: Path, how: str
) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            created = await ada.ask({"type": "create", "task": "synchronous/01"}, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            room = server.lobby.find(created["code"])
            move = room.episode.state.actions("robot1")[0]
            wanted = move.sentence if how == "sentence" else 0
            act = {"type": "act", "seq": 1, "action": wanted, "basis": 0}
            await ada.ask(act, "delta")
            answer = await ada.ask(act, "snapshot", "rejected")
            assert (answer["type"], answer["last_seq"], answer["last_step"]) == ("snapshot", 1, 1)
            assert room.episode.step == 1

    run(main())


def test_chat_is_on_disk_before_any_step(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            game = await ada.join((await ada.create("multi_agent/01")).code)
            game.say("is anybody there?")
            await heard(game, "is anybody there?")
            (file,) = tmp_path.glob("*.rbt.part")
            said = [n["text"] for n in read_recording(file).notes() if n["note"] == "said"]
            assert said == ["is anybody there?"]

    run(main())


def test_a_slow_player_for_whom_all_wait_is_caught_up(tmp_path: Path) -> None:
    """Its delta was withheld, and without its move there is no further step to bring a snapshot."""

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
            async with connect(server.url, name="bob") as bob:
                one, two = await start(server, ada, bob)
                room = server.lobby.find(one.code)
                peer = next(s for s in room.members if s.player == two.seat).peer
                assert peer is not None
                full = [True]
                genuine = type(peer).unsent
                crowded = property(lambda p: 10**6 if p is peer and full[0] else genuine.fget(p))
                type(peer).unsent = crowded  # type: ignore[method-assign, assignment]
                try:
                    pending = two.submit(None)
                    await one.act(one.actions[0])
                    assert two.step == 0
                    full[0] = False
                    assert (await pending).applied
                    assert two.state == one.state
                finally:
                    type(peer).unsent = genuine  # type: ignore[method-assign]

    run(main())
