"""The port comes and goes with the server and leaves nothing behind."""

from __future__ import annotations

import asyncio
import builtins
import signal
import socket
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille.errors import MissingExtraError
from robotouille_server.admin import operator_view
from robotouille_server.admin.http.event_streams import MAX_STREAMS
from robotouille_server.app import CannotListenError
from tests.support.operator import table, viewing
from tests.support.servers import serving
from tests.support.virtual_time import run


def test_it_stops_while_pages_are_open_and_leaves_no_task_and_no_socket(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            before = asyncio.all_tasks()
            http = httpx.AsyncClient(timeout=None, trust_env=False, verify=False)
            async with operator_view(server, port=0) as port:
                streams = [
                    await http.send(
                        http.build_request("GET", f"{port.url}api/overview/events"), stream=True
                    )
                    for _ in range(3)
                ]
                assert {answer.status_code for answer in streams} == {200}
            for answer in streams:
                rest = [line async for line in answer.aiter_lines()]
                assert rest[0].startswith("data: ")
            assert asyncio.all_tasks() == before
            with pytest.raises(httpx.ConnectError):
                await http.get(port.url)
            await http.aclose()
            async with operator_view(server, port=port.port) as again:
                assert again.port == port.port

    run(main())


def test_its_address_is_good_from_the_moment_it_is_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, operator_view(server, port=0) as port:
            with socket.create_connection(("127.0.0.1", port.port), timeout=5) as visitor:
                assert visitor.getpeername()[1] == port.port

    run(main())


def test_it_stops_when_what_runs_within_it_fails(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            before = asyncio.all_tasks()
            with pytest.raises(ZeroDivisionError):
                async with operator_view(server, port=0):
                    raise ZeroDivisionError
            assert asyncio.all_tasks() == before

    run(main())


def test_signals_stay_the_programs(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
            async with operator_view(server, port=0) as port:
                async with httpx.AsyncClient(timeout=None, trust_env=False, verify=False) as http:
                    assert (await http.get(port.url)).status_code == 200
                assert handlers == [
                    signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)
                ]

    run(main())


def test_a_port_in_use_is_named(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            with socket.create_server(("127.0.0.1", 0)) as taken:
                number = taken.getsockname()[1]
                with pytest.raises(CannotListenError, match=f"127.0.0.1:{number}: Address already"):
                    async with operator_view(server, port=number):
                        pass

    run(main())


@pytest.mark.parametrize("library", ["fastapi", "uvicorn"])
def test_without_its_libraries_it_says_how_to_get_them(
    tmp_path: Path, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without(name: str, *arguments: Any, **options: Any) -> Any:
        if name.partition(".")[0] == library:
            raise ImportError(name)
        return real(name, *arguments, **options)

    async def main() -> None:
        async with serving(tmp_path) as server:
            monkeypatch.setattr(builtins, "__import__", without)
            with pytest.raises(MissingExtraError, match=r"pip install 'robotouille\[operator\]'"):
                async with operator_view(server, port=0):
                    pass

    run(main())


def test_too_many_pages_are_refused_and_one_that_closes_makes_room(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (_, _, api):
            request = api.http.build_request("GET", "/api/overview/events")
            streams = [await api.http.send(request, stream=True) for _ in range(MAX_STREAMS)]
            for stream in streams:
                await anext(stream.aiter_lines())
            answer = await api.http.get("/api/overview/events")
            assert (answer.status_code, answer.json()["code"]) == (503, "operator/busy")
            await streams[0].aclose()
            await asyncio.sleep(2)
            again = await api.http.send(request, stream=True)
            assert again.status_code == 200
            for stream in [*streams, again]:
                await stream.aclose()

    run(main())


def test_the_games_do_not_notice_a_view_that_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from robotouille_server.admin.admin_service import AdminService

    def fail(*arguments: object) -> None:
        raise ZeroDivisionError

    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:
            monkeypatch.setattr(AdminService, "overview", fail)
            answer = await api.http.get("/api/overview")
            assert (answer.status_code, answer.json()["code"]) == (500, "operator/internal")
            assert "ZeroDivision" not in answer.text
            await play.until(lambda game: game.step >= 5)

    run(main())
