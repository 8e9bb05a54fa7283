"""Pauses, absence, lost connections and announcements in a window on a real server."""

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
from tests.support.lost_connections import cut
from tests.support.samples import quick_sample
from tests.support.scripted_server import ScriptedServer
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import opening, virtual
from tests.support.window_play import headless_window
from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from robotouille.errors import ProtocolError
from robotouille_client import Client, Game, connect
from robotouille_client.console import explain
from robotouille_client.window.drawing.cards.interruptions import _lost
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures.theme import SEATS, TEXT, Colour, mixed
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.view import Bubble, View
from robotouille_server import Server

NO_SERVER = "ws://127.0.0.1:1"


class Line:
    """Client whose connection can be cut and restored."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self._url = client.url

    def cut(self) -> None:
        self.client.url = NO_SERVER
        cut(self.client)

    async def pull(self) -> None:
        self.cut()
        await asyncio.sleep(0.1)

    async def plug(self) -> None:
        self.client.url = self._url
        await self.client.connected.wait()
        await asyncio.sleep(0.1)


class Table:
    """Ada at a window, and Bob, in one episode."""

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


@opening(table, absence="pause", grace=40.0)
async def test_a_pause_shows_its_reason_and_counts_down(at: Table) -> None:
    assert at.source.view().pause is None
    await at.bob.pull()
    received = at.source.view().pause
    assert received.why == "bob lost the connection"
    assert received.detail == "The game ends in 40 s unless bob comes back."
    await asyncio.sleep(10.0)
    later = at.source.view().pause
    assert received.left is not None
    assert later.left == pytest.approx(received.left - 10.0)
    assert later.share == pytest.approx(later.left / received.left)
    assert later.detail == "The game ends in 30 s unless bob comes back."
    assert at.source.view().frozen
    await at.bob.plug()
    view = at.source.view()
    assert (view.pause, view.frozen, view.status) == (None, False, "")


@opening(table, absence="pause", grace=40.0)
async def test_each_pause_has_its_own_countdown(at: Table) -> None:
    for _ in range(2):
        await at.bob.pull()
        pause = at.source.view().pause
        assert pause.share == pytest.approx(1.0, abs=0.01)
        assert pause.left == pytest.approx(40.0, abs=0.2)
        await at.bob.plug()
        assert at.source.view().pause is None


@opening(table)
async def test_actions_wait_until_the_pause_ends(at: Table) -> None:
    at.room.pause()
    await asyncio.sleep(0.1)
    pause = at.source.view().pause
    assert (pause.why, pause.left) == ("Paused by the operator", None)
    at.source.act(at.one.actions[0])
    await asyncio.sleep(0.1)
    assert at.room.episode.seats["robot1"].seq == 0
    at.source.say("still here?")
    await asyncio.sleep(0.1)
    assert at.source.view().chat == (("·", "bob joined"), ("ada", "still here?"))
    at.room.resume()
    await asyncio.sleep(0.1)
    assert at.source.view().pause is None
    at.source.act(at.one.actions[0])
    await asyncio.sleep(0.1)
    assert at.room.episode.seats["robot1"].seq == 1


@virtual
async def test_seats_show_absence_and_substitutes(tmp_path: Path) -> None:
    async with table(tmp_path / "bot", absence="bot", substitute="random") as at:
        assert [seat.moved_by for seat in at.source.view().seats] == ["person", "person"]
        await at.bob.pull()
        ada, bob = at.source.view().seats
        assert (ada.moved_by, bob.moved_by) == ("person", "random plays for bob")
        assert bob.plate == "random for bob"
        await at.bob.plug()
        assert at.source.view().seats[1].moved_by == "person"
        at.room.members[0].latency_ms = 250
        at.room.broadcaster.publish_roster()
        await asyncio.sleep(0.1)
        assert [seat.latency_ms for seat in at.source.view().seats] == [250, 0]
    async with table(tmp_path / "wait", absence="wait", grace=5.0) as at:
        await at.bob.pull()
        assert at.source.view().seats[1].moved_by == "connection lost"
        assert at.source.view().seats[1].plate == "bob · away"
        await asyncio.sleep(6.0)
        assert at.source.view().seats[1].moved_by == "free"


@opening(table, clock="realtime")
async def test_a_lost_connection_is_shown_until_it_returns(at: Table) -> None:
    assert at.source.view().offline is None
    await at.ada.pull()
    assert at.source.view().offline is not None
    await asyncio.sleep(8.0)
    view = at.source.view()
    assert view.offline == pytest.approx(8.0)
    assert view.frozen
    assert view.status == "Connection lost"
    at.source.act(at.one.actions[0])
    await at.ada.plug()
    view = at.source.view()
    assert (view.offline, view.farewell, view.frozen) == (None, None, False)
    assert at.room.episode.seats["robot1"].seq == 0, "a click without a connection is void"
    assert view.step == at.room.episode.step > 30


@virtual
async def test_a_server_restart_is_shown_until_the_others_return(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        port = server.port
        async with connect(server.url, name="ada") as ada, connect(server.url, name="bob") as bob:
            created = await ada.create("multi_agent/02")
            one, _ = await ada.join(created.code), await bob.join(created.code)
            source = RemoteSource(one, asyncio.get_running_loop().time, ada.connected.is_set)
            line = Line(bob)
            line.cut()
            await crash(server)
            await asyncio.sleep(0.1)
            assert source.view().offline is not None
            async with serving(tmp_path, port=port, seed=2):
                await ada.connected.wait()
                await asyncio.sleep(0.1)
                view = source.view()
                assert view.offline is None
                assert view.pause.why == "The server restarted"
                assert view.pause.detail.endswith("s for bob.")
                await line.plug()
                assert source.view().pause is None


@opening(table)
async def test_announcements_are_shown_and_stay_in_the_chat(at: Table) -> None:
    at.server.announce("lunch at noon")
    await asyncio.sleep(0.1)
    view = at.source.view()
    assert view.notice == "lunch at noon"
    assert view.chat == (("·", "bob joined"), ("", "lunch at noon"))
    await asyncio.sleep(4.0)
    assert at.source.view().notice == "lunch at noon"
    await asyncio.sleep(10.0)
    view = at.source.view()
    assert view.notice == ""
    assert view.chat == (("·", "bob joined"), ("", "lunch at noon"))


async def stays_open(source: RemoteSource) -> None:
    """Check that a window on this source keeps running."""
    loop = asyncio.get_running_loop()
    window = headless_window((320, 240), fps=20, clock=loop.time)
    showing = asyncio.create_task(window.run(source, linger=None))
    await asyncio.sleep(10.0)
    assert not showing.done()
    assert window.frames > 100
    showing.cancel()
    with pytest.raises(asyncio.CancelledError):
        await showing


@opening(table)
async def test_a_seat_taken_over_by_another_window(at: Table) -> None:
    resume = at.ada.client.resume
    async with raw(at.server, hello=False) as other:
        hello = {"type": "hello", "protocol": 1, "name": "ada", "resume": resume}
        assert (await other.ask(hello, "welcome"))["resumed"]
        await asyncio.sleep(0.1)
        farewell = at.source.view().farewell
        assert "another window" in farewell.title or "elsewhere" in farewell.text
        assert at.source.view().offline is None
        assert at.source.finished
        await stays_open(at.source)


@opening(table)
async def test_a_removed_participant_sees_the_reason(at: Table) -> None:
    session = next(s for s in at.room.members if s.name == "ada")
    at.room.kick(session, "removed by the operator")
    await asyncio.sleep(0.1)
    farewell = at.source.view().farewell
    assert farewell.text == "Removed by the operator."
    await stays_open(at.source)


@opening(table)
async def test_a_stopping_server_leaves_the_outcome(at: Table) -> None:
    await at.server.stop("maintenance")
    await asyncio.sleep(3.0)
    view = at.source.view()
    assert view.outcome == "Stopped after 0 steps: maintenance"
    assert (view.offline, view.farewell) == (None, None)
    await stays_open(at.source)


@opening(table)
async def test_the_window_survives_minutes_without_a_server(at: Table) -> None:
    await at.ada.pull()
    await asyncio.sleep(300.0)
    await stays_open(at.source)
    assert at.source.view().farewell is None
    assert not at.source.finished


@opening(table)
async def test_the_awaited_player_is_shown_in_the_seat_colour(at: Table) -> None:
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
    await at.ada.pull()
    assert at.source.view().waits_for == ()


@opening(table)
async def test_a_wait_does_not_move_the_panel(at: Table) -> None:
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


def _words_above_the_goal(view: View) -> frozenset[tuple[int, ...]]:
    """Return the colours above the goal in a picture."""
    surface = pygame.Surface((1280, 720))
    Painter().paint(surface, view)
    return frozenset(
        tuple(surface.get_at((x, y)))[:3] for x in range(990, 1280) for y in range(50, 72)
    )


@opening(table)
async def test_a_returning_player_sees_the_recent_chat(play: Table) -> None:
    """A new window takes over the seat of one that was closed."""
    play.one.say("I take the stove")
    await asyncio.sleep(0.1)
    play.two.say("Fine")
    await asyncio.sleep(0.1)
    options = {"name": "ada", "kind": "human", "resume": play.ada.client.resume}
    async with connect(play.server.url, **options) as returned:
        game = await returned.join(play.one.code)
        source = RemoteSource(game, asyncio.get_running_loop().time, returned.connected.is_set)
        await asyncio.sleep(0.1)
        view = source.view()
        spoken = [text for name, text in view.chat if name in ("ada", "bob")]
        assert spoken == ["I take the stove", "Fine"]
        assert view.bubbles == ()
        play.two.say("Welcome back")
        await asyncio.sleep(0.1)
        assert source.view().chat[-1] == ("bob", "Welcome back")


def _nearest(colours: frozenset[tuple[int, ...]], wanted: Colour) -> int:
    """Return the distance of a colour to the most similar one."""
    return min(max(abs(a - b) for a, b in zip(c, wanted, strict=True)) for c in colours)


@asynccontextmanager
async def left_alone(folder: Path) -> AsyncIterator[tuple[RemoteSource, Client, int]]:
    """Return Ada's window after her server was killed, and its port."""
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


