"""The form that opens episodes, in a real browser."""

from __future__ import annotations

import asyncio
import csv
import re
import shlex
import sys
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.protocol import messages
from robotouille_client import connect
from robotouille_server.auth import Role
from robotouille_server.operator.serving import operator_view
from tests.operator.visits import DESKTOP, browser_page
from tests.support.operator import viewing
from tests.support.servers import serving
from tests.web.visits import BROWSER_TEST, PHONE, expect, visiting

pytestmark = BROWSER_TEST

TASK = "multi_agent/01_lettuce_burger"


async def opened_form(page: Any) -> Any:
    await page.get_by_role("button", name="Open episodes").click()
    dialog = page.get_by_role("dialog", name="Open episodes")
    await expect(dialog.get_by_label("Task")).to_be_focused()
    return dialog


async def saved_rows(page: Any, dialog: Any) -> list[dict[str, str]]:
    async with page.expect_download() as download:
        await dialog.get_by_role("button", name="Save as CSV").click()
    saved = await download.value
    assert saved.suggested_filename == "opened.csv"
    text = Path(await saved.path()).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


async def test_links_of_the_table_lead_players_and_bots_into_their_seats(
    browser: Any, tmp_path: Path
) -> None:
    async with viewing(tmp_path, require_token=True, tokens=True) as (server, port, _):
        token = server.tokens.mint_role(Role.OPERATOR, "lab", seconds=3600)
        async with browser_page(browser, port.url, allow="401") as page:
            await page.get_by_label("Token").fill(token)
            await page.get_by_role("button", name="Sign in").click()
            dialog = await opened_form(page)
            await dialog.get_by_label("Task").fill(TASK)
            await dialog.get_by_label("Episodes").fill("3")
            await dialog.get_by_label("Steps per second").fill("5")
            await dialog.get_by_label("When a player is away").select_option("pause")
            await dialog.get_by_label("Seats for bots").fill("1")
            await dialog.get_by_label("Skill of bots").select_option("expert")
            await dialog.get_by_label("Labels").fill("condition=novice, pair=p1")
            await dialog.get_by_role("button", name="Open", exact=True).click()
            await expect(dialog.locator("h2")).to_have_text("3 episodes are open")
            await expect(page.locator(".episode")).to_have_count(3)
            await expect(page.locator(".episode").first).to_contain_text("novice")
            rows = await saved_rows(page, dialog)
            assert [row["code"] for row in rows] == [r.code for r in server.lobby.rooms.values()]
            room = server.lobby.rooms[rows[1]["episode"]]
            rules = room.episode.rules
            assert (rules.clock, rules.step_rate, rules.absence) == ("realtime", 5.0, "pause")
            assert room.labels == {"condition": "novice", "pair": "p1"}
            assert rows[1]["label.condition"] == "novice"
            bot = shlex.split(rows[1]["bot.robot2"])
            assert bot[:4] == ["robotouille-bot", "planner", "--skill", "expert"]
            program = Path(sys.executable).with_name(bot[0])
            playing = await asyncio.create_subprocess_exec(program, *bot[1:])
            try:
                async with visiting(browser, rows[1]["link.robot1"], "Ada") as ada:
                    await ada.get_by_role("button", name="I'm ready").click()
                    await expect(ada.locator("#progress")).to_have_attribute(
                        "title", re.compile(r"^[1-9]\d* of")
                    )
                    kinds = {player: seat.kind for player, seat in room.episode.seats.items()}
                    assert kinds == {"robot1": "human", "robot2": "bot"}
            finally:
                playing.terminate()
                await playing.wait()
            await dialog.get_by_role("button", name="Close").click()
            await expect(dialog).to_have_count(0)


async def test_faults_are_shown_at_their_fields(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _):
        async with browser_page(browser, port.url, allow="400") as page:
            dialog = await opened_form(page)
            send = dialog.get_by_role("button", name="Open", exact=True)

            async def expect_fault(label: str, words: str) -> None:
                await send.click()
                control = dialog.get_by_label(label, exact=True)
                await expect(control).to_have_attribute("aria-invalid", "true")
                await expect(control).to_have_accessible_description(re.compile(re.escape(words)))
                await expect(control).to_be_focused()
                assert await dialog.locator('[aria-invalid="true"]').count() == 1

            await expect_fault("Task", "Choose a task.")
            await dialog.get_by_label("Task").fill("soop")
            await expect_fault("Task", "No task is called soop. Type a part of its name and choose")
            await dialog.get_by_label("Task").fill(f"{TASK}s")
            await expect_fault("Task", f"burgers. Did you mean '{TASK}'?")
            await dialog.get_by_label("Task").fill("Lettuce chicken sandwich")
            await expect_fault(
                "Task", "Several tasks have this title. Choose one of asynchronous/02"
            )
            await dialog.get_by_label("Task").fill(TASK)
            await dialog.get_by_label("Seats", exact=True).fill("9")
            await expect_fault("Seats", "does not support 9 seats")
            await dialog.get_by_label("Seats", exact=True).fill("")
            await dialog.get_by_label("Seats for bots").fill("3")
            await expect_fault("Seats for bots", "The task has 2 seats.")
            await dialog.get_by_label("Seats for bots").fill("0")
            await dialog.get_by_label("Labels").fill("novice")
            await expect_fault("Labels", "NAME=VALUE")
            await dialog.get_by_label("Labels").fill("")
            await dialog.get_by_label("Episodes").fill("101")
            await expect_fault("Episodes", "100")
            await dialog.get_by_label("Episodes").fill("1")
            await dialog.get_by_label("Address of the game for players").fill("kitchen")
            await expect_fault("Address of the game for players", "https://")
            assert not server.lobby.rooms


