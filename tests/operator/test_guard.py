"""Access to the operator port: foreign pages, tokens, proxies, body limits and login audit."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_server.auth import Role, RoleGrant
from robotouille_server.operator import load, operator_view
from robotouille_server.operator.guard import FORGOTTEN_AFTER, REFUSED_A_MINUTE, Access, LoginAudit
from robotouille_server.operator.load import HEAVY_JOBS, MAX_WAITING_JOBS, HeavyJobs
from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.runtime.logs import AuditLog
from tests.support.operator import CHANGE, GUESS, audited, bearer, viewing
from tests.support.servers import serving
from tests.support.virtual_time import virtual

READING = ["/", "/main.js", "/api/overview", "/api/overview/events", "/api/recordings"]


def authorize(token: str) -> RoleGrant:
    if token != "let-me-in":
        raise ProtocolError("auth/expired", "this token has expired", "token")
    return RoleGrant(Role.OPERATOR, "lab")


def refusal(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["code"]


@pytest.mark.parametrize(
    "host",
    ["kitchen.example.org", "127.0.0.1.example.org:80", "", "[::2]", "a@localhost",
     "localhost:1@evil.example", "[::1]evil.example"],
)  # fmt: skip
@virtual
async def test_foreign_host_is_refused(tmp_path: Path, host: str) -> None:
    async with viewing(tmp_path) as (_, _, api):
        for path in READING:
            answer = await api.http.get(path, headers={"Host": host})
            assert refusal(answer) == (421, "host/unknown"), path


@virtual
async def test_local_and_allowed_hosts_are_accepted(tmp_path: Path) -> None:
    async with viewing(tmp_path, view={"allowed_hosts": ["kitchen.EXAMPLE.org"]}) as (_, _, api):
        for host in ("localhost:8766", "127.0.0.1", "LOCALHOST", "[::1]:99", "Kitchen.example.org"):
            answer = await api.http.get("/api/overview", headers={"Host": host})
            assert answer.status_code == 200, host


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
@virtual
async def test_request_that_a_foreign_page_could_send_is_refused(
    tmp_path: Path, headers: dict[str, str], status: int, code: str
) -> None:
    async with viewing(tmp_path) as (_, _, api):
        content = b'{"text": "boo"}'
        answer = await api.http.post("/api/announce", content=content, headers=headers)
        assert refusal(answer) == (status, code)


@virtual
async def test_requests_of_other_sites_do_not_use_up_the_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load, "REQUESTS_BURST", 10.0)
    async with viewing(tmp_path) as (_, _, api):
        for site in ["cross-site", "same-site"] * 20:
            answer = await api.http.get("/api/overview", headers={"Sec-Fetch-Site": site})
            assert refusal(answer) == (403, "request/origin")
        for site in ("same-origin", "none"):
            answer = await api.http.get("/api/overview", headers={"Sec-Fetch-Site": site})
            assert answer.status_code == 200
        # A link to the operator's page may stand anywhere.
        assert (await api.http.get("/", headers={"Sec-Fetch-Site": "cross-site"})).is_success


@virtual
async def test_cors_preflight_is_refused(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        answer = await api.http.options(
            "/api/announce",
            headers={"Origin": "https://evil.example", "Access-Control-Request-Method": "POST"},
        )
        assert answer.status_code >= 400
        assert not [name for name in answer.headers if name.startswith("access-control")]


@virtual
async def test_own_page_may_change_something(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        origin = str(api.http.base_url).rstrip("/")
        headers = {**CHANGE, "Origin": origin, "Content-Type": "application/json; charset=utf-8"}
        content = b'{"text": "dinner"}'
        answer = await api.http.post("/api/announce", content=content, headers=headers)
        assert answer.status_code == 200


@virtual
async def test_large_body_is_refused(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        headers = {**CHANGE, "Content-Type": "application/json"}
        content = b" " * 20_000
        answer = await api.http.post("/api/announce", content=content, headers=headers)
        assert refusal(answer) == (413, "request/size")


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("length", [{}, {"Content-Length": "2"}])
@virtual
async def test_chunked_body_is_refused(tmp_path: Path, method: str, length: dict[str, str]) -> None:
    async with viewing(tmp_path) as (_, _, api):
        headers = {**CHANGE, "Content-Type": "application/json", "Transfer-Encoding": "chunked"}

        async def chunks() -> AsyncIterator[bytes]:
            yield b"{}"

        path = "/api/announce" if method == "POST" else "/api/overview"
        request = api.http.build_request(method, path, content=chunks(), headers=headers)
        request.headers.update(length)
        assert (await api.http.send(request)).status_code == 400


@virtual
async def test_all_responses_forbid_framing_and_reading_by_other_sites(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
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


@virtual
async def test_missing_or_invalid_token_is_refused(tmp_path: Path) -> None:
    async with viewing(tmp_path, view={"authorize": authorize, "ask_token": True}) as (_, _, api):
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


@virtual
async def test_request_through_a_proxy_is_refused_without_tokens(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        for name in ("Forwarded", "X-Forwarded-For", "Via"):
            answer = await api.http.get("/api/overview", headers={name: "203.0.113.7"})
            assert refusal(answer) == (403, "auth/forwarded")
        assert (await api.http.get("/api/overview")).status_code == 200


@virtual
async def test_request_through_a_proxy_needs_a_token_even_on_loopback(tmp_path: Path) -> None:
    async with viewing(tmp_path, view={"authorize": authorize}) as (_, _, api):
        headers = {"X-Forwarded-For": "203.0.113.7"}
        assert refusal(await api.http.get("/api/overview", headers=headers)) == (401, "auth/needed")
        headers["Authorization"] = "Bearer let-me-in"
        assert (await api.http.get("/api/overview", headers=headers)).status_code == 200
        assert (await api.http.get("/api/overview")).status_code == 200


@virtual
async def test_public_address_requires_tokens(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        with pytest.raises(RobotouilleError, match=r"0\.0\.0\.0 needs operator tokens"):
            async with operator_view(server, "0.0.0.0", 0):
                pass
        async with operator_view(server, "0.0.0.0", 0, authorize=authorize) as port:
            assert port.url == f"http://127.0.0.1:{port.port}/"
            async with httpx.AsyncClient(timeout=None, trust_env=False, verify=False) as http:
                answer = await http.get(f"{port.url}api/overview")
                assert refusal(answer) == (401, "auth/needed")


def scope(host: str, own: str) -> dict[str, Any]:
    return {
        "type": "http", "method": "GET", "path": "/", "server": (own, 8766),
        "headers": [(b"host", host.encode())],
    }  # fmt: skip


def test_own_address_is_an_allowed_host() -> None:
    access = Access()
    access.check(scope("192.0.2.7:8766", "192.0.2.7"))
    with pytest.raises(RequestRefusedError):
        access.check(scope("192.0.2.8:8766", "192.0.2.7"))


def test_two_host_headers_are_refused() -> None:
    request = scope("localhost", "127.0.0.1")
    request["headers"].append((b"host", b"evil.example"))
    with pytest.raises(RequestRefusedError):
        Access().check(request)


NOW = 1_800_000_000.0


@pytest.mark.slow
@pytest.mark.parametrize("record_addresses", [False, True])
@virtual
async def test_invalid_tokens_are_counted_in_few_audit_lines(
    tmp_path: Path, record_addresses: bool
) -> None:
    tries = 2 * REFUSED_A_MINUTE
    options: dict[str, Any] = {"tokens": True, "record_addresses": record_addresses}
    async with viewing(tmp_path / "r", **options) as (server, _, api):
        assert (await api.http.get("/api/overview")).status_code == 401
        for _ in range(tries):
            assert (await api.http.get("/api/overview", headers=GUESS)).status_code == 401
        await asyncio.sleep(7)
        for _ in range(2):
            await api.get("/api/overview", headers=bearer(server))
    lines = audited(tmp_path / "r")
    refused = [line for line in lines if line["result"] != "done"]
    assert {line["result"] for line in refused} == {"auth/invalid", "refused"}
    assert len(refused) <= REFUSED_A_MINUTE + 4
    once = sum(line["result"] == "auth/invalid" for line in refused)
    assert once + sum(line.get("left_out", 0) for line in refused) == tries
    assert not any("guess" in json.dumps(line) for line in lines)
    assert {line.get("address") for line in refused if line["result"] != "refused"} == {
        "127.0.0.1" if record_addresses else None
    }
    assert sum(line["what"] == "login" and line["result"] == "done" for line in lines) == 2


def test_token_in_use_is_one_login(tmp_path: Path) -> None:
    now = 0.0
    log = AuditLog(tmp_path / "audit.log", lambda: NOW)
    logins = LoginAudit(log, lambda: now, addresses=True)
    for passed in (0, 1, 1000, 1000, FORGOTTEN_AFTER + 1):
        now += passed
        logins.accepted(RoleGrant(Role.OPERATOR, "lab", token_id="a"), "127.0.0.1")
    logins.accepted(RoleGrant(Role.OPERATOR, "lab", token_id="b"), "127.0.0.1")
    lines = [json.loads(line) for line in log.path.read_text().splitlines()]
    assert [line["token"] for line in lines] == ["a", "a", "b"]


@virtual
async def test_requests_are_limited_per_subject(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load, "REQUESTS_BURST", 5)
    async with viewing(tmp_path) as (_, _, api):
        for _ in range(5):
            await api.get("/api/overview?limit=1")
        answer = await api.http.get("/api/overview?limit=1")
        assert (answer.status_code, answer.json()["code"]) == (429, "operator/rate")
        assert answer.headers["retry-after"] == "1"
        assert (await api.http.get("/")).status_code == 200
        await asyncio.sleep(1)
        await api.get("/api/overview?limit=1")


@virtual
async def test_other_subjects_have_their_own_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load, "REQUESTS_BURST", 5)
    async with viewing(tmp_path, tokens=True) as (server, _, api):
        ada, bob = bearer(server, "ada"), bearer(server, "bob")
        for _ in range(5):
            await api.get("/api/overview?limit=1", headers=ada)
        assert (await api.http.get("/api/overview?limit=1", headers=ada)).status_code == 429
        await api.get("/api/overview?limit=1", headers=bob)


async def test_two_heavy_jobs_run_at_a_time_and_only_some_wait() -> None:
    jobs, go, lock = HeavyJobs(), threading.Event(), threading.Lock()
    begun = threading.Barrier(HEAVY_JOBS + 1, timeout=30)
    running = most = 0

    def work() -> None:
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
        if not go.is_set():
            begun.wait()
        go.wait(30)
        with lock:
            running -= 1

    accepted = [asyncio.create_task(jobs.run(work)) for _ in range(HEAVY_JOBS + MAX_WAITING_JOBS)]
    await asyncio.sleep(0)
    with pytest.raises(RequestRefusedError) as refused:
        await jobs.run(work)
    assert (refused.value.status, refused.value.retry_seconds) == (503, 1)
    await asyncio.to_thread(begun.wait)
    accepted[0].cancel()  # Its thread keeps the place.
    go.set()
    await asyncio.gather(*accepted, return_exceptions=True)
    await jobs.run(work)
    assert most == HEAVY_JOBS
