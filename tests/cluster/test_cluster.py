"""Several nodes, as their clients see them."""

from __future__ import annotations

import asyncio
import json
import random
from collections import Counter
from collections.abc import Callable
from contextlib import AsyncExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from robotouille.episode.clocks import MAX_CATCH_UP, MAX_LATE_AT_ONCE
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.replay.recording import read_recording
from robotouille_client import Client, Game, connect
from robotouille_server.auth.roles import Role
from robotouille_server.auth.visitors import WRONG_CODES_A_MINUTE
from robotouille_server.cli import _first_of_cluster
from robotouille_server.cluster.bus import Bucket, Entry, Stored, UnavailableError
from robotouille_server.cluster.episodes.claims import Claims
from robotouille_server.cluster.episodes.directory import EpisodeRecord
from robotouille_server.cluster.episodes.handing_over import Offer
from robotouille_server.cluster.episodes.journal import ReplicatedJournal
from robotouille_server.cluster.service import ClusterService
from robotouille_server.requests import Opening
from robotouille_server.rooms.episode_driver import TICKS_WHILE_WRITING
from robotouille_server.rooms.recording import journal
from robotouille_server.runtime.work_in_turns import FRAMES_A_TURN
from tests.support.buses import Handler, SimulatedBus, SimulatedNats
from tests.support.clusters import Nodes, cluster_of, cluster_on
from tests.support.frames_in_turns import count_frames
from tests.support.handshakes import FORWARDED, hello, opened
from tests.support.samples import quick_sample
from tests.support.virtual_time import stand_still, virtual

TASK = "training/03_multi_agent"
FOREIGN_FILES = ["catalogue.sqlite", "old.rbt.part", "../x.rbt.part", "{other}"]


async def step(*games: Game) -> None:
    """Take one step in lockstep, in which nobody does anything."""
    await asyncio.gather(*(game.act(None) for game in games))


async def until(game: Game, reached: int) -> None:
    while game.step < reached and not game.ended:
        await game.next_event()


async def two_players(nodes: Nodes, ada: Client, bob: Client) -> tuple[Game, Game]:
    created = await ada.create(TASK, seats=2, move_budget=0)
    return await ada.join(created.code), await bob.join(created.code)


