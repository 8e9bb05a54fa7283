"""Operators of one node see and control the episodes of all nodes."""

from __future__ import annotations

import asyncio
import json
import tarfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille_client import Announced, Client, Game, GameEnded, connect
from robotouille_server.auth.revocation import REVOKED_FILE, revoke
from robotouille_server.cluster.bus import Bucket, Entry
from robotouille_server.operator import operator_view
from tests.support.clusters import Node, Nodes, cluster_of
from tests.support.operator import Api, audited, bearer
from tests.support.virtual_time import virtual

TASK = "training/03_multi_agent"


@dataclass
class Lab:
    """Nodes with their operator pages, and an episode of two players on one of them."""

    nodes: Nodes
    apis: list[Api]
    episode: str
    code: str
    games: list[Game]

    @property
    def owner(self) -> int:
        return next(i for i, node in enumerate(self.nodes) if self.episode in node.rooms)

    @property
    def asked(self) -> Api:
        """API of a node that does not have the episode."""
        return self.apis[(self.owner + 1) % len(self.apis)]

    @property
    def asked_node(self) -> Node:
        return self.nodes[(self.owner + 1) % len(self.apis)]

    @property
    def path(self) -> str:
        return f"/api/episodes/{self.episode}"


@asynccontextmanager
async def lab(folder: Path, nodes: int = 3, **view: Any) -> AsyncIterator[Lab]:
    async with AsyncExitStack() as stack:
        cluster = await stack.enter_async_context(cluster_of(folder, nodes))
        apis = []
        for node in cluster:
            tokens = {"authorize": node.server.authorize} if view else {}
            port = await stack.enter_async_context(
                operator_view(node.server, port=0, **{**tokens, **view})
            )
            http = httpx.AsyncClient(base_url=port.url, timeout=None, trust_env=False, verify=False)
            apis.append(Api(await stack.enter_async_context(http)))
        url = cluster[0].url
        clients: list[Client] = [
            await stack.enter_async_context(connect(url, name=name)) for name in ("ada", "bob")
        ]
        created = await clients[0].create(TASK, seats=2)
        games = [await client.join(created.code) for client in clients]
        await asyncio.sleep(2.5)  # All nodes report their seats and pages.
        yield Lab(cluster, apis, created.episode, created.code, games)


async def until(game: Game, kind: type) -> Any:
    while not isinstance(event := await game.next_event(), kind):
        pass
    return event


