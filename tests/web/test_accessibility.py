"""The page in each of its parts: free of faults that axe finds, and whole on small screens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robotouille.protocol import messages
from tests.support.servers import serving
from tests.web.visits import (
    BROWSER_TEST,
    DESKTOP,
    axe_faults,
    expect,
    get_ready,
    link,
    playing,
    visiting,
)

pytestmark = BROWSER_TEST

TASK = "multi_agent/01_lettuce_burger@2"
LONG = "Anna-Magdalena von und zu Hohenstein II"
ZOOMED, NARROW = {"width": 640, "height": 360}, {"width": 360, "height": 740}
"""A window of 1280 × 720 at 200 %, and a small phone."""
LARGE = {"width": 3840, "height": 2160}
STILL: dict[str, Any] = {"reduced_motion": "reduce"}
"""Options without animations: a card that appears has less contrast for a moment."""
CUT = """() => {
  const scrolls = (each) => each.closest("#choices, .unseen, #bubbles, dialog");
  const seen = [...document.querySelectorAll("body *")].filter((each) => !scrolls(each));
  const found = seen.filter((each) => {
    const { left, right, width } = each.getBoundingClientRect();
    const clipped = getComputedStyle(each).overflowX !== "visible";
    const inside = clipped && each.scrollWidth > each.clientWidth + 1;
    return width > 0 && (left < -1 || right > innerWidth + 1 || inside);
  });
  const cover = document.getElementById("cover");
  if (cover.scrollHeight > cover.clientHeight + 1) found.push(cover);
  if (document.documentElement.scrollWidth > innerWidth) found.push(document.documentElement);
  return found.map((each) => each.outerHTML.slice(0, 200));
}"""


async def assert_usable(page: Any) -> None:
    assert await axe_faults(page) == []
    for size in (ZOOMED, NARROW, LARGE, DESKTOP):
        await page.set_viewport_size(size)
        assert await page.evaluate(CUT) == [], size


async def test_all_parts_of_the_page_are_usable(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path, absence="pause", grace=300) as server:
        room = server.lobby.create(messages.Create(task=TASK, clock="realtime", step_rate=5))
        context = await browser.new_context(viewport=DESKTOP)
        page = await context.new_page()
        await page.goto(link(server.port, ""))
        await page.click("#enter-button")
        await expect(page.locator("#enter-fault")).to_be_visible()
        await assert_usable(page)
        await context.close()
        url = link(server.port, room.code)
        async with visiting(browser, url, "Ada", **STILL) as ada:
            await expect(ada.locator("#cover")).to_contain_text("Waiting room")
            await assert_usable(ada)
            async with visiting(browser, url, LONG) as guest:
                for each in (guest, ada):
                    await get_ready(each)
                await guest.locator("#said").fill("n" * 150)
                await guest.keyboard.press("Enter")
                await expect(ada.locator("#lines")).to_contain_text("nnn")
                await expect(ada.locator("#choices li").first).to_be_visible()
                await assert_usable(ada)
                await ada.keyboard.press("h")
                await expect(ada.locator("#help")).to_contain_text("right click")
                await assert_usable(ada)
                await ada.keyboard.press("Escape")
            await expect(ada.locator("#cover")).to_contain_text("lost the connection")
            await assert_usable(ada)
        rules = messages.Create(task=TASK, clock="realtime", step_rate=5, max_steps=2)
        url = link(server.port, server.lobby.create(rules).code)
        async with playing(browser, (url, url), **STILL) as (ada, _):
            await expect(ada.locator("#cover")).to_contain_text("Time is up")
            await assert_usable(ada)
