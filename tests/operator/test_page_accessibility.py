"""The operator page in each of its parts: free of faults that axe finds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.operator.visits import browser_page
from tests.support.operator import table, viewing
from tests.web.visits import BROWSER_TEST, axe_faults, expect

pytestmark = BROWSER_TEST

TASK = "multi_agent/01_lettuce_burger"


@pytest.mark.parametrize("scheme", ["light", "dark"])
async def test_all_parts_of_the_page_are_usable(browser: Any, tmp_path: Path, scheme: str) -> None:
    options = {"color_scheme": scheme, "reduced_motion": "reduce"}
    async with viewing(tmp_path) as (server, port, _), table(server, labels={"pair": "p1"}) as game:
        async with browser_page(browser, port.url, **options) as page:
            await page.get_by_role("button", name="Watch").click()
            await expect(page.locator(".watch .log li").first).to_be_visible()
            assert await axe_faults(page) == []
            await page.get_by_role("button", name="Open episodes").click()
            dialog = page.get_by_role("dialog", name="Open episodes")
            await dialog.get_by_role("button", name="Open", exact=True).click()
            await expect(dialog.get_by_text("Choose a task.")).to_be_visible()
            assert await axe_faults(page) == []
            await dialog.get_by_label("Task").fill(TASK)
            await dialog.get_by_label("Seats for bots").fill("1")
            await dialog.get_by_role("button", name="Open", exact=True).click()
            await expect(dialog.locator("h2")).to_have_text("An episode is open")
            assert await axe_faults(page) == []
            await dialog.get_by_role("button", name="Copy all").focus()
            async with page.expect_download():
                await dialog.get_by_role("button", name="Save as CSV").click()
            await dialog.get_by_role("button", name="Close").click()
            server.lobby.rooms[game.episode].abort("enough")
            await page.get_by_role("tab", name="Recordings").click()
            await expect(page.locator(".recording")).to_have_count(2)
            assert await axe_faults(page) == []
