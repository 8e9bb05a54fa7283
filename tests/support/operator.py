"""A server with its operator page, its players, and a client of the operator API."""

from __future__ import annotations

import asyncio
import json
import stat
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import httpx

from robotouille_client import Client, Game, connect
from robotouille_server import Server, ServerSettings, serve
from robotouille_server.app import Surroundings
from robotouille_server.auth.roles import Role
from robotouille_server.operator import OperatorPort, operator_view
from robotouille_server.rooms.recording.storage import Folder, Storage
from tests.support.servers import STAMP

TASK = "multi_agent/01_lettuce_burger"
PATIENCE = 300
"""Time limit in virtual seconds for an expected event."""
CHANGE = {"X-Robotouille-Operator": "1"}
GUESS = {"Authorization": "Bearer guess"}
"""Header of a caller with an invalid token."""


def audited(recordings: Path) -> list[dict[str, Any]]:
    """Return the lines of the audit log, which only its owner may read."""
    file = recordings.with_name(f"{recordings.name}.state") / "audit.log"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


class Api:
    """Client of the operator API over real HTTP."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self.http = http

    async def get(self, path: str, **options: Any) -> Any:
        answer = await self.http.get(path, **options)
        assert answer.status_code == 200, answer.text
        return answer.json()

    async def post(self, path: str, **body: Any) -> httpx.Response:
        return await self.http.post(path, json=body, headers=CHANGE)

    async def do(self, path: str, **body: Any) -> str:
        """Send a request that must succeed, and return the description of the change."""
        answer = await self.post(path, **body)
        assert answer.status_code == 200, answer.text
        done: str = answer.json()["done"]
        return done

    async def row(self, episode: str) -> Any:
        """Return the overview's row of one episode."""
        rows = (await self.get("/api/overview"))["episodes"]
        return next(row for row in rows if row["episode"] == episode)

    async def events(self, path: str) -> AsyncIterator[Any]:
        async with self.http.stream("GET", path) as answer:
            assert answer.status_code == 200
            assert answer.headers["content-type"].startswith("text/event-stream")
            async for line in answer.aiter_lines():
                if line.startswith("data: "):
                    yield json.loads(line[6:])


@asynccontextmanager
async def viewing(
    folder: Path,
    *,
    storage: Storage | None = None,
    view: dict[str, Any] | None = None,
    tokens: bool = False,
    wall: Callable[[], float] = time.time,
    **options: Any,
) -> AsyncIterator[tuple[Server, OperatorPort, Api]]:
    """Run a server with its operator page and yield both with an API client. With `tokens`, the
    page requires the server's role tokens.
    """
    settings = ServerSettings(port=0, recordings=folder, **{"countdown": 0.0, **options})
    async with AsyncExitStack() as stack:
        serving = serve(settings, Surroundings(timestamp=lambda: STAMP, storage=storage, wall=wall))
        server = await stack.enter_async_context(serving)
        asked = {"authorize": server.authorize, "ask_token": True} if tokens else {}
        opening = operator_view(server, port=0, **{**asked, **(view or {})})
        port = await stack.enter_async_context(opening)
        http = await stack.enter_async_context(
            httpx.AsyncClient(base_url=port.url, timeout=None, trust_env=False, verify=False)
        )
        yield server, port, Api(http)


def bearer(server: Server, subject: str = "lab", **limits: Any) -> dict[str, str]:
    """Return the header with an operator token of this server."""
    token = server.tokens.mint_role(Role.OPERATOR, subject, **{"seconds": 3600, **limits})
    return {"Authorization": f"Bearer {token}"}


class Table:
    """Two people in one episode."""

    def __init__(self, clients: list[Client], games: list[Game]) -> None:
        self.clients = clients
        self.games = games
        self.episode = games[0].episode
        self.code = games[0].code

    async def until(self, reached: Callable[[Game], object], seat: int = 0) -> list[Any]:
        """Receive events until a condition holds, and return them."""
        game, events = self.games[seat], []
        async with asyncio.timeout(PATIENCE):
            while not reached(game):
                events.append(await game.next_event())
        return events

    async def wait_for(self, kind: type, seat: int = 0) -> Any:
        """Wait for the next event of a type and return it."""
        async with asyncio.timeout(PATIENCE):
            while not isinstance(event := await self.games[seat].next_event(), kind):
                pass
        return event


@asynccontextmanager
async def table(
    server: Server, task: str = TASK, names: tuple[str, ...] = ("ada", "bob"), **rules: Any
) -> AsyncIterator[Table]:
    """Start an episode in which all seats are taken."""
    async with AsyncExitStack() as stack:
        clients = [
            await stack.enter_async_context(connect(server.url, name=name, kind="human"))
            for name in names
        ]
        created = await clients[0].create(task, **{"clock": "realtime", **rules})
        games = [await client.join(created.code) for client in clients]
        yield Table(clients, games)


class Disk(Folder):
    """Folder on a disk that can be full."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.full = False

    def create(self, name: str) -> Any:
        return _Fillable(self, super().create(name))


class _Fillable:
    def __init__(self, disk: Disk, file: Any) -> None:
        self._disk = disk
        self._file = file

    def append(self, data: bytes) -> None:
        if self._disk.full:
            raise OSError(28, "No space left on device")
        self._file.append(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)