async def test_task_is_named_by_its_title(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), browser_page(browser, port.url) as page:
        dialog = await opened_form(page)
        option = dialog.locator(f"option[value='{TASK}']")
        await expect(option).to_have_text(re.compile(r"^Lettuce burger: 2, .* seats$"))
        await expect(dialog.locator("option", has_text=": 1 seat").first).to_have_text(
            re.compile(r": 1 seat$")
        )
        await dialog.get_by_label("Task").fill("lettuce Burger")
        await expect(dialog.get_by_label("Seats", exact=True)).to_have_accessible_description(
            re.compile("Possible: 2")
        )
        await dialog.get_by_role("button", name="Open", exact=True).click()
        await expect(dialog.locator("h2")).to_have_text("An episode is open")
        (room,) = server.lobby.rooms.values()
        assert room.world.task.name == TASK


async def test_labels_are_never_markup_or_formulas(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        dialog = await opened_form(page)
        await dialog.get_by_label("Task").fill(TASK)
        await dialog.get_by_label("Labels").fill("formula==1+1, markup=<img src=x onerror=boom()>")
        await dialog.get_by_role("button", name="Open", exact=True).click()
        (row,) = await saved_rows(page, dialog)
        assert row["label.formula"] == "'=1+1"
        await expect(page.locator(".episode .labels")).to_contain_text("<img src=x")
        assert await page.locator("main img, dialog img").count() == 0


async def test_links_are_not_lost_by_accident(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        dialog = await opened_form(page)
        await dialog.get_by_label("Task").fill(TASK)
        await page.keyboard.press("Enter")
        await expect(dialog.locator("h2")).to_have_text("An episode is open")
        await page.keyboard.press("Escape")
        question = page.get_by_role("dialog").last
        await expect(question).to_contain_text("Close without the links?")
        await question.get_by_role("button", name="Cancel").click()
        await expect(dialog.locator("tbody tr")).to_have_count(1)
        await dialog.get_by_role("button", name="Close").click()
        await question.get_by_role("button", name="Close").click()
        await expect(page.get_by_role("dialog")).to_have_count(0)


async def test_host_of_a_link_is_one_that_the_operator_gives(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), browser_page(browser, port.url) as page:
        dialog = await opened_form(page)
        address = dialog.get_by_label("Address of the game for players")
        await expect(address).to_have_value(f"http://127.0.0.1:{server.port}/play")
        await dialog.get_by_label("Task").fill(TASK)
        await address.fill("https://kitchen.example.org/play")
        await dialog.get_by_role("button", name="Open", exact=True).click()
        (row,) = await saved_rows(page, dialog)
        assert row["link.robot1"].startswith(f"https://kitchen.example.org/play#{row['code']}.")
        await dialog.get_by_role("button", name="Close").click()
        dialog = await opened_form(page)
        await expect(address).to_have_value("https://kitchen.example.org/play")


async def test_address_of_this_server_is_not_kept_for_others(browser: Any, tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        first = await stack.enter_async_context(serving(tmp_path / "first"))
        second = await stack.enter_async_context(serving(tmp_path / "second"))
        async with operator_view(first, port=0) as port:
            visit = browser_page(browser, port.url, allow="net::ERR_")
            page = await stack.enter_async_context(visit)
            dialog = await opened_form(page)
            await dialog.get_by_label("Task").fill(TASK)
            await dialog.get_by_role("button", name="Open", exact=True).click()
            await saved_rows(page, dialog)
        async with operator_view(second, port=port.port):
            await page.reload()
            dialog = await opened_form(page)
            address = dialog.get_by_label("Address of the game for players")
            await expect(address).to_have_value(f"http://127.0.0.1:{second.port}/play")


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
async def test_form_and_table_fit_the_screen(
    browser: Any, tmp_path: Path, size: dict[str, int]
) -> None:
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url, size) as page:
        dialog = await opened_form(page)
        await dialog.get_by_label("Task").fill(f"{TASK}@4")
        for part in ("Open", "Close"):
            assert await page.evaluate("document.documentElement.scrollWidth") <= size["width"]
            assert await dialog.evaluate("each => each.scrollWidth <= each.clientWidth")
            action = dialog.get_by_role("button", name=part, exact=True)
            await action.scroll_into_view_if_needed()
            box = await action.bounding_box()
            assert box["x"] + box["width"] <= size["width"]
            if part == "Open":
                await action.click()


async def test_form_is_for_tokens_that_allow_all_episodes(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path, tokens=True) as (server, port, _):
        async with connect(server.url, name="host") as host:
            created = await host.create(TASK)
        token = server.tokens.mint_role(Role.OPERATOR, "lab", seconds=3600, episode=created.episode)
        async with browser_page(browser, port.url, allow="401") as page:
            await page.get_by_label("Token").fill(token)
            await page.get_by_role("button", name="Sign in").click()
            await expect(page.locator(".episode")).to_have_count(1)
            await expect(page.get_by_role("button", name="Open episodes")).to_be_hidden()


@pytest.mark.parametrize("path", ["", "play", "play/", "play?lang=de"])
async def test_link_of_a_spectator_replaces_the_address_for_players(
    browser: Any, tmp_path: Path, path: str
) -> None:
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        dialog = await opened_form(page)
        await dialog.get_by_label("Task").fill(TASK)
        address = dialog.get_by_label("Address of the game for players")
        await address.fill(f"https://kitchen.example.org/{path}")
        await dialog.get_by_role("button", name="Open", exact=True).click()
        await saved_rows(page, dialog)
        await dialog.get_by_role("button", name="Close").click()
        await page.get_by_role("button", name="Watch").click()
        await page.get_by_role("button", name="Make a link").click()
        link = await page.get_by_role("link", name="Open", exact=True).get_attribute("href")
        assert link.startswith("https://kitchen.example.org/watch#")


async def test_links_are_shown_if_the_form_is_closed_too_early(
    browser: Any, tmp_path: Path
) -> None:
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        dialog = await opened_form(page)

        async def answered_late(route: Any) -> None:
            answer = await route.fetch()
            await dialog.get_by_role("button", name="Cancel").click()
            await expect(dialog).to_have_count(0)
            await route.fulfill(response=answer)

        await page.route("**/api/episodes", answered_late)
        await dialog.get_by_label("Task").fill(TASK)
        await dialog.get_by_role("button", name="Open", exact=True).click()
        await expect(dialog.locator("h2")).to_have_text("An episode is open")
        assert len(await saved_rows(page, dialog)) == 1


async def test_lost_connection_is_shown_in_the_form(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, port, _):
        async with browser_page(browser, port.url, allow="ERR_FAILED") as page:
            dialog = await opened_form(page)
            await page.route("**/api/episodes", lambda route: route.abort())
            await dialog.get_by_label("Task").fill(TASK)
            await dialog.get_by_role("button", name="Open", exact=True).click()
            await expect(dialog.get_by_role("alert")).to_contain_text("Failed to fetch")


async def test_link_of_a_spectator_shows_the_game_and_nothing_else(
    browser: Any, tmp_path: Path
) -> None:
    async with viewing(tmp_path, require_token=True, tokens=True) as (server, port, _):
        room = server.lobby.create(messages.Create(task=TASK))
        token = server.tokens.mint_role(Role.OPERATOR, "lab", seconds=3600)
        async with browser_page(browser, port.url, allow="401") as page:
            await page.get_by_label("Token").fill(token)
            await page.get_by_role("button", name="Sign in").click()
            await page.get_by_role("button", name="Watch").click()
            await page.get_by_role("button", name="Make a link").click()
            opening = page.get_by_role("link", name="Open", exact=True)
            await expect(opening).to_be_focused()
            link = await opening.get_attribute("href")
        assert link.startswith(f"http://127.0.0.1:{server.port}/watch#{room.code}.")
        async with visiting(browser, link, "Eve") as eve:
            await expect(eve.locator("#kitchen")).to_be_visible()
            await expect(eve.locator("#seats")).to_contain_text("free")
            assert room.spectators == 1
        playing = link.replace("/watch#", "/play#")
        async with visiting(browser, playing, "Eve") as eve:
            await expect(eve.locator("#cover")).to_contain_text("may not join as player")
        assert not any(seat.name for seat in room.episode.seats.values())


async def test_late_link_of_a_spectator_is_not_shown_for_another_episode(
    browser: Any, tmp_path: Path
) -> None:
    async with viewing(tmp_path) as (server, port, _), browser_page(browser, port.url) as page:
        for _ in range(2):
            server.lobby.create(messages.Create(task=TASK))
        panel = page.locator(".watch")
        watching = page.locator(".episode").get_by_role("button", name="Watch")

        async def answered_late(route: Any) -> None:
            answer = await route.fetch()
            await watching.last.click()
            await expect(panel.get_by_role("button", name="Make a link")).to_be_visible()
            await route.fulfill(response=answer)

        await page.route("**/spectator_link", answered_late)
        await watching.first.click()
        async with page.expect_response("**/spectator_link") as answer:
            await panel.get_by_role("button", name="Make a link").click()
        link = (await (await answer.value).json())["link"]
        await expect(panel).not_to_contain_text(link)
        await expect(panel.get_by_role("button", name="Make a link")).to_be_visible()
