"""Reconnecting: the client library returns to its seat without the bot noticing."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path

from robotouille.planning.policies.policy import Speech
from robotouille.replay.recording import read_recording
from robotouille_client import ChatReceived, Game, GameEnded, connect
from robotouille_client.bots import RandomPolicy, play
from robotouille_server import Server, ServerSettings, serve
from tests.support.lost_connections import cut, start
from tests.support.servers import crash, serving
from tests.support.virtual_time import opening, virtual


@opening(serving)
async def test_lost_connection_returns_to_its_seat(server: Server) -> None:
    async with connect(server.url, name="ada") as ada:
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


@virtual
async def test_action_in_flight_is_executed_once(tmp_path: Path) -> None:
    """The connection is lost between the action and its answer, so the action is sent again."""
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
    moves = [m for f in read_recording(file).steps for m in f["moves"] if m["player"] == "robot1"]
    assert len(moves) == 1


@opening(serving)
async def test_chat_and_actions_work_in_a_text_view(server: Server) -> None:
    async with connect(server.url, name="ada", encoding="json") as ada:
        async with connect(server.url, name="bob") as bob:
            created = await ada.create("multi_agent/01")
            one = await ada.join(created.code, view="text")
            two = await bob.join(created.code, view="both")
            two.say("I cook, you cut")
            await received(one, "I cook, you cut")
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


async def received(game: Game, text: str) -> None:
    async for event in game:
        if isinstance(event, ChatReceived):
            assert event.text == text
            return


@virtual
async def test_game_ends_if_the_restarted_server_does_not_have_it(tmp_path: Path) -> None:
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
                assert isinstance(last, GameEnded)
                assert "no episode" in last.reason
                assert not (await pending).applied or game.step == 2
                assert not (await game.act(None)).applied
                assert (await ada.create("synchronous/02")).code


class TalkingPolicy(RandomPolicy):
    """Random policy that sends one message and stores what it receives."""

    anticipating = False

    def __init__(self, player: str) -> None:
        super().__init__(player, 3)
        self.unsaid = [f"hello from {player}"]
        self.kinds: Mapping[str, str] = {}
        self.received: set[str] = set()

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self.kinds = kinds

    def hear(self, player: str, speech: Speech) -> None:
        self.received.add(speech.text)

    def speak(self) -> list[Speech]:
        return [Speech(self.unsaid.pop())] if self.unsaid else []


@virtual
async def test_bots_finish_despite_lost_connections(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, max_steps=60) as server,
        connect(server.url, name="ada") as ada,
        connect(server.url, name="bob") as bob,
    ):
        games = await start(server, ada, bob, clock="realtime")

        async def lose_connections() -> None:
            for client in (ada, bob, ada, bob, bob):
                await asyncio.sleep(0.7)
                cut(client)

        policies = [TalkingPolicy(game.seat or "") for game in games]
        players = [
            play(game, lambda *_, policy=policy: policy, threaded=False)
            for game, policy in zip(games, policies, strict=True)
        ]
        *outcomes, _ = await asyncio.gather(*players, lose_connections())
    assert [outcome["reason"] for outcome in outcomes] == ["step_limit"] * 2
    assert read_recording(next(tmp_path.glob("*.rbt"))).verify().ok
    for policy in policies:
        assert policy.received == {"hello from robot1", "hello from robot2"}
        assert set(policy.kinds) == {"robot1", "robot2"}
