"""Requests of operators that open episodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robotouille.episode import Phase
from robotouille_client import connect
from robotouille_server.operator.load import REQUESTS_BURST
from robotouille_server.operator.models import MAX_OPENED
from robotouille_server.rooms.recording.storage import Appender, Folder
from tests.support.operator import CHANGE, audited, bearer, viewing
from tests.support.virtual_time import virtual

TASK = "multi_agent/01_lettuce_burger"


@virtual
async def test_links_and_tokens_admit_players_to_their_seats(tmp_path: Path) -> None:
    async with viewing(tmp_path, require_token=True, tokens=True) as (server, _, api):
        body = {"count": 3, "create": {"task": TASK, "labels": {"pair": "p1"}, "tokens": True}}
        headers = {**CHANGE, **bearer(server, "lab")}
        answer = await api.http.post("/api/episodes", json=body, headers=headers)
        assert answer.status_code == 200, answer.text
        opened = answer.json()["opened"]
        assert answer.json()["problem"] is None
        assert {one["episode"] for one in opened} == set(server.lobby.rooms)
        room = server.lobby.rooms[opened[0]["episode"]]
        assert (room.owner, room.labels) == ("lab", {"pair": "p1"})
        for tokens in (opened[1]["links"], opened[2]["tokens"]):
            assert list(tokens) == ["robot1", "robot2"]
            async with connect(server.url, name="ada", token=tokens["robot2"]) as ada:
                game = await ada.join(server.tokens.check_role(tokens["robot2"]).episode)
                assert game.seat == "robot2"
    lines = [line for line in audited(tmp_path) if line["what"] == "open episodes"]
    assert [(line["by"], line["episode"]) for line in lines] == [
        ("lab", one["episode"]) for one in opened
    ]


@virtual
async def test_faults_name_the_field(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api):

        async def refused(**body: Any) -> tuple[int, str]:
            answer = await api.post("/api/episodes", **body)
            return answer.status_code, answer.json()["field"]

        assert await refused(create={"task": "soop"}) == (400, "task")
        assert await refused(create={"task": TASK, "seats": 9}) == (400, "seats")
        assert await refused(create={"step_rate": -1}) == (400, "create.step_rate")
        assert await refused(create={"labels": {"pair": 1}}) == (400, "create.labels.pair")
        assert await refused(create={"tsak": TASK}) == (400, "create.tsak")
        assert await refused(count=MAX_OPENED + 1) == (400, "count")
        assert await refused(count=0) == (400, "count")
        assert await refused(create={"treatments": {"robot9": {"delay_ms": 5}}}) == (
            400,
            "treatments",
        )
        assert not server.lobby.rooms


@virtual
async def test_opened_episodes_are_reported_when_the_server_is_full(tmp_path: Path) -> None:
    async with viewing(tmp_path, max_episodes=2) as (server, _, api):
        answer = (await api.post("/api/episodes", count=5, create={"task": TASK})).json()
        assert [one["episode"] for one in answer["opened"]] == list(server.lobby.rooms)
        assert len(answer["opened"]) == 2
        assert answer["problem"]["code"] == "server/full"
        again = await api.post("/api/episodes", count=1, create={"task": TASK})
        assert (again.status_code, again.json()["code"]) == (503, "server/full")


class Faulty(Folder):
    """Folder that fails when the third file is created."""

    def create(self, name: str) -> Appender:
        if len(self.names()) >= 2:
            raise RuntimeError("a fault")
        return super().create(name)


@virtual
async def test_episodes_before_a_fault_are_in_the_audit_log(tmp_path: Path) -> None:
    async with viewing(tmp_path, storage=Faulty(tmp_path)) as (server, _, api):
        answer = await api.post("/api/episodes", count=5, create={"task": TASK})
        assert answer.status_code == 500
        opened = [line["episode"] for line in audited(tmp_path) if line["what"] == "open episodes"]
        assert opened == list(server.lobby.rooms)[:2]


@virtual
async def test_each_episode_counts_as_a_request(tmp_path: Path) -> None:
    async with viewing(tmp_path, max_episodes=1) as (_, _, api):
        answers = [
            (await api.post("/api/episodes", count=MAX_OPENED)).status_code
            for _ in range(int(REQUESTS_BURST) // MAX_OPENED + 1)
        ]
        assert answers == [200, 503, 429]


@virtual
async def test_token_for_one_episode_opens_no_other(tmp_path: Path) -> None:
    async with viewing(tmp_path, tokens=True) as (server, _, api):
        limited = bearer(server, episode="KQXZB-MHTWA")
        answer = await api.http.post("/api/episodes", json={}, headers={**CHANGE, **limited})
        assert (answer.status_code, answer.json()["code"]) == (403, "auth/episode")
        answer = await api.http.get("/api/tasks", headers=limited)
        assert answer.status_code == 403
        assert not server.lobby.rooms


@virtual
async def test_tasks_are_listed_with_their_seats(tmp_path: Path) -> None:
    own = tmp_path / "tasks"
    own.mkdir()
    shipped = Path("problems/workshop/02_two_workers.json").resolve()
    for name in ("mine", "broken"):
        (own / f"{name}.json").write_bytes(shipped.read_bytes())
    async with viewing(tmp_path / "recordings", tasks=own) as (_, _, api):
        (own / "broken.json").write_text("{")
        answer = await api.get("/api/tasks")
        rows = {row["name"]: row for row in answer["tasks"]}
        assert rows["mine"]["seats"] == rows["workshop/02_two_workers"]["seats"] == [2]
        assert rows[TASK]["seats"] == [2, 3, 4]
        assert "broken" not in rows
        assert any(row["shift"] for row in answer["tasks"])
        assert answer["skills"] == ["learner", "partner", "expert"]
        opened = (await api.post("/api/episodes", create={"task": "mine"})).json()["opened"]
        assert (await api.row(opened[0]["episode"]))["phase"] == Phase.WAITING.value


@virtual
async def test_pages_of_other_sites_open_nothing(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api):
        for headers in ({}, {**CHANGE, "Origin": "http://evil.example"}):
            answer = await api.http.post("/api/episodes", json={}, headers=headers)
            assert answer.status_code == 403
        assert not server.lobby.rooms