class TestOpening:
    @virtual
    async def test_episodes_go_to_the_nodes_with_the_least_load(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            body = {"count": 6, "create": {"task": TASK, "tokens": True}}
            answer = (await at.asked.post("/api/episodes", **body)).json()
            opened = {one["episode"]: one["links"]["robot1"] for one in answer["opened"]}
            homes = {room: node for node in at.nodes for room in node.rooms if room != at.episode}
            assert homes.keys() == opened.keys()
            assert len({node.url for node in homes.values()}) == 3
            for episode, link in opened.items():
                async with connect(at.nodes[0].url, name="cem", token=link) as cem:
                    game = await cem.join(link.partition(".")[0])
                    assert game.episode == episode

    @virtual
    async def test_spectators_of_any_episode_get_a_link(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            answer = await at.asked.post(f"{at.path}/spectator_link")
            link = answer.json()["link"]
            async with connect(at.nodes[0].url, name="eve", token=link) as eve:
                game = await eve.join(at.code, role="spectator")
                assert game.episode == at.episode


class TestOverview:
    @virtual
    async def test_every_node_shows_the_episodes_of_all(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at, connect(at.nodes[0].url, name="eve") as eve:
            for _ in range(5):
                await eve.create(TASK)
            homes = {room: node.url for node in at.nodes for room in node.rooms}
            assert len(set(homes.values())) == 3
            for api in at.apis:
                seen = await api.get("/api/overview")
                assert {row["episode"]: row["node"] for row in seen["episodes"]} == homes
                assert seen["found"] == 6
                counts = seen["totals"]["episodes"]
                assert (counts["waiting"], sum(counts.values())) == (5, 6)
                connections = [len(node.server.connections.open) for node in at.nodes]
                assert seen["totals"]["connections"] == sum(connections)

    @pytest.mark.slow
    @virtual
    async def test_pages_of_the_list_contain_each_episode_once(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at, connect(at.nodes[0].url, name="eve") as eve:
            for _ in range(6):
                await eve.create(TASK)
            pages = [
                (await at.asked.get(f"/api/overview?limit=3&offset={offset}"))["episodes"]
                for offset in (0, 3, 6)
            ]
            assert [len(page) for page in pages] == [3, 3, 1]
            rows = [row for page in pages for row in page]
            assert len({row["episode"] for row in rows}) == 7
            phases = [row["phase"] for row in rows]
            assert phases == ["running", *["waiting"] * 6]

    @pytest.mark.slow
    @virtual
    async def test_search_and_phase_apply_to_all_nodes(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            for query, found in (("search=bob", 1), ("search=eve", 0), ("phase=ended", 0)):
                seen = await at.asked.get(f"/api/overview?{query}")
                assert (seen["found"], len(seen["episodes"])) == (found, found)

    @pytest.mark.slow
    @virtual
    async def test_nodes_are_listed_with_their_load(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            nodes = (await at.asked.get("/api/overview"))["nodes"]
            assert nodes[0]["node"] == at.asked_node.url
            assert {row["node"] for row in nodes} == {node.url for node in at.nodes}
            assert sorted(row["seats"] for row in nodes) == [0, 0, 2]
            pages = {str(api.http.base_url) for api in at.apis}
            assert {row["operator"] for row in nodes} == pages
            for row in nodes:
                assert row["silent"] <= 2
                assert (row["leaving"], row["problem"]) == (False, "")
                assert row["same_keys"] and row["same_version"] and row["same_tasks"]

    @pytest.mark.slow
    @virtual
    async def test_nodes_with_other_keys_and_versions_are_marked(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            members = at.nodes[at.owner].cluster.node.members
            members.own = members.own.model_copy(update={"release": "robotouille 9.9"})
            await asyncio.sleep(1.5)
            rows = {r["node"]: r for r in (await at.asked.get("/api/overview"))["nodes"]}
            row = rows[at.nodes[at.owner].url]
            assert (row["version"], row["same_version"]) == ("robotouille 9.9", False)

    @virtual
    async def test_a_node_that_does_not_answer_is_named(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            owner, asked = at.nodes[at.owner], at.asked
            owner.bus.cut()
            before = asyncio.get_running_loop().time()
            seen = await asked.get("/api/overview")
            assert asyncio.get_running_loop().time() - before < 1.2
            assert seen["episodes"] == []
            (silent,) = (row for row in seen["nodes"] if row["problem"])
            assert silent["node"] == owner.url

    @virtual
    async def test_a_bad_answer_is_named(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            owner, asked = at.nodes[at.owner], at.asked
            ok = b'{"status": 200, "headers": {}}\n'
            for bad in (b"", b"nonsense", ok, ok + b'{"ranks": []}', ok + b"[1]", b"{}\n{}"):

                async def answer(word: str, data: bytes, bad: bytes = bad) -> bytes:
                    return bad

                await owner.bus.answer(f"operator.{owner.cluster.node.name}", answer)
                seen = await asked.get("/api/overview")
                (row,) = (row for row in seen["nodes"] if row["problem"])
                assert (row["node"], "cannot read" in row["problem"]) == (owner.url, True)


class TestEpisodes:
    @virtual
    async def test_details_are_read_from_the_other_node(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            here = await at.apis[at.owner].get(at.path)
            for name in (at.episode, at.code):
                there = await at.asked.get(f"/api/episodes/{name}")
                assert there["node"] == at.nodes[at.owner].url
                assert (there["episode"], there["text"]) == (at.episode, here["text"])

    @virtual
    async def test_events_follow_an_episode_of_another_node(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            events = at.asked.events(f"{at.path}/events")
            assert (await anext(events))["pause"] is None
            await at.apis[at.owner].do(f"{at.path}/pause")
            assert (await anext(events))["pause"]["reason"] == "operator"
            await events.aclose()

    @virtual
    async def test_pause_and_resume_work_on_any_node(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            assert "is paused" in await at.asked.do(f"{at.path}/pause")
            assert (await at.apis[at.owner].get(at.path))["pause"]["reason"] == "operator"
            await at.asked.do(f"{at.path}/resume")
            assert (await at.apis[at.owner].get(at.path))["pause"] is None

    @virtual
    async def test_participants_are_removed_and_muted(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            seats = (await at.asked.get(at.path))["seats"]
            await at.asked.do(f"{at.path}/mute", session=seats[0]["session"], muted=True)
            assert (await at.asked.get(at.path))["seats"][0]["muted"]
            await at.asked.do(f"{at.path}/kick", session=seats[1]["session"], reason="be kind")
            assert (await until(at.games[1], GameEnded)).reason == "be kind"

    @pytest.mark.slow
    @virtual
    async def test_announcements_reach_one_episode_or_all_nodes(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            await at.asked.do(f"{at.path}/announce", text="here")
            assert (await until(at.games[0], Announced)).text == "here"
            for api in at.apis:
                assert await api.do("/api/announce", text="to all")
                assert (await until(at.games[0], Announced)).text == "to all"
            cut_off, asked = at.nodes[at.owner], at.asked
            cut_off.bus.cut()
            done = await asked.do("/api/announce", text="to most")
            # By now, other nodes may have taken its episodes over.
            assert done.endswith(f"but not on {cut_off.url}")

    @virtual
    async def test_an_ended_episode_and_its_recording(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            owner, asked = at.owner, at.asked
            await asked.do(f"{at.path}/end", reason="late")
            await asyncio.sleep(2)  # The recording is stored.
            answer = await asked.post(f"{at.path}/pause")
            assert (answer.status_code, answer.json()["code"]) == (409, "episode/ended")
            seen = await asked.get(at.path)
            assert seen["lines"][-1]["text"] == "ended, aborted: late"
            name = seen["recording"]["name"]
            download = await asked.http.get(f"/api/recordings/{name}")
            assert download.content == (at.nodes[owner].folder / name).read_bytes()
            assert name in download.headers["content-disposition"]
            assert (await asked.http.get("/api/recordings/x_y_z.rbt")).status_code == 404

    @virtual
    async def test_a_large_recording_names_the_page_of_its_node(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async with lab(tmp_path) as at:
            owner, asked = at.owner, at.asked
            await asked.do(f"{at.path}/end")
            await asyncio.sleep(2)  # The recording is stored.
            name = (await asked.get(at.path))["recording"]["name"]
            for module in ("recordings.stored_recordings", "answering"):
                name_of_limit = f"robotouille_server.operator.{module}.MAX_ANSWER_BYTES"
                monkeypatch.setattr(name_of_limit, 100)
            for path in (f"/api/recordings/{name}", at.path):
                answer = await asked.http.get(path)
                assert (answer.status_code, answer.json()["code"]) == (502, "node/size")
                assert str(at.apis[owner].http.base_url) in answer.json()["message"]

    @pytest.mark.slow
    @virtual
    async def test_any_node_lists_and_sends_the_recordings_of_all(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            asked = at.asked
            await asked.post("/api/episodes", count=5, create={"task": TASK, "labels": {"a": "b"}})
            for room in [room for node in at.nodes for room in node.server.lobby.rooms.values()]:
                room.abort("late")
            await asyncio.sleep(2)  # The recordings are stored.
            storage = at.nodes.nats.storage
            for code in storage.values(Bucket.EPISODES):  # As some time later.
                storage.set(Bucket.EPISODES, code, None)
            places = {file.name: node for node in at.nodes for file in node.folder.glob("*.rbt")}
            assert len({node.url for node in places.values()}) == 3
            names = sorted(places, reverse=True)
            content = {name: (places[name].folder / name).read_bytes() for name in names}
            for node, api in zip(at.nodes, at.apis, strict=True):
                page = await api.get("/api/recordings")
                rows = {row["name"]: row["node"] for row in page["recordings"]}
                elsewhere = {name: where.url for name, where in places.items() if where is not node}
                assert (list(rows), page["found"]) == (names, 6)
                assert {name: url for name, url in rows.items() if url} == elsewhere
                page = await api.get("/api/recordings", params={"limit": 2, "offset": 3})
                assert [row["name"] for row in page["recordings"]] == names[3:5]
                for name in names:
                    assert (await api.http.get(f"/api/recordings/{name}")).content == content[name]
                archive = BytesIO((await api.http.get("/api/archive")).content)
                with tarfile.open(fileobj=archive) as tar:
                    files = {each.name: tar.extractfile(each) for each in tar}
                    assert {name: file.read() for name, file in files.items() if file} == content
            answer = await asked.http.get("/api/recordings", params={"offset": 1000})
            assert answer.json()["message"].endswith("search for fewer")

    @pytest.mark.slow
    @virtual
    async def test_recordings_of_a_silent_node_are_left_out(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            asked, owner = at.asked, at.nodes[at.owner]
            await asked.do(f"{at.path}/end")
            await asyncio.sleep(2)  # The recording is stored.
            assert (await asked.get("/api/recordings"))["found"] == 1
            owner.bus.cut()
            assert (await asked.get("/api/recordings"))["found"] == 0

    @virtual
    async def test_a_silent_node_is_an_error_within_seconds(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            asked, path, loop = at.asked, at.path, asyncio.get_running_loop()
            asked_node = at.asked_node
            at.nodes[at.owner].bus.cut()
            before = loop.time()
            answer = await asked.post(f"{path}/pause")
            assert (answer.status_code, answer.json()["code"]) == (504, "node/unavailable")
            assert loop.time() - before < 5.5
            (line,) = audited(asked_node.folder)
            assert (line["what"], line["result"]) == ("pause", "node/unavailable")

    @virtual
    async def test_an_episode_that_is_nowhere_is_a_handover(self, tmp_path: Path) -> None:
        async with lab(tmp_path) as at:
            asked, path = at.asked, at.path
            for node in at.nodes:
                directory = node.cluster.node.directory
                record = directory.find(at.episode)
                assert record is not None
                gone = record.model_copy(update={"node": "nobody", "claim": 10**6})
                directory.changed(record.key, Entry(gone.model_dump_json().encode(), 10**6))
            answer = await asked.http.get(path)
            assert (answer.status_code, answer.json()["code"]) == (503, "episode/handover")
            assert answer.headers["retry-after"] == "1"


class TestRights:
    @virtual
    async def test_the_audit_log_of_the_episodes_node_names_the_operator(
        self, tmp_path: Path
    ) -> None:
        async with lab(tmp_path, ask_token=True) as at:
            owner, via = at.nodes[at.owner], at.asked_node
            at.asked.http.headers.update(bearer(via.server, "grace"))
            await at.asked.do(f"{at.path}/pause")
            (line,) = audited(owner.folder)
            assert (line["what"], line["by"], line["via"]) == ("pause", "grace", via.url)
            assert line["token"]
            assert line["episode"] == at.episode

    @virtual
    async def test_a_token_for_one_episode_opens_no_other(self, tmp_path: Path) -> None:
        async with lab(tmp_path, ask_token=True) as at:
            asked = at.asked
            server = at.asked_node.server
            asked.http.headers.update(bearer(server, "grace", episode="f" * 16))
            seen = await asked.get("/api/overview")
            assert (seen["found"], seen["episodes"]) == (0, [])
            assert sum(seen["totals"]["episodes"].values()) == 0
            for answer in (await asked.http.get(at.path), await asked.post(f"{at.path}/pause")):
                assert (answer.status_code, answer.json()["code"]) == (403, "auth/episode")
            answer = await asked.post("/api/announce", text="all")
            assert answer.status_code == 403
            for name in (at.episode, at.code):
                asked.http.headers.update(bearer(server, "grace", episode=name))
                for path in (at.path, f"/api/episodes/{at.code}"):
                    assert (await asked.get(path))["episode"] == at.episode

    @virtual
    async def test_a_token_revoked_on_the_other_node_is_refused(self, tmp_path: Path) -> None:
        async with lab(tmp_path, ask_token=True) as at:
            header = bearer(at.asked_node.server, "grace")
            at.asked.http.headers.update(header)
            owner = at.nodes[at.owner].server
            grant = owner.authorize(header["Authorization"].removeprefix("Bearer "))
            state = owner.settings.state_folder
            revoke(state / REVOKED_FILE, [grant.token_id], grant.expires, owner.wall())
            answer = await at.asked.post(f"{at.path}/pause")
            assert (answer.status_code, answer.json()["code"]) == (401, "auth/revoked")

    @virtual
    async def test_a_node_that_needs_tokens_refuses_requests_without(self, tmp_path: Path) -> None:
        async with lab(tmp_path, nodes=2) as at, AsyncExitStack() as stack:
            owner = at.nodes[at.owner].server
            await stack.enter_async_context(
                operator_view(owner, port=0, authorize=owner.authorize, ask_token=True)
            )
            answer = await at.asked.post(f"{at.path}/pause")
            assert (answer.status_code, answer.json()["code"]) == (401, "auth/needed")
            seen = await at.asked.get("/api/overview")
            assert "token" in seen["nodes"][1]["problem"]

    @virtual
    async def test_a_node_with_other_keys_refuses_tokens(self, tmp_path: Path) -> None:
        async with lab(tmp_path, ask_token=True) as at:
            at.asked.http.headers.update(bearer(at.asked_node.server, "grace"))
            node = at.nodes[at.owner].cluster.node
            node.members.own = node.members.own.model_copy(update={"keys": "others"})
            answer = await at.asked.post(f"{at.path}/pause")
            assert (answer.status_code, answer.json()["code"]) == (403, "node/keys")


GOOD = {"by": "local", "method": "GET", "path": "/api/overview"}
GRANT = {"subject": "grace", "episode": "", "token_id": "x", "expires": 0.0}


class TestMessages:
    @virtual
    async def test_invalid_requests_are_refused(self, tmp_path: Path) -> None:
        async with lab(tmp_path, nodes=2) as at:
            asker, asked = (node.cluster.node for node in at.nodes)
            subject = f"operator.{asked.name}.request"
            for changes in (
                {"by": None},
                {"by": ""},
                {"by": "root"},
                {"by": {**GRANT, "subject": ""}},
                {"by": {**GRANT, "role": "operator"}},
                {"by": {"episode": ""}},
                {"node": ""},
                {"node": "unknown"},
                {"node": asked.name},
                {"method": "DELETE"},
                {"path": "/index.html"},
                {"path": "/api/overview/events"},
                {"via": "x"},
            ):
                header = {"node": asker.name, **GOOD, **changes}
                header = {name: value for name, value in header.items() if value is not None}
                answer = await asker.bus.request(subject, json.dumps(header).encode() + b"\n", 5)
                status = json.loads(answer.partition(b"\n")[0])["status"]
                assert status in (400, 403), changes

    @virtual
    async def test_good_and_malformed_requests(self, tmp_path: Path) -> None:
        async with lab(tmp_path, nodes=2) as at:
            asker, asked = (node.cluster.node for node in at.nodes)
            subject = f"operator.{asked.name}.request"
            good = json.dumps({"node": asker.name, **GOOD}).encode()
            for data, status in (
                (good + b"\n", 200),
                (good, 400),
                (b"", 400),
                (b"\xff\n", 400),
                (good + b"\n" + b"x" * 65536, 400),
            ):
                answer = await asker.bus.request(subject, data, 5)
                assert json.loads(answer.partition(b"\n")[0])["status"] == status


@virtual
async def test_a_server_without_a_cluster_has_no_nodes(tmp_path: Path) -> None:
    from tests.support.operator import table, viewing

    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        seen = await api.get("/api/overview")
        assert seen["nodes"] == []
        assert [row["node"] for row in seen["episodes"]] == [""]
        assert (await api.get(f"/api/episodes/{play.episode}"))["node"] == ""


@pytest.mark.parametrize("keys", [None, f"given:{'A' * 43}"])
@virtual
async def test_reports_keep_the_digest_of_the_keys(tmp_path: Path, keys: str | None) -> None:
    given = {} if keys is None else {"signing_keys": keys}
    async with cluster_of(tmp_path, 2, **given) as nodes:
        await asyncio.sleep(2.5)
        digests = {r.keys for node in nodes for r in node.cluster.node.members.alive()}
        assert len(digests) == 1
        assert all(len(digest) == 16 for digest in digests)
