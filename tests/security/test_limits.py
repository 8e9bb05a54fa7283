"""The bucket that meters messages, and the table of limits."""

from __future__ import annotations

import re

from robotouille_server.limit_table import LIMITS, limits_page, shown_value
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.token_bucket import TokenBucket
from tests.docs.pages import read


def test_a_budget_allows_bursts_and_then_its_rate() -> None:
    budget = TokenBucket(10, 0.0)
    assert sum(budget.take(0.0) for _ in range(100)) == 20
    assert not budget.take(0.09)
    assert budget.take(0.11)
    taken = sum(budget.take(0.11 + tick / 1000) for tick in range(10_000))
    assert 99 <= taken <= 101


def test_a_budget_fills_no_higher_than_its_burst() -> None:
    budget = TokenBucket(10, 0.0, burst=3)
    assert budget.left(1e6) == 3
    assert not budget.take(1e6, cost=4)
    assert budget.take(1e6, cost=3)
    assert not budget.take(1e6)


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