Left = tuple[RemoteSource, Client, int]


@opening(left_alone)
async def test_without_a_server_the_window_shows_the_options(left: Left) -> None:
    source, *_ = left
    view = source.view()
    assert view.farewell is None
    assert _lost(view.offline or 0.0) == (
        "Connection lost — trying again (25 s). You can wait or press Esc to leave"
    )
    await stays_open(source)


@virtual
async def test_a_server_without_the_game(tmp_path: Path) -> None:
    async with (
        left_alone(tmp_path / "one") as (source, ada, port),
        serving(tmp_path / "other", port=port, seed=9),
    ):
        await ada.connected.wait()
        await asyncio.sleep(1.0)
        assert source.view().farewell.title == "The server no longer has this game"
        assert source.finished
        await stays_open(source)


@asynccontextmanager
async def answering(answer: bytes, port: int = 0) -> AsyncIterator[int]:
    """Serve a server that answers every message in the same way; yield its port."""

    async def handle(socket: ServerConnection) -> None:
        async for _ in socket:
            await socket.send(answer)

    names = [Subprotocol("robotouille.v1.msgpack")]
    async with serve(handle, "127.0.0.1", port, subprotocols=names) as server:
        yield next(iter(server.sockets)).getsockname()[1]


VERSION = {"type": "error", "code": "protocol/version", "message": "I speak 9"}


