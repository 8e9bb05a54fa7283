"""Spectators of episodes that are on other nodes."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille_client import Client, Game, connect
from robotouille_client.sansio.game_events import ChatReceived
from robotouille_server.auth import Role
from robotouille_server.cluster.service import ClusterService
from robotouille_server.cluster.spectators import relays as relays_module
from robotouille_server.cluster.spectators.mirror import IDLE_SECONDS, Mirror
from robotouille_server.cluster.spectators.packets import Packet, PacketReader
from robotouille_server.cluster.spectators.relays import WATCH_SECONDS, Relay, Relays
from robotouille_server.rooms.lobby import LINGER_SECONDS
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.transport import Peer
from robotouille_server.transport.peer import MAX_UNSENT
from tests.support.buses import SimulatedBus, SimulatedNats
from tests.support.clusters import Node, Nodes, cluster_of
from tests.support.samples import quick_sample
from tests.support.servers import Raw, raw
from tests.support.virtual_time import virtual

HELLO = {"type": "hello", "protocol": 1, "name": "eve"}

TASK = "training/03_multi_agent"


def service(node: Node) -> ClusterService:
    found = node.server.services.cluster
    assert isinstance(found, ClusterService)
    return found


def mirrors(node: Node) -> dict[str, Mirror]:
    return service(node).mirrors.by_episode


def relays(node: Node) -> dict[str, Relay]:
    return service(node).relays._relays


async def step(*games: Game) -> None:
    """Take one step in lockstep, in which nobody does anything."""
    await asyncio.gather(*(game.act(None) for game in games))


async def until(reached: Callable[[], object], seconds: float = 30.0) -> None:
    """Wait until something is true."""
    async with asyncio.timeout(seconds):
        while not reached():
            await asyncio.sleep(0.05)


@dataclass
class Watched:
    """Game of two players on one node of a cluster.

    Attributes:
        owner: The node that has the game.
        others: The other nodes.
    """

    nodes: Nodes
    stack: AsyncExitStack
    games: tuple[Game, Game]
    code: str
    owner: Node
    others: list[Node]

    @property
    def episode(self) -> str:
        return self.games[0].episode

    async def step(self, count: int = 1) -> None:
        for _ in range(count):
            await step(*self.games)

    async def client(self, node: Node, name: str, **options: Any) -> Client:
        return await self.stack.enter_async_context(connect(node.url, name=name, **options))

    async def watch(self, node: Node, name: str = "eve", **options: Any) -> Game:
        client = await self.client(node, name)
        return await client.join(self.code, role="spectator", **options)

    async def follow(self, *spectators: Game) -> None:
        """Wait until spectators have seen all steps."""
        for one in spectators:
            await until(lambda one=one: one.step == self.games[0].step)  # type: ignore[misc]


@asynccontextmanager
async def watched(folder: Path, nodes: int = 3, **options: Any) -> AsyncIterator[Watched]:
    async with cluster_of(folder, nodes, **options) as cluster, AsyncExitStack() as stack:
        clients = [
            await stack.enter_async_context(connect(cluster[0].url, name=name))
            for name in ("ada", "bob")
        ]
        created = await clients[0].create(TASK, seats=2, clock="lockstep", move_budget=0)
        ada, bob = [await client.join(created.code) for client in clients]
        owner = cluster.owner(created.episode)
        yield Watched(cluster, stack, (ada, bob), created.code, owner, cluster.others(owner))


@virtual
async def test_spectators_stay_on_their_node_and_see_every_step(tmp_path: Path) -> None:
    async with watched(tmp_path, max_steps=30) as game:
        first = [await game.watch(node) for node in game.others]
        await game.step(7)
        late = await game.watch(game.others[0], "late")
        await game.follow(*first, late)
        assert [one.state.digest for one in (*first, late)] == [game.games[0].state.digest] * 3
        assert len(relays(game.owner)) == 1
        assert [len(mirrors(node)) for node in game.others] == [1, 1]
        await game.step(23)
        for one in (*first, late):
            await until(lambda one=one: one.ended)  # type: ignore[misc]
            assert one.outcome == game.games[0].outcome
            assert one.state.digest == game.games[0].state.digest


@virtual
async def test_text_views_follow_the_game(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        await game.step(2)
        text = await game.watch(game.others[0], "eve", view="text")
        both = await game.watch(game.others[0], "eva", view="both")
        await game.step(3)
        for one in (text, both):
            await until(lambda one=one: one.step == 5)  # type: ignore[misc]
            shown = one.observation
            assert shown is not None
            assert (shown.step, shown.text) == (5, game.games[0].state.text_view(None))


@virtual
async def test_rosters_count_the_spectators_of_all_nodes(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        here = await game.watch(game.owner, "eve")
        one, two = [await game.watch(node, f"eva {node.bus.name}") for node in game.others]
        everybody = [*game.games, here, one, two]
        await until(lambda: all(each.spectators == 3 for each in everybody))
        assert {here.name, one.name, two.name} == {*game.games[0].spectator_names}
        async with raw(game.others[0].server, name="late") as late:
            join = {"type": "join", "episode": game.code, "role": "spectator"}
            assert (await late.ask(join, "joined"))["type"] == "joined"
            await until(lambda: all(each.spectators == 4 for each in everybody))
        await until(lambda: all(each.spectators == 3 for each in everybody))


@virtual
async def test_names_of_players_are_taken_on_every_node(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        first = await game.watch(game.others[0], "eve")
        await game.follow(first)
        assert (await game.watch(game.others[0], "Ada")).name == "Ada 2"
        assert (await game.watch(game.others[0], "robot1")).name != "robot1"


@virtual
async def test_chat_reaches_everybody_once_and_in_order(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        game.games[0].say("before")
        await asyncio.sleep(0.5)
        spectators = [await game.watch(node) for node in game.others]
        heard: dict[Game, list[str]] = {one: [] for one in (*game.games, *spectators)}
        async with asyncio.TaskGroup() as listeners:
            tasks = [listeners.create_task(listen(one, heard[one])) for one in heard]
            for number, one in enumerate((spectators[0], game.games[0], spectators[1])):
                one.say(str(number))
                await asyncio.sleep(0.5)
            await asyncio.sleep(1)
            for task in tasks:
                task.cancel()
        lines = ["eve: 0", "ada: 1", "eve: 2"]
        assert heard[game.games[1]] in (lines, ["ada: before", *lines])
        assert [heard[one] for one in spectators] == [lines, lines]


async def listen(game: Game, heard: list[str]) -> None:
    while True:
        event = await game.next_event()
        if isinstance(event, ChatReceived):
            heard.append(f"{event.name}: {event.text}")


@virtual
async def test_spectators_may_do_what_the_owner_lets_them(tmp_path: Path) -> None:
    async with watched(tmp_path) as game, raw(game.others[0].server, name="eve") as eve:
        await eve.ask({"type": "join", "episode": game.code, "role": "spectator"}, "roster")

        async def code_of(**message: Any) -> str:
            return str((await eve.ask(message, "rejected"))["code"])

        assert await code_of(type="ready", ready=True) == "seat/none"
        assert await code_of(type="note", topic="thought", text="hm") == "seat/none"
        await eve.send({"type": "act", "seq": 1, "action": None})
        assert (await eve.expect("rejected"))["code"] == "seat/none"
        await eve.send({"type": "resync"})
        assert (await eve.expect("snapshot"))["step"] == 0
        room = game.owner.server.lobby.rooms[game.episode]
        await eve.ask({"type": "say", "text": "hello"}, "said")
        (guest,) = room.guests.values()
        room.mute(guest)
        assert await code_of(type="say", text="again") == "seat/muted"
        room.unmute(guest)
        await eve.ask({"type": "say", "text": "again"}, "said")
        room.kick(guest, "")
        assert (await eve.expect("left"))["episode"] == game.episode
        assert await code_of(type="join", episode=game.code, role="spectator") == "episode/banned"
        room.abort("over")
        async with raw(game.others[0].server, name="eva") as eva:
            answer = await eva.ask(
                {"type": "join", "episode": game.code, "role": "spectator"}, "snapshot"
            )
            assert answer["outcome"]["reason"] == "aborted"


@virtual
async def test_bearers_of_links_keep_their_names_at_all_nodes_if_chat_is_limited(
    tmp_path: Path,
) -> None:
    async with cluster_of(tmp_path, 3) as nodes, raw(nodes[0].server, name="host") as host:
        created = await host.ask({"type": "create", "task": TASK, "chat": "off"}, "created")
        code, owner = created["code"], nodes.owner(created["episode"])
        one, two = nodes.others(owner)
        link = owner.server.tokens.mint_link("p-eve", seconds=3600, code=code, watch=True)
        seen = []
        for name, node in (("eve", one), ("take the", one), ("onion", two), ("now", owner)):
            async with raw(node.server, hello=False) as eve:
                await eve.ask({**HELLO, "name": name, "token": link}, "welcome")
                join = {"type": "join", "episode": code, "role": "spectator"}
                seen.append((await eve.ask(join, "joined"))["name"])
                await eve.ask({"type": "leave"}, "left")
            # The mirror ends in the meantime.
            await asyncio.sleep(2 * IDLE_SECONDS)
        assert seen == ["eve"] * 4


@virtual
async def test_spectators_of_all_nodes_share_the_budget_of_chat(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        codes = []
        for node in game.others:
            async with raw(node.server, name="eve") as eve:
                await eve.ask({"type": "join", "episode": game.code, "role": "spectator"}, "roster")
                for number in range(40):
                    await eve.send({"type": "say", "text": str(number)})
                await asyncio.sleep(0.5)
                codes += [m["code"] for m in await pending(eve) if m["type"] == "error"]
        assert {*codes} == {"rate/chat"}
        assert 80 - len(codes) <= 50 + 2 * 10


async def pending(one: Raw) -> list[dict[str, Any]]:
    """Return the messages that arrive within a moment."""
    got = []
    with suppress(TimeoutError):
        async with asyncio.timeout(0.2):
            while True:
                got.append(await one.receive())
    return got


@virtual
async def test_limits_and_tokens_apply(tmp_path: Path) -> None:
    async with watched(tmp_path, max_spectators=1) as game:
        node = game.others[0]
        await game.watch(node)
        with pytest.raises(ProtocolError) as full:
            await game.watch(node, "eva")
        assert full.value.code == "episode/full"
        await game.watch(game.others[1], "eva")
        mint = node.server.tokens.mint_role
        other = mint(Role.SPECTATOR, "o", seconds=60, episode="0123456789abcdef")
        client = await game.client(game.others[1], "ola", token=other)
        with pytest.raises(ProtocolError) as scope:
            await client.join(game.code, role="spectator")
        assert scope.value.code == "auth/episode"
        client = await game.client(node, "ida", token=mint(Role.SPECTATOR, "ida", seconds=60))
        with pytest.raises(ProtocolError) as wrong:
            await client.join(game.episode, role="spectator")
        assert wrong.value.code == "episode/unknown"


@virtual
async def test_a_token_for_one_session_watches_once(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        mint = game.owner.server.tokens.mint_role
        token = mint(Role.SPECTATOR, "eve", seconds=60, once=True, episode=game.episode)
        client = await game.client(game.others[0], "eve", token=token)
        await client.join(game.code, role="spectator")
        again = await game.client(game.others[1], "eve", token=token)
        with pytest.raises(RobotouilleError, match="another session has used it"):
            await again.join(game.code, role="spectator")


@virtual
async def test_players_are_sent_to_the_owner(tmp_path: Path) -> None:
    async with watched(tmp_path) as game, raw(game.others[0].server, name="eve") as eve:
        answer = await eve.ask({"type": "join", "episode": game.code}, "moved")
        assert answer["url"] == game.owner.url


# Gaps


@virtual
@pytest.mark.parametrize("seed", quick_sample(range(5)))
async def test_lost_messages_lead_to_a_snapshot(
    tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = random.Random(seed)
    publish = SimulatedNats.publish

    def lossy(nats: SimulatedNats, bus: SimulatedBus, subject: str, data: bytes) -> None:
        if chance.random() < 0.6:
            publish(nats, bus, subject, data)

    monkeypatch.setattr(SimulatedNats, "publish", lossy)
    async with watched(tmp_path) as game:
        spectators = [await game.watch(node) for node in game.others]
        heard: dict[Game, list[str]] = {one: [] for one in spectators}
        async with asyncio.TaskGroup() as listeners:
            tasks = [listeners.create_task(listen(one, heard[one])) for one in heard]
            for number in range(20):
                await game.step()
                game.games[number % 2].say(str(number))
                await asyncio.sleep(0.6)
            await game.follow(*spectators)
            await asyncio.sleep(5)
            for task in tasks:
                task.cancel()
        for one in spectators:
            assert one.state.digest == game.games[0].state.digest
            assert sorted(int(line.split()[1]) for line in heard[one]) == [*range(20)]


@pytest.mark.slow
@virtual
async def test_slow_spectator_gets_a_snapshot_and_costs_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with watched(tmp_path, messages_per_second=1e6) as game:
        node = game.others[0]
        slow, quick = await game.watch(node, "slow"), await game.watch(node, "quick")
        await game.step()
        await game.follow(slow, quick)
        mirror = mirrors(node)[game.episode]
        (peer,) = (one.peer for one in mirror._members if one.name == "slow")
        unsent = Peer.unsent.fget
        assert unsent is not None
        full = True
        monkeypatch.setattr(
            Peer,
            "unsent",
            property(lambda one: MAX_UNSENT + 1 if one is peer and full else unsent(one)),
        )
        for _ in range(30):
            await game.step(5)
            await asyncio.sleep(0.11)
        await game.follow(quick)
        assert slow.step == 1
        assert len(mirror._audience._updates) < 20
        full = False
        await game.follow(slow)
        await game.step(3)
        await game.follow(slow, quick)
        assert slow.state.digest == quick.state.digest == game.games[0].state.digest


@virtual
async def test_large_snapshots_are_published_in_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(relays_module, "MAX_PIECE", 1000)
    async with watched(tmp_path) as game:
        eve = await game.watch(game.others[0])
        await game.step(3)
        await game.follow(eve)
        assert eve.state.digest == game.games[0].state.digest


@pytest.mark.slow
@virtual
async def test_many_spectators_cost_the_owner_few_snapshots(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        snapshots = 0
        send = Broadcaster.send_to_relay

        def counted(self: Broadcaster, relay: Session, said: int) -> None:
            nonlocal snapshots
            snapshots += 1
            send(self, relay, said)

        with patch.object(Broadcaster, "send_to_relay", counted):
            spectators = [await game.watch(game.others[0], f"eve {i}") for i in range(30)]
            await game.step(2)
            await game.follow(*spectators)
        assert snapshots <= 3


# Coming back


@virtual
async def test_spectator_comes_back_to_its_node(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        node = game.others[0]
        client = await game.client(node, "eve")
        eve = await client.join(game.code, role="spectator")
        await game.step(2)
        await game.follow(eve)
        mirror = mirrors(node)[game.episode]
        (session,) = mirror._members
        assert session.peer is not None
        session.peer.drop("test")
        game.games[0].say("while away")
        await game.step(3)
        await game.follow(eve)
        heard: list[str] = []
        with suppress(TimeoutError):
            await asyncio.wait_for(listen(eve, heard), 2)
        assert heard == ["ada: while away"]
        assert mirror._members == [session]
        assert eve.state.digest == game.games[0].state.digest


@virtual
async def test_spectators_of_a_killed_node_go_to_another_one(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        gone, other = game.others
        client = await game.client(gone, "eve")
        eve = await client.join(game.code, role="spectator")
        await game.step(2)
        await game.follow(eve)
        token = client.resume
        await gone.kill()
        await game.step(2)
        await game.follow(eve)
        room = game.owner.server.lobby.rooms[game.episode]
        here, there = room.spectators_here, len(mirrors(other))
        assert here + there == 1
        assert eve.state.digest == game.games[0].state.digest
        for node in (game.owner, other):
            async with raw(node.server, hello=False) as thief:
                answer = await thief.ask({**HELLO, "resume": token}, "welcome")
                assert answer["code"] == "auth/expired"


@virtual
async def test_spectators_of_a_node_that_leaves_go_to_another_one(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        gone, other = game.others
        eve = await game.watch(gone)
        await game.step(2)
        await game.follow(eve)
        await gone.leave()
        await game.step(2)
        await game.follow(eve)
        room = game.owner.server.lobby.rooms[game.episode]
        assert room.spectators_here + len(mirrors(other)) == 1
        assert eve.state.digest == game.games[0].state.digest


@virtual
async def test_spectators_get_moved_if_the_owner_cannot_serve_them(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        # A node with an earlier version does not know the request.
        with patch.object(Relays, "watch", side_effect=ProtocolError("server/internal", "what?")):
            async with raw(game.others[0].server, name="eve") as eve:
                join = {"type": "join", "episode": game.code, "role": "spectator"}
                answer = await eve.ask({**join, "ref": 5}, "moved")
        assert (answer["type"], answer["ref"], answer["url"]) == ("moved", 5, game.owner.url)
        await asyncio.sleep(3)
        assert mirrors(game.others[0]) == {}


@virtual
async def test_spectator_who_has_a_seat_now_is_sent_to_the_owner(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        await game.watch(game.others[0])
        room = game.owner.server.lobby.rooms[game.episode]
        seated = room.episode.seats["robot1"].session
        await asyncio.sleep(2)
        found = service(game.others[0]).mirrors
        assert found.of(seated, game.episode) is None
        assert found.of("other", game.episode) is not None


# Takeovers


def peers_of(node: Node, episode: str) -> list[Peer | None]:
    return [session.peer for session in mirrors(node)[episode]._members]


@pytest.mark.slow
@virtual
async def test_spectators_stay_when_another_node_takes_the_game_over(tmp_path: Path) -> None:
    async with watched(tmp_path, 4) as game:
        spectators = [await game.watch(node) for node in game.others]
        await game.step(3)
        await game.follow(*spectators)
        peers = {node.url: peers_of(node, game.episode) for node in game.others}
        await game.owner.kill()
        await game.step(3)
        successor = game.nodes.owner(game.episode)
        await game.follow(*spectators)
        await game.step(2)
        await game.follow(*spectators)
        for one in spectators:
            assert one.state.digest == game.games[0].state.digest
        stayed = [node for node in game.others if node is not successor]
        assert [len(mirrors(node)) for node in stayed] == [1, 1]
        for node in stayed:
            assert peers_of(node, game.episode) == peers[node.url]
        # The spectator of the successor is a spectator of its room now.
        assert mirrors(successor) == {}
        assert successor.server.lobby.rooms[game.episode].spectators_here == 1


@virtual
async def test_spectators_stay_when_the_owner_leaves(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        spectators = [await game.watch(node) for node in game.others]
        await game.step(3)
        await game.owner.leave()
        await game.step(3)
        await game.follow(*spectators)
        for one in spectators:
            assert one.state.digest == game.games[0].state.digest


@pytest.mark.slow
@virtual
async def test_an_owner_that_was_cut_off_is_not_heard(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        spectators = [await game.watch(node) for node in game.others]
        await game.step(3)
        await game.follow(*spectators)
        former = relays(game.owner)[game.episode]
        game.owner.bus.cut()
        await asyncio.sleep(8)
        successor = game.nodes.owner(game.episode)
        assert successor is not game.owner
        await game.step(2)
        game.owner.bus.heal()
        wrong = messages.Said(step=0, number=1, name="ghost", text="boo")
        former.send(wrong)
        former._publish()
        await game.step(2)
        await game.follow(*spectators)
        for one in spectators:
            heard: list[str] = []
            with suppress(TimeoutError):
                await asyncio.wait_for(listen(one, heard), 2)
            assert heard == []
            assert one.state.digest == game.games[0].state.digest


@virtual
async def test_spectators_of_a_node_that_is_cut_off_go_to_another_one(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        node = game.others[0]
        client = await game.client(node, "eve")
        eve = await client.join(game.code, role="spectator")
        await game.step(3)
        node.bus.cut()
        await asyncio.sleep(8)
        assert mirrors(node) == {}
        await game.step(3)
        await game.follow(eve)
        assert eve.state.digest == game.games[0].state.digest


# The end


@pytest.mark.slow
@virtual
async def test_nothing_is_left_behind(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        known = [len(node.server.sessions.by_id) for node in game.others]
        async with AsyncExitStack() as stack:
            for number, node in enumerate(2 * game.others):
                client = await stack.enter_async_context(connect(node.url, name=f"eve {number}"))
                await client.join(game.code, role="spectator")
            await game.step(3)
            assert len(game.nodes.nats._subscriptions) == 2
        room = game.owner.server.lobby.rooms[game.episode]
        await asyncio.sleep(room.grace + IDLE_SECONDS + WATCH_SECONDS + 3)
        assert [mirrors(node) for node in game.others] == [{}, {}]
        assert game.nodes.nats._subscriptions == []
        assert relays(game.owner) == {}
        assert room.spectators == 0
        assert room.broadcaster._audience._places == {}
        assert [len(node.server.sessions.by_id) for node in game.others] == known
        assert not [task for task in asyncio.all_tasks() if "Mirror" in repr(task.get_coro())]


@pytest.mark.slow
@virtual
async def test_spectators_learn_of_the_end_and_are_let_go(tmp_path: Path) -> None:
    async with watched(tmp_path) as game, raw(game.others[0].server, name="eve") as eve:
        await eve.ask({"type": "join", "episode": game.code, "role": "spectator"}, "roster")
        game.owner.server.lobby.rooms[game.episode].abort("over")
        assert (await eve.expect("ended"))["outcome"]["reason"] == "aborted"
        async with asyncio.timeout(2 * LINGER_SECONDS):
            assert (await eve.expect("left"))["reason"] == "the episode has ended"
        await asyncio.sleep(2)
        assert mirrors(game.others[0]) == {}


@virtual
async def test_announcements_reach_spectators_on_all_nodes(tmp_path: Path) -> None:
    async with watched(tmp_path) as game, raw(game.others[0].server, name="eve") as eve:
        await eve.ask({"type": "join", "episode": game.code, "role": "spectator"}, "roster")
        game.owner.server.lobby.rooms[game.episode].announce("lunch")
        assert (await eve.expect("notice"))["text"] == "lunch"


# Packets


def packed(claim: int, number: int, relay: str = "r", piece: int = 0, more: bool = False) -> bytes:
    return Packet(claim, relay, number, piece, more, b"%d/%d" % (claim, number)).pack()


def test_missing_packets_are_noticed() -> None:
    reader = PacketReader()
    assert reader.read(packed(1, 4)) == (True, b"1/4"), "the first one follows others"
    assert reader.read(packed(1, 5)) == (False, b"1/5")
    assert reader.read(packed(1, 5)) == (False, b""), "it was repeated"
    assert reader.read(packed(1, 7)) == (True, b"1/7")
    assert reader.read(packed(1, 6)) == (False, b""), "it is late"
    assert reader.read(packed(1, 1, "s")) == (True, b"1/1"), "another relay"
    reader.announce(1, "s", 1)
    assert not reader.behind
    reader.announce(1, "s", 2)
    assert reader.behind


def test_former_owner_is_not_heard() -> None:
    reader = PacketReader()
    reader.read(packed(5, 1))
    assert reader.owned(9)
    assert not reader.owned(9)
    assert reader.read(packed(5, 2)) == (False, b"")
    assert reader.read(packed(9, 1, "s")) == (True, b"9/1")
    assert reader.read(packed(5, 3)) == (False, b"")
    reader.announce(5, "r", 9)
    assert not reader.behind


def test_pieces_are_put_together() -> None:
    reader = PacketReader()
    assert reader.read(packed(1, 1, more=True)) == (True, b"")
    assert reader.read(packed(1, 2, piece=1)) == (False, b"1/11/2")
    reader.read(packed(1, 3, more=True))
    assert reader.read(packed(1, 5, piece=2)) == (True, b""), "a piece is missing"
    assert reader.read(packed(1, 6)) == (False, b"1/6")
    with pytest.raises(ValueError):
        reader.read(b"\xc1")


def test_pieces_without_an_end_are_not_collected() -> None:
    reader = PacketReader()
    piece = b"x" * 2**20
    with pytest.raises(ValueError, match="a packet of more than"):
        for number in range(100):
            reader.read(Packet(1, "a", number + 1, number, True, piece).pack())
