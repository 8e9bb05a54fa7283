"""Who came with which token is in the audit log, once."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from robotouille_server.admin.http.logins import FORGOTTEN_AFTER, REFUSED_A_MINUTE, LoginAudit
from robotouille_server.auth.tokens import Role, RoleGrant
from robotouille_server.runtime.audit_log import AuditLog
from tests.support.operator import GUESS, audited, bearer, viewing
from tests.support.virtual_time import run

NOW = 1_800_000_000.0


@pytest.mark.parametrize("record_addresses", [False, True])
def test_wrong_tokens_are_there_in_few_lines_and_all_counted(
    tmp_path: Path, record_addresses: bool
) -> None:
    tries = 2 * REFUSED_A_MINUTE

    async def main() -> None:
        options = {"tokens": True, "record_addresses": record_addresses}
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

    run(main())


def test_a_token_in_use_is_one_login(tmp_path: Path) -> None:
    now = 0.0
    log = AuditLog(tmp_path / "audit.log", lambda: NOW)
    logins = LoginAudit(log, lambda: now, addresses=True)
    for passed in (0, 1, 1000, 1000, FORGOTTEN_AFTER + 1):
        now += passed
        logins.good(RoleGrant(Role.OPERATOR, "lab", token_id="a"), "127.0.0.1")
    logins.good(RoleGrant(Role.OPERATOR, "lab", token_id="b"), "127.0.0.1")
    lines = [json.loads(line) for line in log.path.read_text().splitlines()]
    assert [line["token"] for line in lines] == ["a", "a", "b"]
