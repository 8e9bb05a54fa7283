"""Audit log of the operator API."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from robotouille_server.operator.service import MAX_NOTED_NAME
from robotouille_server.runtime import logs
from robotouille_server.runtime.logs import AuditLog
from tests.support.operator import CHANGE, audited, bearer, table, viewing
from tests.support.virtual_time import virtual

NOW = 1_800_000_000.0


@virtual
async def test_all_operator_actions_are_logged_with_the_subject(tmp_path: Path) -> None:
    async with viewing(tmp_path / "r", tokens=True, wall=lambda: NOW) as (server, _, api):
        async with table(server) as play:
            await play.until(lambda game: game.step >= 1)
            headers = bearer(server, "lab")
            token = server.authorize(headers["Authorization"].split()[1]).token_id
            api.http.headers.update(headers)
            here = f"/api/episodes/{play.code}"
            await api.do(f"{here}/pause")
            await api.do(f"{here}/announce", text="soon")
            await api.do("/api/announce", text="to all")
            row = await api.row(play.episode)
            name = row["recording"]["name"]
            await api.http.get(f"/api/recordings/{name}")
            session = row["seats"][1]["session"]
            await api.do(f"{here}/kick", session=session, reason="asleep")
            await api.do(f"{here}/end", reason="lunch")
            await api.post(f"{here}/pause")
            await api.post("/api/episodes/NOSUCHCODE/end")
    mine = {"time": "2027-01-15T08:00:00.000Z", "by": "lab", "token": token}
    it = {"episode": play.episode}
    assert audited(tmp_path / "r") == [
        {**mine, "what": "login", "result": "done"},
        {**mine, **it, "what": "pause", "result": "done"},
        {**mine, **it, "what": "announce", "text": "soon", "result": "done"},
        {**mine, "what": "announce to all", "text": "to all", "result": "done"},
        {**mine, "what": "recording", "file": name, "result": "done"},
        {**mine, **it, "what": "kick", "result": "done", "session": session, "reason": "asleep"},
        {**mine, **it, "what": "end", "reason": "lunch", "result": "done"},
        {**mine, "episode": play.code, "what": "pause", "result": "episode/ended"},
        {**mine, "episode": "NOSUCHCODE", "what": "end", "result": "episode/unknown"},
    ]


@virtual
async def test_caller_without_token_is_logged_as_local(tmp_path: Path) -> None:
    async with viewing(tmp_path / "r") as (_, _, api):
        await api.do("/api/announce", text="hello")
    (line,) = audited(tmp_path / "r")
    assert (line["by"], line["what"], "token" in line) == ("local", "announce to all", False)


@virtual
async def test_refused_requests_for_another_episode_are_logged(tmp_path: Path) -> None:
    async with viewing(tmp_path / "r", tokens=True) as (server, _, api):
        async with table(server) as mine, table(server) as other:
            api.http.headers.update(bearer(server, "eve", episode=mine.episode))
            await api.post("/api/announce", text="boo")
            await api.http.get(f"/api/episodes/{other.code}")
    _, *lines = audited(tmp_path / "r")
    assert [(line["what"], line["result"]) for line in lines] == [
        ("announce to all", "auth/episode"),
        ("episode", "auth/episode"),
    ]


@virtual
async def test_refused_request_with_a_long_path_writes_a_short_line(tmp_path: Path) -> None:
    async with viewing(tmp_path / "r") as (_, _, api):
        await api.post(f"/api/episodes/{'x' * 12_000}/pause")
    (line,) = audited(tmp_path / "r")
    assert (line["result"], line["episode"]) == ("episode/unknown", "x" * MAX_NOTED_NAME)


@virtual
async def test_unwritable_audit_log_is_an_alert(tmp_path: Path) -> None:
    async with viewing(tmp_path / "r") as (server, _, api):
        (tmp_path / "elsewhere").mkdir()
        server.audit.path.parent.mkdir(exist_ok=True)
        server.audit.path.symlink_to(tmp_path / "elsewhere" / "file")
        await api.http.post("/api/announce", json={"text": "hello"}, headers=CHANGE)
        seen = await api.get("/api/overview")
        (alert,) = [one for one in seen["alerts"] if one["kind"] == "audit"]
        assert (alert["severity"], "audit log" in alert["text"]) == ("critical", True)
        assert not (tmp_path / "elsewhere" / "file").exists()
        server.audit.path.unlink()
        await api.do("/api/announce", text="hello")
        kinds = {one["kind"] for one in (await api.get("/api/overview"))["alerts"]}
        assert "audit" not in kinds


def test_large_audit_log_is_rotated_and_the_oldest_file_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "MAX_AUDIT_BYTES", 300)
    log = AuditLog(tmp_path / "audit.log", lambda: NOW)
    for number in range(60):
        log.note("announce", by="lab", details={"number": number})
    files = sorted(tmp_path.iterdir())
    assert len(files) == 1 + logs.KEPT_FILES
    assert all(file.stat().st_size < 600 for file in files)
    lines = [json.loads(line) for file in files for line in file.read_text().splitlines()]
    numbers = sorted(line["number"] for line in lines)
    assert numbers == list(range(numbers[0], 60))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
def test_pipe_without_a_reader_does_not_stop_the_server(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "audit.log", 0o600)
    log = AuditLog(tmp_path / "audit.log", lambda: NOW)
    log.note("pause", by="lab")
    assert log.problem.startswith("the audit log cannot be written")
