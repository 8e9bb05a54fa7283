"""The tables of limits show every limit of the server."""

from __future__ import annotations

import re

from robotouille_server.runtime.settings import ServerSettings
from tests.support.pages import read
from tests.support.scripts import script_module
from tests.support.sources import ROOT

TABLES = script_module(ROOT / "tools/limit_table.py")
ALL = [limit for limits in TABLES.LIMITS.values() for limit in limits]


def test_every_limit_has_a_value_and_every_limiting_setting_a_line() -> None:
    assert all(re.search(r"\d", TABLES.shown_value(limit)) for limit in ALL)
    listed = {limit.setting for limit in ALL}
    limiting = {
        name
        for name in ServerSettings.model_fields
        if name.startswith("max_") or name.endswith(("_seconds", "_hours", "_per_second"))
    }
    assert limiting <= listed


def test_every_code_is_in_the_protocols_table() -> None:
    documented = set(re.findall(r"^\| `([a-z]+/[a-z-]+)` \|", read("protocol.md"), re.MULTILINE))
    assert {limit.code for limit in ALL if limit.code} <= documented


def test_the_page_has_a_row_for_each_limit() -> None:
    page = TABLES.limit_tables()
    assert page.count("\n| ") == len(ALL) + 2 * len(TABLES.LIMITS)
    assert "| Size of a client's message | 64 KiB |  | The message is refused." in page
    assert "| 2,000 | `--max-episodes` | `create` is refused. | `server/full` |" in page