class TestStart:
    @pytest.mark.parametrize("after", [0.0, 0.005, 0.01, 0.02])
    @virtual
    async def test_a_node_waits_until_nats_has_a_quorum(self, tmp_path: Path, after: float) -> None:
        nats, loop = SimulatedNats(random.Random(1)), asyncio.get_running_loop()
        loop.call_later(after, nats.lose_quorum)
        loop.call_later(15.0, nats.regain_quorum)
        async with cluster_on(nats, tmp_path, 2) as nodes, connect(nodes[0].url, name="ada") as ada:
            assert loop.time() >= 15.0
            assert (await ada.create(TASK)).episode

    @virtual
    async def test_a_node_that_waits_in_vain_says_why(self, tmp_path: Path) -> None:
        nats = SimulatedNats(random.Random(1))
        nats.lose_quorum()
        with pytest.raises(RobotouilleError, match="--cluster: NATS does not answer"):
            async with cluster_on(nats, tmp_path, 1):
                pass

    @virtual
    async def test_a_node_answers_the_others_from_its_first_report_on(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        answer = SimulatedBus.answer

        async def late(bus: SimulatedBus, subject: str, handler: Handler) -> None:
            await asyncio.sleep(1.0)
            await answer(bus, subject, handler)

        monkeypatch.setattr(SimulatedBus, "answer", late)
        nats, asked = SimulatedNats(random.Random(1)), dict[str, asyncio.Task[bytes]]()
        bus = nats.bus("observer")

        def reported(name: str, entry: Entry | None) -> None:
            if entry is not None and name not in asked:
                asked[name] = asyncio.create_task(bus.request(f"node.{name}.list", b"", 5.0))

        await bus.watch(Bucket.NODES, reported)
        async with cluster_on(nats, tmp_path, 2):
            await asyncio.sleep(5)
            answers = [await task for task in asked.values()]
            assert len(answers) == 2
            assert all(b"cannot read this request" in answer for answer in answers)

    @virtual
    async def test_a_server_starts_although_another_node_does_not_answer(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path, 2) as nodes:
            await asyncio.sleep(2)
            silent, starting = sorted(nodes, key=lambda node: str(node.cluster.node.name))
            silent.bus.cut()
            service = starting.server.services.cluster
            assert isinstance(service, ClusterService)
            assert await _first_of_cluster(service) is None


class TestAnyNode:
    @virtual
    async def test_episodes_open_although_the_other_nodes_have_just_died(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            for node in nodes.others(nodes[0]):
                node.bus.close()
                await node.kill()
            opened = {(await ada.create(TASK)).episode for _ in range(4)}
            assert opened <= nodes[0].rooms

    @virtual
    async def test_a_node_that_is_cut_off_opens_no_episode_that_nobody_has(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes:
            lobby, node = nodes[0].server.lobby, nodes[0].cluster.node
            nodes[0].bus.cut()
            opening: list[asyncio.Task[None]] = []
            while not node.cut_off:
                room = lobby.create(messages.Create(task=TASK))
                opening.append(asyncio.create_task(node.registered(room.id)))
                await asyncio.sleep(0.25)
            nodes[0].bus.heal()
            results = await asyncio.gather(*opening, return_exceptions=True)
            assert results
            assert {type(result) for result in results} == {UnavailableError}

    @virtual
    async def test_new_episodes_are_divided_among_the_nodes(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            for _ in range(6):
                await ada.create(TASK)
            assert [len(node.rooms) for node in nodes] == [2, 2, 2]

    @virtual
    async def test_a_code_works_on_every_node(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK, seats=3)
            for node in nodes:
                client = Client(node.url, name="bob")
                async with client:
                    game = await client.join(created.code)
                    assert game.episode == created.episode

    @virtual
    async def test_a_wrong_code_is_unknown_on_every_node(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes:
            for node in nodes:
                async with connect(node.url, name="ada") as ada:
                    with pytest.raises(ProtocolError) as error:
                        await ada.join("ABCDE-FGHJK")
                    assert error.value.code == "episode/unknown"

    @virtual
    async def test_a_list_has_the_episodes_of_all_nodes(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[2].url, name="ada") as ada:
            opened = {(await ada.create(TASK)).episode for _ in range(4)}
            assert {one.episode for one in await ada.episodes()} == opened

    @virtual
    async def test_an_operator_closes_an_episode_of_another_node(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK)
            elsewhere = nodes.others(nodes.owner(created.episode))[0]
            token = elsewhere.server.tokens.mint_role(Role.OPERATOR, "olga", seconds=60)
            async with connect(elsewhere.url, name="olga", token=token) as olga:
                closed = await olga.close_episode(created.code)
            assert closed.episode == created.episode
            assert not any(created.episode in node.rooms for node in nodes)

    @virtual
    async def test_closing_an_ended_episode_has_the_same_answer_on_every_node(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK, seats=2)
            await ada.join(created.code)
            await ada.close_episode(created.code)
            await asyncio.sleep(5)
            record = nodes[0].cluster.node.directory.find(created.episode)
            assert record is not None and record.ended
            for node in nodes:
                async with connect(node.url, name="bob") as bob:
                    assert (await bob.close_episode(created.code)).episode == created.episode

    @virtual
    async def test_node_asked_to_close_what_it_has_handed_over_says_so(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path, 2) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK)
            (former,) = nodes.others(nodes.owner(created.episode))
            closing = {"episode": created.episode, "reason": "", "owner": "", "operator": True}
            asked, data = f"node.{former.cluster.node.name}.close", json.dumps(closing).encode()
            answer = json.loads(await nodes.nats.bus("observer").request(asked, data, 5.0))
            assert answer["error"]["code"] == "server/handover"

    @virtual
    async def test_limits_of_an_owner_count_all_nodes(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path, max_episodes_per_owner=4) as nodes:
            token = nodes[0].server.tokens.mint_role(Role.HOST, "hanna", seconds=60)
            async with connect(nodes[0].url, name="hanna", token=token) as hanna:
                for _ in range(4):
                    await hanna.create(TASK)
                with pytest.raises(ProtocolError) as error:
                    await hanna.create(TASK)
            assert error.value.code == "rate/episodes"

    @virtual
    async def test_a_reserved_episode_counts_as_running_once_somebody_joins(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path, max_episodes_per_owner=1) as nodes:
            token = nodes[0].server.tokens.mint_role(Role.HOST, "hanna", seconds=600)
            async with connect(nodes[0].url, name="hanna", token=token) as hanna:
                reserved = await hanna.create(TASK, open_for=300)
                async with connect(nodes[0].url, name="ada") as ada:
                    await ada.join(reserved.code)
                    await asyncio.sleep(2)
                    with pytest.raises(ProtocolError) as error:
                        await hanna.create(TASK)
            assert error.value.code == "rate/episodes"

    @virtual
    async def test_a_token_for_one_session_is_good_for_one_node(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK, seats=3)
            token = nodes[0].server.tokens.mint_role(Role.PLAYER, "paul", seconds=60, once=True)
            async with connect(nodes[1].url, name="paul", token=token) as paul:
                await paul.join(created.code)
                async with connect(nodes[2].url, name="paul", token=token) as again:
                    with pytest.raises(RobotouilleError, match="another session has used it"):
                        await again.join(created.code)


class TestLease:
    @virtual
    async def test_a_node_keeps_its_episodes_while_a_bucket_does_not_answer(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK, seats=2)
            owner = nodes.owner(created.episode)
            monkeypatch.setattr(owner.bus, "prepare", lambda: asyncio.sleep(3600))
            owner.cluster.node._suspect = True
            await asyncio.sleep(20)
            assert nodes.owner(created.episode) is owner

    @virtual
    async def test_node_that_repairs_the_buckets_watches_each_of_them_once(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes:
            node = nodes[0]
            before = sorted(watch.bucket for watch in nodes.nats.watches(node.bus))
            for _ in range(3):
                node.cluster.node._suspect = True
                await asyncio.sleep(2)
                assert not node.cluster.node._suspect
            after = sorted(watch.bucket for watch in nodes.nats.watches(node.bus))
            assert after == before == sorted(Bucket)

    @pytest.mark.parametrize("bucket", quick_sample(Bucket))
    @virtual
    async def test_nodes_fill_a_deleted_bucket_again(self, tmp_path: Path, bucket: Bucket) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create("training/01", clock="lockstep", max_steps=1000)
            game, storage = await ada.join(created.code), nodes.nats.storage
            await asyncio.sleep(2)
            before = storage.values(bucket).keys()
            storage.delete_bucket(bucket)
            assert not await nodes[0].bus.intact()
            for _ in range(30):
                await step(game)
                await asyncio.sleep(0.5)
            assert storage.values(bucket).keys() == before
            assert all([await node.bus.intact() for node in nodes])
            assert not game.ended

    @virtual
    async def test_node_repairs_deleted_buckets_also_after_an_unexpected_answer(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with cluster_of(tmp_path, 1) as nodes:
            answers: list[ValueError | bool] = [False, ValueError("no date")]
            repaired = asyncio.Event()

            async def intact() -> bool:
                answer = answers.pop() if answers else True
                if isinstance(answer, ValueError):
                    raise answer
                return answer

            async def prepare() -> None:
                repaired.set()

            monkeypatch.setattr(nodes[0].bus, "intact", intact)
            monkeypatch.setattr(nodes[0].bus, "prepare", prepare)
            async with asyncio.timeout(30):
                await repaired.wait()

    @virtual
    async def test_node_whose_first_attempt_to_join_fails_watches_each_bucket_once(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        watch, failures = SimulatedBus.watch, [UnavailableError("NATS does not answer")]

        async def fail_once(
            bus: SimulatedBus, bucket: Bucket, changed: Callable[[str, Entry | None], None]
        ) -> None:
            if bucket is Bucket.EPISODES and failures:
                raise failures.pop()
            await watch(bus, bucket, changed)

        monkeypatch.setattr(SimulatedBus, "watch", fail_once)
        async with cluster_of(tmp_path, 1) as nodes:
            assert not failures
            watched = sorted(watch.bucket for watch in nodes.nats.watches(nodes[0].bus))
            assert watched == sorted(Bucket)

    @pytest.mark.slow
    @virtual
    async def test_claims_of_an_episode_whose_node_lives_leave_one_true_recording(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes:
            # NATS checks messages before it has stored those that came shortly before.
            nodes.nats.commit_seconds = 0.1
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[0].url, name="bob") as bob,
            ):
                created = await ada.create(
                    TASK, seats=2, clock="realtime", step_rate=20, max_steps=300
                )
                games = await ada.join(created.code), await bob.join(created.code)
                claims = []
                while not games[0].ended:
                    await asyncio.sleep(1.03)
                    for node in nodes:
                        record = node.cluster.node.directory.find(created.episode)
                        if created.episode not in node.rooms and record is not None:
                            claim = node.cluster.node.claims.claim(record)
                            claims.append(asyncio.create_task(claim))
                await asyncio.gather(*claims)
                await asyncio.sleep(5)
        (file,) = {path.name: path for path in tmp_path.glob("*/*.rbt")}.values()
        found = read_recording(file).verify()
        assert found.ok
        assert found.complete
        assert found.steps == 300

    @pytest.mark.slow
    @virtual
    async def test_an_ended_journal_is_read_only_once_by_the_node_that_claims_it(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with (
            cluster_of(tmp_path) as nodes,
            connect(nodes[0].url, name="ada") as ada,
            connect(nodes[1].url, name="bob") as bob,
        ):
            games = await two_players(nodes, ada, bob)
            owner = nodes.owner(games[0].episode)
            monkeypatch.setattr(owner.bus, "store", lambda *_: asyncio.sleep(30))
            while not games[0].ended:
                await step(*games)
            await asyncio.sleep(1)
            (file,) = owner.folder.glob("*.rbt")
            other = nodes.others(owner)[0]
            record = other.cluster.node.directory.find(games[0].episode)
            assert record is not None
            read, gone = other.bus.read, list[Stored]()

            async def read_once(episode: str, after: int = 0) -> list[Stored]:
                # Another node deletes the journal.
                stored = [found for found in await read(episode, after) if found not in gone]
                gone.extend(stored)
                return stored

            monkeypatch.setattr(other.bus, "read", read_once)
            assert await other.cluster.node.claims.claim(record) == "it has ended"
            assert (other.folder / file.name).read_bytes() == file.read_bytes()

    @virtual
    @pytest.mark.parametrize("file", FOREIGN_FILES)
    async def test_an_entry_with_a_foreign_file_name_changes_no_file(
        self, tmp_path: Path, file: str
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            games = [await ada.create(TASK, seats=2) for _ in range(2)]
            node = nodes.others(nodes.owner(games[0].episode))[0].cluster.node
            record, other = (node.directory.find(game.episode) for game in games)
            assert record is not None
            assert other is not None
            (tmp_path / "catalogue.sqlite").write_bytes(b"precious")
            before = sorted(tmp_path.rglob("*"))
            forged = record.model_copy(update={"file": file.format(other=other.file)})
            why = await node.claims.claim(forged)
            assert "the journal is that of" in why
            assert record.episode in node.claims.refused
            assert sorted(tmp_path.rglob("*")) == before


@virtual
async def test_slow_writes_do_not_slow_a_fast_game_down(tmp_path: Path) -> None:
    """Three steps are due while one write is under way."""
    async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
        created = await ada.create("training/01", clock="realtime", step_rate=60)
        game = await ada.join(created.code)
        await until(game, 5)
        nodes.nats.quality.latency = 0.025
        await asyncio.sleep(1.0)
        before = game.step
        await asyncio.sleep(4.0)
        assert game.step - before == pytest.approx(240, abs=10)


@virtual
async def test_late_steps_give_way_to_others_while_writes_are_slow(tmp_path: Path) -> None:
    """Ten steps were taken at once, which delayed the steps of other games."""
    async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
        created = await ada.create("training/01", clock="realtime", step_rate=60)
        game = await ada.join(created.code)
        await until(game, 5)
        nodes.nats.quality.latency = 0.0125
        await asyncio.sleep(1.0)
        episode = nodes.owner(created.episode).server.lobby.rooms[created.episode].episode
        steps_taken, most = [episode.step], MAX_LATE_AT_ONCE * TICKS_WHILE_WRITING
        stand_still(1.0)
        while steps_taken[-1] < steps_taken[0] + MAX_CATCH_UP:
            await asyncio.sleep(0.001)
            steps_taken.append(episode.step)
        assert max(after - before for before, after in pairwise(steps_taken)) <= most


class TestHandOver:
    @virtual
    async def test_who_joins_while_an_episode_is_handed_over_has_the_seat(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK, seats=3)
            owner = nodes.owner(created.episode)
            room = owner.server.lobby.rooms[created.episode]
            async with connect(owner.url, name="bob") as bob:
                nodes.nats.quality.latency = 0.1
                leaving = asyncio.create_task(owner.leave())
                while room.driver._open:
                    await asyncio.sleep(0.01)
                game = await bob.join(created.code)
                others = (n.server.lobby.rooms.get(created.episode) for n in nodes.others(owner))
                (now,) = filter(None, others)
                assert now.episode.seats[game.seat or ""].name == "bob"
                await leaving

    @virtual
    @pytest.mark.parametrize("late", [False, True])
    async def test_node_adopts_an_episode_only_from_its_owner(
        self, tmp_path: Path, late: bool
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create(TASK, seats=2)
            owner = nodes.owner(created.episode)
            asker, other = nodes.others(owner)
            if late:
                # The request arrives when a third node has the episode already.
                asker, owner = owner, asker
                record = owner.cluster.node.directory.find(created.episode)
                assert record is not None
                assert await owner.cluster.node.claims.claim(record) == ""
                await asyncio.sleep(1)
            subject = f"adopt.{other.cluster.node.name}.{created.episode}"
            name = asker.cluster.node.name.encode()
            assert await asker.bus.request(subject, name, 5.0) == b"another node has it"
            assert nodes.owner(created.episode) is owner
            name = owner.cluster.node.name.encode()
            assert await owner.bus.request(subject, name, 5.0) == b""
            await asyncio.sleep(1)
            assert nodes.owner(created.episode) is other

    @virtual
    async def test_a_game_waits_for_no_reading_while_it_is_handed_over(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        loop = asyncio.get_running_loop()

        def delayed(name: str) -> None:
            method = getattr(SimulatedBus, name)

            async def later(bus: SimulatedBus, *arguments: Any) -> Any:
                await asyncio.sleep(3.0)
                return await method(bus, *arguments)

            monkeypatch.setattr(SimulatedBus, name, later)

        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create("training/01", clock="realtime", step_rate=5.0)
            game = await ada.join(created.code)
            await until(game, 5)
            for name in ("read", "last", "get"):
                delayed(name)
            owner = nodes.owner(created.episode)
            leaving = asyncio.create_task(owner.leave())
            times = [loop.time()]
            for reached in range(6, 40):
                await until(game, reached)
                times.append(loop.time())
            await leaving
            assert nodes.owner(created.episode) is not owner
            assert max(after - before for before, after in pairwise(times)) < 0.5

    @virtual
    async def test_a_slow_game_is_handed_over_just_after_a_step(self, tmp_path: Path) -> None:
        """A whole period follows each pause, so a step would be late by up to two periods."""
        loop = asyncio.get_running_loop()
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create("training/01", clock="realtime", step_rate=0.6)
            game = await ada.join(created.code)
            await until(game, 3)
            times = [loop.time()]
            await asyncio.sleep(0.3)
            owner = nodes.owner(created.episode)
            leaving = asyncio.create_task(owner.leave())
            for reached in range(4, 8):
                await until(game, reached)
                times.append(loop.time())
            await leaving
            assert nodes.owner(created.episode) is not owner
            assert max(after - before for before, after in pairwise(times)) < 1 / 0.6 + 0.2

    @virtual
    async def test_a_step_may_come_when_its_node_has_just_stopped_waiting_for_it(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create("training/01", clock="realtime", step_rate=1.25)
            game = await ada.join(created.code)
            await until(game, 3)
            owner = nodes.owner(created.episode)
            leaving = asyncio.create_task(owner.leave())
            room = owner.server.lobby.rooms[created.episode]
            await asyncio.sleep(0.4)
            leaving.cancel()
            room.driver.apply(lambda now: room.episode.tick(now + 0.8))
            await until(game, 6)
            assert not game.ended

    @virtual
    async def test_who_acts_while_an_episode_is_handed_over_leaves_the_old_node_at_once(
        self, tmp_path: Path
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create("training/01", move_budget=0)
            game = await ada.join(created.code)
            await step(game)
            owner = nodes.owner(created.episode)
            room, before = owner.server.lobby.rooms[created.episode], ada._socket
            assert before is not None
            nodes.nats.quality.latency = 0.1
            leaving = asyncio.create_task(owner.leave())
            while room.driver._open:
                await asyncio.sleep(0.01)
            acting = asyncio.create_task(step(game))
            while created.episode in owner.rooms:
                await asyncio.sleep(0.01)
            async with asyncio.timeout(0.5):
                await before.wait_closed()
            await acting
            assert game.step == 2
            await leaving

    @virtual
    async def test_an_episode_is_handed_over_although_nothing_is_prepared(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async def fail(claims: Claims, record: EpisodeRecord) -> None:
            raise UnavailableError("NATS does not answer")

        monkeypatch.setattr(Claims, "prepare", fail)
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            game = await ada.join((await ada.create("training/01", move_budget=0)).code)
            await step(game)
            owner = nodes.owner(game.episode)
            await owner.leave()
            await step(game)
            assert game.step == 2
            assert nodes.owner(game.episode) is not owner

    @virtual
    async def test_an_offer_of_an_earlier_moment_changes_nothing(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            game = await ada.join((await ada.create("training/01", move_budget=0)).code)
            owner = nodes.owner(game.episode)
            other = nodes.others(owner)[0]
            record = other.cluster.node.directory.find(game.episode)
            assert record is not None
            journal = owner.server.lobby.rooms[game.episode].journal
            assert isinstance(journal, ReplicatedJournal)
            journal.keep_tail()
            await other.cluster.node.claims.prepare(record)
            offer = Offer(owner.cluster.node.name, journal.tail)
            assert offer.tail is not None
            await step(game)
            assert await other.cluster.node.claims.claim(record, offer) == "another node was first"
            await step(game)
            assert game.step == 2
            assert nodes.owner(game.episode) is owner

    @virtual
    async def test_other_games_go_on_while_a_long_journal_is_read(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            game = await ada.join((await ada.create("training/01", move_budget=0)).code)
            for _ in range(40):
                await step(game)
            other = nodes.others(nodes.owner(game.episode))[0].cluster.node
            record = other.directory.find(game.episode)
            assert record is not None
            frames = count_frames(monkeypatch)
            await other.claims.prepare(record)
            for _ in range(40):
                await step(game)
            assert await other.claims.claim(record, Offer(record.node)) == ""
        assert 80 < sum(frames) < 120, "the part that was prepared was read again"
        assert max(frames) <= FRAMES_A_TURN

    @virtual
    async def test_node_that_was_suspended_asks_nobody_to_adopt_what_it_has_lost(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
            games = [await ada.create(TASK, seats=2) for _ in range(4)]
            suspended = nodes.owner(games[0].episode)
            kept = suspended.rooms - {games[0].episode}
            successor = nodes.others(suspended)[0]
            # A node that continues after a suspension learns nothing before its report is stored.
            suspended.bus.deafen()
            record = successor.cluster.node.directory.find(games[0].episode)
            assert record is not None
            assert await successor.cluster.node.claims.claim(record) == ""
            suspended.cluster.node.members._renewed -= 60.0
            request, asked = suspended.bus.request, list[str]()

            async def noted(subject: str, data: bytes, seconds: float) -> bytes:
                if subject.startswith("adopt."):
                    asked.append(subject.rpartition(".")[2])
                return await request(subject, data, seconds)

            monkeypatch.setattr(suspended.bus, "request", noted)
            await suspended.cluster.node.leave()
            assert kept
            assert set(asked) == kept
            assert not suspended.rooms
            assert nodes.owner(games[0].episode) is successor

    @virtual
    async def test_the_last_node_leaves_waiting_games_to_a_new_one_and_plays_running_ones(
        self, tmp_path: Path
    ) -> None:
        nats = SimulatedNats(random.Random(1))
        nodes = cluster_on(nats, tmp_path / "old", 1)
        async with nodes as old, connect(old[0].url, name="ada") as ada:
            waiting = await ada.create(TASK, seats=2)
            running = await ada.create("training/01", clock="realtime", step_rate=5.0)
            game = await ada.join(running.code)
            await until(game, 5)
            await old[0].cluster.node.leave()
            draining = asyncio.create_task(old[0].server.drain(10.0))
            await asyncio.sleep(3)
            assert old[0].rooms == {running.episode}
            async with cluster_on(nats, tmp_path / "new", 1, seed=1) as new:
                await asyncio.sleep(2)
                assert new[0].rooms == {waiting.episode}
                assert old[0].rooms == {running.episode}
                assert not draining.done()
                before = game.step
                await asyncio.sleep(1)
                assert game.step >= before + 4
                await draining
                await old[0].server.stop("the server is restarted", hand_over=True)


class TestTakeover:
    @virtual
    async def test_limits_of_a_recording_count_what_earlier_nodes_wrote(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(journal, "MAX_RECORDING_NOTES", 50)
        async with cluster_of(tmp_path, 2) as nodes, connect(nodes[0].url, name="ada") as ada:
            created = await ada.create("training/01", clock="lockstep")
            game = await ada.join(created.code)
            for _ in range(2):
                for number in range(30):
                    game.note("plan", f"{number}")
                await asyncio.sleep(2)
                owner = nodes.owner(created.episode) if not game.ended else None
                if owner is not None:
                    await owner.leave()
                    await asyncio.sleep(10)
            assert game.outcome is not None
            assert game.outcome["detail"] == "the recording has reached its maximum size"

    @virtual
    async def test_a_game_goes_on_after_its_node_was_killed(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes:
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                games = await two_players(nodes, ada, bob)
                for _ in range(3):
                    await step(*games)
                owner = nodes.owner(games[0].episode)
                await owner.kill()
                for _ in range(3):
                    await step(*games)
                assert [game.step for game in games] == [6, 6]
                successor = nodes.owner(games[0].episode)
                assert successor is not owner
                assert games[0].own_seats != games[1].own_seats

    @virtual
    @pytest.mark.parametrize(
        ("seen", "prepared"), quick_sample([(True, True), (True, False), (False, False)])
    )
    async def test_a_step_that_comes_or_goes_after_the_claim_leaves_one_true_recording(
        self, tmp_path: Path, *, seen: bool, prepared: bool
    ) -> None:
        """`prepared`: the owner was about to hand the episode over, but did not."""
        async with cluster_of(tmp_path, max_steps=6) as nodes:
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                games = await two_players(nodes, ada, bob)
                await step(*games)
                episode, storage = games[0].episode, nodes.nats.storage
                owner = nodes.owner(episode)
                for other in nodes.others(owner) if prepared else ():
                    record = other.cluster.node.directory.find(episode)
                    assert record is not None
                    await other.cluster.node.claims.prepare(record)
                owner.bus.cut(answers_only=True)
                second = asyncio.create_task(step(*games))
                await asyncio.sleep(0.2)
                last = storage.messages(episode)[-1].sequence
                await owner.kill()
                bring_back = storage.remove_message(episode, last) if not seen else None
                await second
                if bring_back is not None:
                    bring_back()
                else:
                    storage.remove_message(episode, last)
                while not games[0].ended:
                    await step(*games)
                await asyncio.sleep(1)
            (path,) = tmp_path.glob("node*/*.rbt")
            found = read_recording(path).verify()
            assert found.ok
            assert (found.complete, found.steps) == (True, 6)

    @pytest.mark.slow
    @virtual
    async def test_the_journal_of_an_ended_game_is_deleted_though_its_node_dies_before(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with (
            cluster_of(tmp_path) as nodes,
            connect(nodes[0].url, name="ada") as ada,
            connect(nodes[1].url, name="bob") as bob,
        ):
            games = await two_players(nodes, ada, bob)
            owner, episode = nodes.owner(games[0].episode), games[0].episode
            monkeypatch.setattr(owner.bus, "purge", lambda _: asyncio.sleep(3600))
            while not games[0].ended:
                await step(*games)
            await asyncio.sleep(1)
            assert nodes.nats.storage.messages(episode)
            await owner.kill()
            await asyncio.sleep(10)
            assert not nodes.nats.storage.messages(episode)
            assert [name for name in nodes.nats.storage.files if episode in name]

    @virtual
    async def test_a_game_goes_on_when_its_node_leaves(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes:
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                games = await two_players(nodes, ada, bob)
                await step(*games)
                owner = nodes.owner(games[0].episode)
                await owner.leave()
                await step(*games)
                assert games[0].step == 2
                assert nodes.owner(games[0].episode) is not owner

    @virtual
    async def test_a_node_that_comes_back_sends_its_participants_on(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path) as nodes:
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                games = await two_players(nodes, ada, bob)
                await step(*games)
                owner = nodes.owner(games[0].episode)
                owner.bus.cut()
                await asyncio.sleep(8)
                successor = nodes.owner(games[0].episode)
                assert successor is not owner
                owner.bus.heal()
                await step(*games)
                assert games[0].step == 2
                assert nodes.owner(games[0].episode) is successor

    @virtual
    async def test_games_wait_while_nobody_has_a_quorum(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path, mode="realtime", step_rate=5.0) as nodes:
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                games = await two_players(nodes, ada, bob)
                await until(games[0], 3)
                owner = nodes.owner(games[0].episode)
                nodes.nats.lose_quorum()
                await asyncio.sleep(20)
                stood = games[0].step
                assert games[0].pause is not None
                assert games[0].pause.reason == "storage"
                nodes.nats.regain_quorum()
                await until(games[0], stood + 3)
                assert nodes.owner(games[0].episode) is owner

    @virtual
    async def test_the_recording_is_complete_wherever_the_game_ends(self, tmp_path: Path) -> None:
        async with cluster_of(tmp_path, max_steps=8) as nodes:
            async with (
                connect(nodes[0].url, name="ada") as ada,
                connect(nodes[1].url, name="bob") as bob,
            ):
                games = await two_players(nodes, ada, bob)
                for _ in range(4):
                    await step(*games)
                await nodes.owner(games[0].episode).kill()
                for _ in range(4):
                    await step(*games)
                assert games[0].ended
                await asyncio.sleep(1)
            (path,) = tmp_path.glob("node*/*.rbt")
            found = read_recording(path).verify()
            assert found.ok
            assert found.complete
            assert found.steps == 8
            stored = nodes.nats.storage.files[path.name]
            assert stored == path.read_bytes()


@virtual
async def test_rematch_at_another_node_is_sent_to_the_game(tmp_path: Path) -> None:
    async with cluster_of(tmp_path, 2) as nodes, connect(nodes[0].url, name="ada") as ada:
        created = await ada.create(TASK)
        owner = nodes.owner(created.episode)
        async with opened(nodes.others(owner)[0].server) as eve:
            await hello(eve)
            answer = await eve.ask({"type": "create", "rematch": created.code}, "moved")
    assert (answer["type"], answer["url"]) == ("moved", owner.url)


@virtual
async def test_simultaneous_rematches_do_not_allow_more_wrong_codes(tmp_path: Path) -> None:
    """Each connection's request passed the check before the others were counted."""
    wrong = {"type": "create", "rematch": "AAAAA-AAAAA"}
    async with cluster_of(tmp_path, 2) as nodes, AsyncExitStack() as stack:
        eves = [
            await stack.enter_async_context(opened(nodes[0].server, **FORWARDED)) for _ in range(40)
        ]
        for eve in eves:
            await hello(eve)
        answers = await asyncio.gather(*(eve.ask(wrong) for eve in eves))
    codes = Counter(answer["code"] for answer in answers)
    assert codes == {"episode/unknown": WRONG_CODES_A_MINUTE, "rate/codes": 20}


@virtual
async def test_requests_of_a_flood_take_turns(tmp_path: Path) -> None:
    """Their tasks are all ready at once, and would keep steps waiting for all of them."""
    loop, iteration, worked = asyncio.get_running_loop(), 0, list[tuple[object, int]]()

    def count() -> None:
        nonlocal iteration
        iteration += 1

    async with cluster_of(tmp_path, 2) as nodes:
        for node in nodes:
            lobby = node.server.lobby
            for name in ("infos", "create", "close"):
                work = getattr(lobby, name)

                def noted(*args: Any, work: Any = work, lobby: Any = lobby, **kw: Any) -> Any:
                    worked.append((lobby, iteration))
                    loop.call_soon(count)
                    return work(*args, **kw)

                setattr(lobby, name, noted)
        service = nodes[0].server.services.cluster
        assert isinstance(service, ClusterService)
        directory = nodes[0].cluster.node.directory
        look = directory.look

        async def looked(code: str) -> None:
            worked.append((directory, iteration))
            loop.call_soon(count)
            await look(code)

        directory.look = looked  # type: ignore[method-assign]
        opening = Opening(request=messages.Create(task=TASK))
        opened = await asyncio.gather(*(service.create(opening) for _ in range(6)))
        await asyncio.gather(
            *(service.list(messages.ListEpisodes(), "", "", operator=False) for _ in range(10)),
            *(
                service.close(messages.Close(episode=each.code), "", operator=True)
                for each in opened
            ),
            *(service.look("AAAAA-AAAAA") for _ in range(8)),
        )
    assert len(worked) == 6 + 2 * 10 + 6 + 8
    assert len(set(worked)) == len(worked)
