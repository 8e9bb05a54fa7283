"""The waiting room, the kitchen and the orders, as players see them without scrolling."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from robotouille.domain.rendering import language_of
from robotouille.episode import Clock
from robotouille.episode.presence import LOBBY_SECONDS
from robotouille.protocol import messages
from robotouille.world.presentation.wording import Wording
from tests.support.servers import serving
from tests.web.visits import BROWSER_TEST, expect, get_ready, link, visiting

pytestmark = BROWSER_TEST

SIZE = "(({ clientWidth, clientHeight }) => [clientWidth, clientHeight])(kitchen)"
HIDDEN = """() => {
  const { bottom } = document.getElementById("ticket").getBoundingClientRect();
  const orders = [...document.querySelectorAll(".order")];
  return orders.filter((each) => each.getBoundingClientRect().bottom > bottom + 1).length;
}"""
"""Returns the number of orders that are cut off."""
BELOW_PAGE = "document.documentElement.scrollHeight - innerHeight"
"""Returns the pixels by which the page scrolls."""
AT_NOTICE = """() => {
  const { x, y, width, height } = document.getElementById("notice").getBoundingClientRect();
  return document.elementFromPoint(x + width / 2, y + height / 2).id;
}"""
"""Returns the element that a click on the notice reaches."""


@pytest.mark.parametrize(("grace", "minutes"), [(60, LOBBY_SECONDS / 60), (1200, 20)])
async def test_waiting_room_shows_the_time_waited_and_when_it_closes(
    browser: Any, tmp_path: Path, grace: int, minutes: float
) -> None:
    async with serving(tmp_path, grace=grace) as server:
        room = server.lobby.create(messages.Create(task="multi_agent/01@2", clock=Clock.REALTIME))
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            cover = page.locator("#cover")
            await expect(cover).to_contain_text(re.compile(r"1 more player · 0:0[1-9] so far"))
            await expect(cover).to_contain_text(f"{minutes:g} minutes after the last one has left")
            await expect(cover).to_contain_text(f"your seat is kept for {grace} s")


async def test_waiting_room_names_the_points_of_stars_and_invites_only_to_free_seats(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task="shifts/01@2", clock=Clock.REALTIME))
        address = link(server.port, room.code)
        async with visiting(browser, address, "Ada") as page:
            cover = page.locator("#cover")
            points = re.compile(r"One star needs \d+ points, two need \d+, three need \d+")
            await expect(cover).to_contain_text(points)
            await expect(cover).to_contain_text(re.compile(r"The shift lasts \d+:\d\d"))
            await expect(cover).to_contain_text(f"Others join with the code {room.code}")
            async with visiting(browser, address, "Ben"):
                await expect(cover).to_contain_text("Ben")
                await expect(cover).not_to_contain_text("Others join")
                await expect(page.get_by_role("button", name="Copy the link")).to_have_count(0)


async def test_kitchen_keeps_its_size_and_newcomers_learn_how_to_walk(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task="training/01", clock=Clock.LOCKSTEP))
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            await expect(page.locator("#cover")).to_contain_text("Waiting room")
            before = await page.evaluate(SIZE)
            await get_ready(page)
            await expect(page.locator("#choices li").first).to_be_visible()
            await expect(page.locator("#hint")).to_contain_text("walk to the next station")
            assert await page.evaluate(SIZE) == before


async def test_waiting_room_of_a_shift_says_what_the_stations_are_for(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task="shifts/01@2", clock=Clock.REALTIME))
        language = language_of(room.world.task)
        uses = Wording(room.world, language).purposes()
        assert {"crate", "bin", "board"} <= {kind for kind, _ in uses}
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            rows = page.locator("#cover .purposes li")
            await expect(rows).to_have_text([f"{kind.capitalize()}{use}" for kind, use in uses])
            assert await page.evaluate(BELOW_PAGE) == 0


async def test_repeated_line_of_chat_is_shown_once(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task="training/01", clock=Clock.LOCKSTEP))
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            for said in ("I need it", "wait", "I need it"):
                await page.fill("#said", said)
                await page.press("#said", "Enter")
            await expect(page.locator("#lines p")).to_have_text(["Ada: wait", "Ada: I need it ×2"])


async def test_three_orders_are_visible_at_720_pixels(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        create = messages.Create(task="shifts/01@1", clock=Clock.REALTIME, step_rate=40)
        room = server.lobby.create(create)
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            await get_ready(page)
            await expect(page.locator(".order")).to_have_count(3)
            assert await page.evaluate(HIDDEN) == 0


async def test_long_chat_takes_no_room_from_the_orders(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        create = messages.Create(task="shifts/01@1", clock=Clock.REALTIME, step_rate=40)
        room = server.lobby.create(create)
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            for number in range(8):
                await page.fill("#said", f"line {number}: " + "I need the hatch, please. " * 6)
                await page.press("#said", "Enter")
            await expect(page.locator("#lines")).to_contain_text("line 7")
            await get_ready(page)
            await expect(page.locator(".order")).to_have_count(3)
            assert await page.evaluate(HIDDEN) == 0
            assert await page.evaluate(BELOW_PAGE) == 0
            await expect(page.locator("#said")).to_be_in_viewport(ratio=1)
            await expect(page.locator("#lines p").last).to_be_in_viewport(ratio=0.9)


async def test_click_on_a_notice_reaches_the_station_below_it(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task="training/01", clock=Clock.LOCKSTEP))
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            await get_ready(page)
            await page.focus("#kitchen")
            await page.keyboard.press("e")
            await expect(page.locator("#notice")).to_contain_text("Nothing to do")
            assert await page.evaluate(AT_NOTICE) == "kitchen"
