"""The table of limits says what is in force."""

from __future__ import annotations

import re

from robotouille_server.limit_table import LIMITS, limits_page, shown_value
from robotouille_server.runtime.settings import ServerSettings
from tests.support.pages import read

ALL = [limit for limits in LIMITS.values() for limit in limits]


def test_every_limit_has_a_value_and_every_limiting_setting_a_line() -> None:
    assert all(re.search(r"\d", shown_value(limit)) for limit in ALL)
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
    page = limits_page()
    assert page.count("\n| ") == len(ALL) + 2 * len(LIMITS)
    assert "| a client's message | 64 KiB |  | refused; beyond twice" in page
    assert "| 2,000 | `--max-episodes` | `create` is refused | `server/full` |" in page
