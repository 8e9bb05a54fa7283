"""What somebody at a window learns of pauses, absent players, lost connections and the operator.

A real server, real connections, in virtual time.
"""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgpack
import pygame
import pytest
from tests.support.scripted_server import ScriptedServer
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import run
from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from robotouille.errors import ProtocolError
from robotouille_client import Client, Game, connect
from robotouille_client.console import explain
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.window.drawing.interruptions import _lost
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures.theme import SEATS, TEXT, Colour, mixed
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.view import Bubble, View
from robotouille_client.window.window import Window
from robotouille_server import Server


class Line:
    """A client whose cable can be pulled, and plugged in again."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self._connect = client._connect

    def pull(self) -> None:
        async def no_way() -> Any:
            raise ConnectionFailedError("the cable is out")

        self.client._connect = no_way  # type: ignore[method-assign]
        assert self.client._socket is not None
        self.client._socket.transport.abort()

    def plug(self) -> None:
        self.client._connect = self._connect  # type: ignore[method-assign]


class Table:
    """Ada at a window, and bob, in an episode of their own."""

    def __init__(self, server: Server, ada: Client, bob: Client, one: Game, two: Game) -> None:
        self.server = server
        self.ada, self.bob = Line(ada), Line(bob)
        self.one, self.two = one, two
        loop = asyncio.get_running_loop()
        self.source = RemoteSource(one, loop.time, ada.connected.is_set)
        self.room = server.lobby.find(one.code)


@asynccontextmanager
async def table(folder: Path, **options: Any) -> AsyncIterator[Table]:
    async with serving(folder) as server:
        async with connect(server.url, name="ada", kind="human") as ada:
            async with connect(server.url, name="bob", kind="human") as bob:
                created = await ada.create("multi_agent/02", **options)
                one, two = await ada.join(created.code), await bob.join(created.code)
                await asyncio.sleep(0.1)
                yield Table(server, ada, bob, one, two)


def test_a_pause_says_why_and_counts_down_without_messages(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, absence="pause", grace=40.0) as at:
            assert at.source.view().pause is None
            at.bob.pull()
            await asyncio.sleep(0.1)
            heard = at.source.view().pause
            assert heard is not None
            assert heard.why == "bob's connection is lost"
            assert heard.detail == "Waiting 40 s, then the game ends."
            await asyncio.sleep(10.0)
            later = at.source.view().pause
            assert later is not None
            assert heard.left is not None
            assert later.left == pytest.approx(heard.left - 10.0)
            assert later.share == pytest.approx(later.left / heard.left)
            assert later.detail == "Waiting 30 s, then the game ends."
            assert at.source.view().frozen
            at.bob.plug()
            await at.bob.client.connected.wait()
            await asyncio.sleep(0.1)
            view = at.source.view()
            assert (view.pause, view.frozen, view.status) == (None, False, "")

    run(main())


def test_a_second_pause_has_a_countdown_of_its_own(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, absence="pause", grace=40.0) as at:
            for _ in range(2):
                at.bob.pull()
                await asyncio.sleep(0.1)
                pause = at.source.view().pause
                assert pause is not None
                assert pause.share == pytest.approx(1.0, abs=0.01)
                assert pause.left == pytest.approx(40.0, abs=0.2)
                at.bob.plug()
                await at.bob.client.connected.wait()
                await asyncio.sleep(0.1)
                assert at.source.view().pause is None

    run(main())


def test_while_it_is_paused_nothing_is_sent_and_afterwards_it_is(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            at.room.pause()
            await asyncio.sleep(0.1)
            pause = at.source.view().pause
            assert pause is not None
            assert (pause.why, pause.left) == ("Paused by the operator", None)
            at.source.act(at.one.actions[0])
            await asyncio.sleep(0.1)
            assert at.room.episode.seats["robot1"].seq == 0
            at.source.say("still here?")
            await asyncio.sleep(0.1)
            assert at.source.view().chat == (("·", "bob joins"), ("ada", "still here?"))
            at.room.resume()
            await asyncio.sleep(0.1)
            assert at.source.view().pause is None
            at.source.act(at.one.actions[0])
            await asyncio.sleep(0.1)
            assert at.room.episode.seats["robot1"].seq == 1

    run(main())


def test_seats_show_who_is_there_who_is_away_and_who_stands_in(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path / "bot", absence="bot", stand_in="random") as at:
            assert [seat.moved_by for seat in at.source.view().seats] == ["human", "human"]
            at.bob.pull()
            await asyncio.sleep(0.1)
            ada, bob = at.source.view().seats
            assert (ada.moved_by, bob.moved_by) == ("human", "random plays for bob")
            assert bob.plate == "random for bob"
            at.bob.plug()
            await at.bob.client.connected.wait()
            await asyncio.sleep(0.1)
            assert at.source.view().seats[1].moved_by == "human"
            at.room.members[0].latency_ms = 250
            at.room.broadcaster.publish_roster()
            await asyncio.sleep(0.1)
            assert [seat.latency_ms for seat in at.source.view().seats] == [250, 0]
        async with table(tmp_path / "wait", absence="wait", grace=5.0) as at:
            at.bob.pull()
            await asyncio.sleep(0.1)
            assert at.source.view().seats[1].moved_by == "connection lost"
            assert at.source.view().seats[1].plate == "bob · away"
            await asyncio.sleep(6.0)
            assert at.source.view().seats[1].moved_by == "free"

    run(main())


def test_a_lost_connection_is_told_until_it_is_back(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path, clock="realtime") as at:
            assert at.source.view().offline is None
            at.ada.pull()
            await asyncio.sleep(0.1)
            assert at.source.view().offline is not None
            await asyncio.sleep(8.0)
            view = at.source.view()
            assert view.offline == pytest.approx(8.0)
            assert view.frozen
            assert view.status == "Connection lost"
            at.source.act(at.one.actions[0])
            at.ada.plug()
            await at.ada.client.connected.wait()
            await asyncio.sleep(0.5)
            view = at.source.view()
            assert (view.offline, view.farewell, view.frozen) == (None, None, False)
            assert at.room.episode.seats["robot1"].seq == 0, "a click without a connection is void"
            assert view.step == at.room.episode.step > 30

    run(main())


def test_a_restart_of_the_server_is_told_until_the_others_are_back(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            port = server.port
            async with (
                connect(server.url, name="ada") as ada,
                connect(server.url, name="bob") as bob,
            ):
                created = await ada.create("multi_agent/02")
                one, _ = await ada.join(created.code), await bob.join(created.code)
                source = RemoteSource(one, asyncio.get_running_loop().time, ada.connected.is_set)
                line = Line(bob)
                line.pull()
                await crash(server)
                await asyncio.sleep(0.1)
                assert source.view().offline is not None
                async with serving(tmp_path, port=port, seed=2):
                    await ada.connected.wait()
                    await asyncio.sleep(0.1)
                    view = source.view()
                    assert view.offline is None
                    assert view.pause is not None
                    assert view.pause.why == "The server was restarted"
                    assert view.pause.detail.endswith("s for bob.")
                    line.plug()
                    await bob.connected.wait()
                    await asyncio.sleep(0.1)
                    assert source.view().pause is None

    run(main())


def test_the_operators_words_are_seen_for_a_while_and_stay_in_the_chat(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            at.server.announce("lunch at noon")
            await asyncio.sleep(0.1)
            view = at.source.view()
            assert view.notice == "lunch at noon"
            assert view.chat == (("·", "bob joins"), ("", "lunch at noon"))
            await asyncio.sleep(4.0)
            assert at.source.view().notice == "lunch at noon"
            await asyncio.sleep(10.0)
            view = at.source.view()
            assert view.notice == ""
            assert view.chat == (("·", "bob joins"), ("", "lunch at noon"))

    run(main())


async def stays_open(source: RemoteSource) -> None:
    """A window on this source draws on, whatever has become of the connection."""
    loop = asyncio.get_running_loop()
    window = Window((320, 240), headless=True, fps=20, clock=loop.time)
    showing = asyncio.create_task(window.run(source, linger=None))
    await asyncio.sleep(10.0)
    assert not showing.done()
    assert window.frames > 100
    showing.cancel()
    with pytest.raises(asyncio.CancelledError):
        await showing


def test_a_seat_that_is_played_from_elsewhere_says_so(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            resume = at.ada.client.resume
            async with raw(at.server, hello=False) as other:
                hello = {"type": "hello", "protocol": 1, "name": "ada", "resume": resume}
                assert (await other.ask(hello, "welcome"))["resumed"]
                await asyncio.sleep(0.1)
                farewell = at.source.view().farewell
                assert farewell is not None
                assert "another window" in farewell.title or "elsewhere" in farewell.text
                assert at.source.view().offline is None
                assert at.source.finished
                await stays_open(at.source)

    run(main())


def test_who_is_sent_out_learns_why(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            session = next(s for s in at.room.members if s.name == "ada")
            at.room.kick(session, "removed by the operator")
            await asyncio.sleep(0.1)
            farewell = at.source.view().farewell
            assert farewell is not None
            assert farewell.text == "Removed by the operator."
            await stays_open(at.source)

    run(main())


def test_a_server_that_stops_leaves_the_outcome_on_the_screen(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            await at.server.stop("maintenance")
            await asyncio.sleep(3.0)
            view = at.source.view()
            assert view.outcome == "Stopped after 0 steps: maintenance"
            assert (view.offline, view.farewell) == (None, None)
            await stays_open(at.source)

    run(main())


def test_a_window_survives_a_server_that_is_away_for_minutes(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            at.ada.pull()
            await asyncio.sleep(300.0)
            await stays_open(at.source)
            assert at.source.view().farewell is None
            assert not at.source.finished

    run(main())


def test_a_window_shows_for_whom_it_waits_in_the_seats_colour(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            assert at.source.view().waits_for == ()
            at.one.submit(None)
            await asyncio.sleep(3.0)
            view = at.source.view()
            assert view.waits_for == ("robot2",)
            shown = _words_above_the_goal(view)
            idle = _words_above_the_goal(dataclasses.replace(view, waits_for=()))
            blue = mixed(SEATS[1], TEXT, 0.3)
            assert _nearest(shown, blue) < 20 < _nearest(idle, blue)
            at.two.submit(None)
            await asyncio.sleep(0.1)
            assert at.source.view().waits_for == ()
            await asyncio.sleep(3.0)
            assert at.source.view().waits_for == ("robot1", "robot2")
            at.ada.pull()
            await asyncio.sleep(0.1)
            assert at.source.view().waits_for == ()

    run(main())


def test_a_wait_that_comes_and_goes_moves_nothing_else(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            view = at.source.view()
            pictures = []
            for waits_for in ((), ("robot2",)):
                surface = pygame.Surface((900, 600))
                Painter().paint(surface, dataclasses.replace(view, waits_for=waits_for))
                below = surface.subsurface((720, 100, 180, 500))
                rows = pygame.image.tobytes(below, "RGB")
                pictures.append([rows[at : at + 540] for at in range(0, len(rows), 540)])
            other = [y for y, (one, two) in enumerate(zip(*pictures, strict=True)) if one != two]
            line = Painter().layout((900, 600), view.world).text * 2
            assert other, "its card says so"
            assert other[-1] - other[0] < line, "and nothing else has moved"

    run(main())


def _words_above_the_goal(view: View) -> frozenset[tuple[int, ...]]:
    """The colours of a picture there."""
    surface = pygame.Surface((1280, 720))
    Painter().paint(surface, view)
    return frozenset(
        tuple(surface.get_at((x, y)))[:3] for x in range(990, 1280) for y in range(50, 72)
    )


def _nearest(colours: frozenset[tuple[int, ...]], wanted: Colour) -> int:
    """How far the most similar of some colours is from one."""
    return min(max(abs(a - b) for a, b in zip(c, wanted, strict=True)) for c in colours)


class TestAnotherServer:
    """The server has gone, and what is there now is not what it was."""

    @staticmethod
    @asynccontextmanager
    async def left_alone(folder: Path) -> AsyncIterator[tuple[RemoteSource, Client, int]]:
        """Ada's window after her server was killed, and its port."""
        async with serving(folder) as server:
            port = server.port
            async with connect(server.url, name="ada", kind="human") as ada:
                created = await ada.create("synchronous/01")
                game = await ada.join(created.code)
                source = RemoteSource(game, asyncio.get_running_loop().time, ada.connected.is_set)
                await crash(server)
                await asyncio.sleep(0.1)
                source.view()
                await asyncio.sleep(25.5)
                yield source, ada, port

    def test_while_nothing_is_there_one_is_told_the_ways_on(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with self.left_alone(tmp_path) as (source, _, _):
                view = source.view()
                assert view.farewell is None
                assert _lost(view.offline or 0.0) == (
                    "Connection lost — trying again (25 s). You can wait, or leave with Esc"
                )
                await stays_open(source)

        run(main())

    def test_one_that_knows_nothing_of_the_game(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with self.left_alone(tmp_path / "one") as (source, ada, port):
                async with serving(tmp_path / "other", port=port, seed=9):
                    await ada.connected.wait()
                    await asyncio.sleep(1.0)
                    farewell = source.view().farewell
                    assert farewell is not None
                    assert farewell.title == "The server does not know this game any more"
                    assert source.finished
                    await stays_open(source)

        run(main())

    def test_one_of_another_version_at_the_very_start(self) -> None:
        async def main() -> None:
            async def handle(socket: ServerConnection) -> None:
                async for _ in socket:
                    error = {"type": "error", "code": "protocol/version", "message": "I speak 9"}
                    await socket.send(msgpack.packb(error))

            names = [Subprotocol("robotouille.v1.msgpack")]
            async with serve(handle, "127.0.0.1", 0, subprotocols=names) as server:
                port = next(iter(server.sockets)).getsockname()[1]
                with pytest.raises(ProtocolError) as refused:
                    async with connect(f"ws://127.0.0.1:{port}", name="ada", kind="human"):
                        pass
                assert "is of another version (I speak 9)" in explain(refused.value)

        run(main())

    @pytest.mark.parametrize(
        ("answer", "title"),
        [
            (
                {"type": "error", "code": "protocol/version", "message": "version 1; I speak 9"},
                "The server is of another version",
            ),
            (
                {"type": "error", "code": "auth/required", "message": "a token"},
                "The server does not let you in any more",
            ),
            ({"type": "welcome", "protocol": "nine"}, "What the server sends cannot be read"),
            ("rubbish", "What the server sends cannot be read"),
        ],
    )
    def test_one_of_another_kind(self, tmp_path: Path, answer: object, title: str) -> None:
        async def main() -> None:
            async with self.left_alone(tmp_path) as (source, ada, port):

                async def handle(socket: ServerConnection) -> None:
                    async for _ in socket:
                        plain = msgpack.packb(answer) if isinstance(answer, dict) else b"\xc1"
                        await socket.send(plain)

                names = [Subprotocol("robotouille.v1.msgpack")]
                async with serve(handle, "127.0.0.1", port, subprotocols=names):
                    await asyncio.sleep(12.0)
                    farewell = source.view().farewell
                    assert farewell is not None
                    assert farewell.title == title
                    assert ada.farewell
                    await stays_open(source)

        run(main())


@pytest.mark.parametrize(
    "fields",
    [
        {"clock": {"clock": "realtime"}},
        {"clock": {"clock": "realtime", "step_rate": 0.0}},
        {"clock": {"clock": "realtime", "step_rate": -1.0, "max_steps": 10**400}},
        {"clock": {"clock": "realtime", "step_rate": 5e-324}},
        {"clock": {"clock": "realtime", "step_rate": 1e308}},
        {"outcome": {}},
        {"outcome": {"reason": "goal"}},
        {"outcome": {"steps": -4, "seats": [{}]}},
    ],
)
def test_whatever_a_server_tells_of_a_game_is_shown(fields: dict[str, Any]) -> None:
    server = ScriptedServer()
    game = Game(server.joined(), lambda: None)
    game.receive(server.snapshot(**fields), 0.0)
    game.receive(server.delta(), 0.1)
    source = RemoteSource(game, lambda: 1.0)
    Painter().paint(pygame.Surface((320, 240)), source.view())
    assert source.view().step == 1


def test_a_reason_without_words_is_told_in_others() -> None:
    assert Bubble.rejection("robot1", "").text == "This cannot be done now."
