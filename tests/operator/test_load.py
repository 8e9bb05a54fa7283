"""Event loop time that requests of operators use up."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import NoReturn

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.operator import load
from robotouille_server.operator.load import ROWS_A_TURN, TURNS_A_SECOND, TURNS_BURST, Turns
from robotouille_server.operator.models import EpisodeRow
from robotouille_server.operator.rows import RoomRows
from robotouille_server.rooms.room import Room
from robotouille_server.transport import LoopBudget
from tests.support.operator import viewing
from tests.support.samples import quick_sample
from tests.support.virtual_time import virtual


class RowCount:
    """Number of rows that were built in each turn of the event loop."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.turns: list[int] = []
        self._built = 0
        build = RoomRows.row

        def counted(rows: RoomRows, room: Room, now: float) -> EpisodeRow:
            if not self._built:
                asyncio.get_running_loop().call_soon(self._end)
            self._built += 1
            return build(rows, room, now)

        monkeypatch.setattr(RoomRows, "row", counted)

    def _end(self) -> None:
        self.turns.append(self._built)
        self._built = 0


@pytest.mark.slow
@pytest.mark.parametrize("query", quick_sample(["limit=200&search=lettuce", "limit=200"]))
@virtual
async def test_episodes_take_steps_between_parts_of_overviews(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, query: str
) -> None:
    count = RowCount(monkeypatch)
    async with viewing(tmp_path) as (server, _, api):
        for _ in range(50):
            server.lobby.create(messages.Create(), owner="lab")
        pages = await asyncio.gather(*(api.get(f"/api/overview?{query}") for _ in range(6)))
        assert [len(page["episodes"]) for page in pages] == [50] * 6
        assert sum(count.turns) == 300
        assert max(count.turns) <= ROWS_A_TURN


@virtual
async def test_rows_count_as_requests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load, "REQUESTS_BURST", 33)
    async with viewing(tmp_path) as (_, _, api):
        for _ in range(3):
            await api.get("/api/overview?limit=200")
        answer = await api.http.get("/api/overview?limit=1")
        assert (answer.status_code, answer.json()["code"]) == (429, "operator/rate")
        await asyncio.sleep(1)
        answers = [await api.http.get("/api/node?limit=180") for _ in range(4)]
        assert [answer.status_code for answer in answers] == [200, 200, 429, 429]


@virtual
async def test_turns_per_second_are_limited_for_all_operators_together() -> None:
    loop = asyncio.get_running_loop()
    turns, began = Turns(LoopBudget(loop), loop.time), loop.time()
    await asyncio.gather(*(turns.next() for _ in range(int(TURNS_BURST))))
    assert loop.time() == began
    await asyncio.gather(*(turns.next() for _ in range(int(3 * TURNS_A_SECOND))))
    assert loop.time() - began == pytest.approx(3)


@pytest.mark.slow
@virtual
async def test_refusals_are_limited_and_delay_no_operator(tmp_path: Path) -> None:
    """A stranger's wrong tokens are free of the rates, so they would fill the event loop."""
    loop = asyncio.get_running_loop()

    def refuse(token: str) -> NoReturn:
        raise ProtocolError("auth/invalid", "this token is invalid", "token")

    async with viewing(tmp_path, view={"authorize": refuse}) as (_, _, api):

        async def guess() -> None:
            for _ in range(40):
                answer = await api.http.get("/api/node", headers={"Authorization": "Bearer x"})
                assert answer.status_code == 401

        began = loop.time()
        flood = asyncio.gather(*(guess() for _ in range(10)))
        await asyncio.sleep(1)
        asked = loop.time()
        await api.get("/api/node")
        assert loop.time() - asked < 0.1
        await flood
        assert loop.time() - began >= 2.9


@virtual
async def test_client_waits_for_one_turn_of_operators_at_most() -> None:
    loop, served = asyncio.get_running_loop(), []
    budget = LoopBudget(loop)
    turns = Turns(budget, loop.time)

    async def operator() -> None:
        await turns.next()
        served.append("operator")

    async with asyncio.TaskGroup() as group:
        for _ in range(30):
            group.create_task(operator())
        await asyncio.sleep(0)
        budget.wait(lambda: served.append("client"))
    assert served.index("client") <= 1
    assert served.count("operator") == 30


@virtual
async def test_cancelled_request_takes_no_turn() -> None:
    loop = asyncio.get_running_loop()
    turns = Turns(LoopBudget(loop), loop.time)
    gone = [asyncio.create_task(turns.next()) for _ in range(3)]
    await asyncio.sleep(0)
    for task in gone:
        task.cancel()
    await turns.next()
    assert all(task.cancelled() for task in gone)
