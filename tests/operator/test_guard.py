"""Who gets to the operator's port: nobody by way of a browser's other pages, nobody without a
token where one is asked for."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_server.admin import operator_view
from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.http.guard import Access
from robotouille_server.auth.tokens import Role, RoleGrant
from tests.support.operator import CHANGE, Api, viewing
from tests.support.servers import serving
from tests.support.virtual_time import run

READING = ["/", "/main.js", "/api/overview", "/api/overview/events", "/api/recordings"]


def authorize(token: str) -> RoleGrant:
    if token != "let-me-in":
        raise ProtocolError("auth/expired", "this token has expired", "token")
    return RoleGrant(Role.OPERATOR, "lab")


def asked(tmp_path: Path, ask: Callable[[Api], Any], **view: Any) -> None:
    async def main() -> None:
        async with viewing(tmp_path, view=view) as (_, _, api):
            await ask(api)

    run(main())


def refusal(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["code"]


@pytest.mark.parametrize(
    "host", ["kitchen.example.org", "127.0.0.1.example.org:80", "", "[::2]", "a@localhost"]
)
def test_another_name_in_host_is_refused(tmp_path: Path, host: str) -> None:
    async def ask(api: Api) -> None:
        for path in READING:
            answer = await api.http.get(path, headers={"Host": host})
            assert refusal(answer) == (421, "host/unknown"), path

    asked(tmp_path, ask)


def test_names_of_this_machine_and_allowed_ones_are_taken(tmp_path: Path) -> None:
    async def ask(api: Api) -> None:
        for host in ("localhost:8766", "127.0.0.1", "LOCALHOST", "[::1]:99", "Kitchen.example.org"):
            answer = await api.http.get("/api/overview", headers={"Host": host})
            assert answer.status_code == 200, host

    asked(tmp_path, ask, allowed_hosts=["kitchen.EXAMPLE.org"])


@pytest.mark.parametrize(
    ("headers", "status", "code"),
    [
        ({"Content-Type": "application/json"}, 403, "request/header"),
        ({**CHANGE, "Content-Type": "text/plain"}, 415, "request/type"),
        ({**CHANGE, "Content-Type": "application/x-www-form-urlencoded"}, 415, "request/type"),
        (CHANGE, 415, "request/type"),
        (
            {**CHANGE, "Content-Type": "application/json", "Origin": "https://evil.example"},
            403,
            "request/origin",
        ),
        ({**CHANGE, "Content-Type": "application/json", "Origin": "null"}, 403, "request/origin"),
    ],
)
def test_what_another_page_could_send_changes_nothing(
    tmp_path: Path, headers: dict[str, str], status: int, code: str
) -> None:
    async def ask(api: Api) -> None:
        content = b'{"text": "boo"}'
        answer = await api.http.post("/api/announce", content=content, headers=headers)
        assert refusal(answer) == (status, code)

    asked(tmp_path, ask)


def test_a_page_may_not_ask_the_browser_for_permission(tmp_path: Path) -> None:
    async def ask(api: Api) -> None:
        answer = await api.http.options(
            "/api/announce",
            headers={"Origin": "https://evil.example", "Access-Control-Request-Method": "POST"},
        )
        assert answer.status_code >= 400
        assert not [name for name in answer.headers if name.startswith("access-control")]

    asked(tmp_path, ask)


def test_the_ports_own_page_may(tmp_path: Path) -> None:
    async def ask(api: Api) -> None:
        origin = str(api.http.base_url).rstrip("/")
        headers = {**CHANGE, "Origin": origin, "Content-Type": "application/json; charset=utf-8"}
        content = b'{"text": "dinner"}'
        answer = await api.http.post("/api/announce", content=content, headers=headers)
        assert answer.status_code == 200

    asked(tmp_path, ask)


def test_bodies_are_small_and_say_how_long_they_are(tmp_path: Path) -> None:
    async def pieces() -> Any:
        yield b'{"text": "x"}'

    async def ask(api: Api) -> None:
        headers = {**CHANGE, "Content-Type": "application/json"}
        for content in (b" " * 20_000, pieces()):
            answer = await api.http.post("/api/announce", content=content, headers=headers)
            assert refusal(answer) == (413, "request/size")

    asked(tmp_path, ask)


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("length", [{}, {"Content-Length": "2"}])
def test_a_body_in_chunks_has_no_end_and_is_refused(
    tmp_path: Path, method: str, length: dict[str, str]
) -> None:
    async def ask(api: Api) -> None:
        headers = {**CHANGE, "Content-Type": "application/json", "Transfer-Encoding": "chunked"}

        async def chunks() -> AsyncIterator[bytes]:
            yield b'{"text": "' + b"x" * 100_000 + b'"}'

        path = "/api/announce" if method == "POST" else "/api/overview"
        request = api.http.build_request(method, path, content=chunks(), headers=headers)
        request.headers.update(length)
        assert refusal(await api.http.send(request)) == (413, "request/size")

    asked(tmp_path, ask)


def test_what_only_asks_has_no_large_body_either(tmp_path: Path) -> None:
    async def ask(api: Api) -> None:
        answer = await api.http.request("GET", "/api/overview", content=b"x" * 20_000)
        assert refusal(answer) == (413, "request/size")

    asked(tmp_path, ask)


def test_every_answer_forbids_others_to_show_or_read_it(tmp_path: Path) -> None:
    async def ask(api: Api) -> None:
        refused = {"Host": "evil.example"}
        answers = [await api.http.get(path) for path in ("/", "/api/overview", "/nothing")]
        answers.append(await api.http.get("/", headers=refused))
        for answer in answers:
            policy = answer.headers["content-security-policy"]
            assert "default-src 'none'" in policy
            assert "frame-ancestors 'none'" in policy
            assert "unsafe" not in policy
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert answer.headers["cross-origin-resource-policy"] == "same-origin"
            assert answer.headers["referrer-policy"] == "no-referrer"
            assert "server" not in answer.headers
        assert answers[1].headers["cache-control"] == "no-store"

    asked(tmp_path, ask)


def test_the_page_has_no_inline_scripts_or_styles_and_nothing_from_elsewhere(
    tmp_path: Path,
) -> None:
    async def ask(api: Api) -> None:
        html = (await api.http.get("/")).text
        assert "<style" not in html
        assert " style=" not in html
        assert " onclick" not in html
        assert "<script>" not in html
        assert "://" not in html

    asked(tmp_path, ask)


def test_a_token_is_asked_for_where_that_is_set(tmp_path: Path) -> None:
    async def ask(api: Api) -> None:
        for headers, code in [
            ({}, "auth/needed"),
            ({"Authorization": "Basic bGV0LW1lLWlu"}, "auth/needed"),
            ({"Authorization": "Bearer"}, "auth/needed"),
            ({"Authorization": "Bearer guessed"}, "auth/expired"),
        ]:
            for path in ("/api/overview", "/api/recordings", "/api/openapi.json"):
                answer = await api.http.get(path, headers=headers)
                assert refusal(answer) == (401, code)
                assert answer.headers["www-authenticate"].startswith("Bearer")
            change = {**CHANGE, **headers}
            answer = await api.http.post("/api/announce", json={"text": "x"}, headers=change)
            assert refusal(answer) == (401, code)
        headers = {"Authorization": "Bearer let-me-in"}
        assert (await api.http.get("/api/overview", headers=headers)).status_code == 200
        assert (await api.http.get("/")).status_code == 200

    asked(tmp_path, ask, authorize=authorize, ask_token=True)


def test_whoever_comes_through_a_proxy_needs_a_token_even_on_loopback(tmp_path: Path) -> None:
    async def without_tokens(api: Api) -> None:
        for name in ("Forwarded", "X-Forwarded-For", "Via"):
            answer = await api.http.get("/api/overview", headers={name: "203.0.113.7"})
            assert refusal(answer) == (403, "auth/forwarded")
        assert (await api.http.get("/api/overview")).status_code == 200

    async def with_tokens(api: Api) -> None:
        headers = {"X-Forwarded-For": "203.0.113.7"}
        assert refusal(await api.http.get("/api/overview", headers=headers)) == (401, "auth/needed")
        headers["Authorization"] = "Bearer let-me-in"
        assert (await api.http.get("/api/overview", headers=headers)).status_code == 200
        assert (await api.http.get("/api/overview")).status_code == 200

    asked(tmp_path / "one", without_tokens)
    asked(tmp_path / "two", with_tokens, authorize=authorize)


def test_no_port_for_others_without_tokens(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            with pytest.raises(RobotouilleError, match=r"0\.0\.0\.0 needs operator's tokens"):
                async with operator_view(server, "0.0.0.0", 0):
                    pass
            async with operator_view(server, "0.0.0.0", 0, authorize=authorize) as port:
                assert port.url == f"http://127.0.0.1:{port.port}/"
                async with httpx.AsyncClient(timeout=None, trust_env=False, verify=False) as http:
                    answer = await http.get(f"{port.url}api/overview")
                    assert refusal(answer) == (401, "auth/needed")

    run(main())


def scope(host: str, own: str) -> dict[str, Any]:
    return {
        "type": "http", "method": "GET", "path": "/", "server": (own, 8766),
        "headers": [(b"host", host.encode())],
    }  # fmt: skip


def test_the_address_a_request_came_to_is_a_name_of_the_port() -> None:
    access = Access()
    access.check(scope("192.0.2.7:8766", "192.0.2.7"))
    with pytest.raises(RequestRefusedError):
        access.check(scope("192.0.2.8:8766", "192.0.2.7"))


def test_two_hosts_are_one_too_many() -> None:
    request = scope("localhost", "127.0.0.1")
    request["headers"].append((b"host", b"evil.example"))
    with pytest.raises(RequestRefusedError):
        Access().check(request)