@virtual
async def test_another_version_at_the_start() -> None:
    async with answering(msgpack.packb(VERSION)) as port:
        with pytest.raises(ProtocolError) as refused:
            async with connect(f"ws://127.0.0.1:{port}", name="ada", kind="human"):
                pass
        assert "has an incompatible version (I speak 9)" in explain(refused.value)


@pytest.mark.parametrize(
    ("answer", "title"),
    quick_sample(
        [
            (msgpack.packb(VERSION), "The server has a different version"),
            (b"\xc1", "Can't understand the server"),
            (
                msgpack.packb({"type": "error", "code": "auth/required", "message": "a token"}),
                "The server no longer accepts your token",
            ),
            (msgpack.packb({"type": "welcome", "protocol": "nine"}), "Can't understand the server"),
        ],
        2,
    ),
)
@opening(left_alone)
async def test_another_kind_of_server(left: Left, answer: bytes, title: str) -> None:
    source, ada, port = left
    async with answering(answer, port):
        await asyncio.sleep(12.0)
        assert source.view().farewell.title == title
        assert ada.farewell
        await stays_open(source)


@pytest.mark.parametrize(
    "fields",
    [
        {"clock": {"clock": "realtime"}},
        {"clock": {"clock": "realtime", "max_steps": 10**400}},
        {"clock": {"clock": "realtime", "step_rate": 1e308}},
        {"outcome": {}},
        {"outcome": {"reason": "goal"}},
        {"outcome": {"steps": -4, "seats": [{}]}},
    ],
)
def test_any_state_of_a_server_is_shown(fields: dict[str, Any]) -> None:
    server = ScriptedServer()
    game = Game(server.joined(), lambda: None)
    game.receive(server.snapshot(**fields), 0.0)
    game.receive(server.delta(), 0.1)
    source = RemoteSource(game, lambda: 1.0)
    Painter().paint(pygame.Surface((320, 240)), source.view())
    assert source.view().step == 1


def test_an_empty_reason_has_a_default_text() -> None:
    assert Bubble.rejection("robot1", "").text == "You cannot do that now."
