"""The operator's page in a real browser, over a live game of two bots."""

from __future__ import annotations

import asyncio
import importlib.util
import re
import shutil
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from robotouille.episode import Phase
from robotouille.errors import ProtocolError
from robotouille.planning.policies.policy import RandomPolicy
from robotouille.replay.recording import Recording
from robotouille_client import Announced, Over, connect
from robotouille_client.bots import play
from robotouille_server import Server
from robotouille_server import health as resources
from robotouille_server.admin import operator_view
from robotouille_server.auth.tokens import Role, RoleGrant
from robotouille_server.health import Disk
from robotouille_server.rooms.room import Room
from tests.support.machines import Machine
from tests.support.operator import Api, bearer, viewing
from tests.support.operator import Disk as FillingDisk

if importlib.util.find_spec("playwright") is None:
    pytest.skip("needs playwright: pip install playwright", allow_module_level=True)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.asyncio(loop_scope="module"),
    pytest.mark.browser,
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt install chromium"),
]

FLAGS = [
    "--no-sandbox", "--headless", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
DESKTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
TASK = "multi_agent/10@2"
PATIENCE = 30
"""Seconds after which a test that waits for the browser or a bot fails."""


class Bot:
    """Plays a seat at random, and keeps what it is told."""

    def __init__(self) -> None:
        self._told: asyncio.Queue[Any] = asyncio.Queue()

    async def run(self, server: Server, code: str, name: str, seed: int) -> None:
        async with connect(server.url, name=name, kind="bot") as client:
            game = await client.join(code)
            poll, next_event = game.poll, game.next_event

            def overheard() -> Any:
                events = list(poll())
                for event in events:
                    self._told.put_nowait(event)
                return events

            async def overheard_next() -> Any:
                event = await next_event()
                self._told.put_nowait(event)
                return event

            game.poll = overheard  # type: ignore[method-assign]
            game.next_event = overheard_next  # type: ignore[method-assign]
            await play(game, lambda _, player: RandomPolicy(player, seed))
            overheard()

    async def hears(self, kind: type) -> Any:
        """The next event of a kind."""
        async with asyncio.timeout(PATIENCE):
            while not isinstance(event := await self._told.get(), kind):
                pass
        return event


@asynccontextmanager
async def live_game(
    server: Server, names: tuple[str, ...] = ("ada", "grace")
) -> AsyncIterator[tuple[Room, list[Bot]]]:
    """Two bots in a real-time episode that lasts."""
    async with connect(server.url, name="host") as host:
        created = await host.create(TASK, clock="realtime", step_rate=20, max_steps=1_000_000)
    bots = [Bot() for _ in names]
    playing = [
        asyncio.create_task(bot.run(server, created.code, name, seed))
        for seed, (bot, name) in enumerate(zip(bots, names, strict=True))
    ]
    room = server.lobby.rooms[created.episode]
    try:
        yield room, bots
    finally:
        for task in playing:
            task.cancel()
        await asyncio.gather(*playing, return_exceptions=True)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser() -> AsyncIterator[Any]:
    """One browser for all tests; each opens a window that knows nothing of the others."""
    from playwright import async_api as playwright

    async with playwright.async_playwright() as driver:
        started = await driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield started
        await started.close()


@asynccontextmanager
async def browser_page(
    browser: Any, url: str, size: dict[str, int] = DESKTOP, allow: str = "no complaint at all"
) -> AsyncIterator[Any]:
    """The page, opened; what the browser complains about fails the test, unless it is allowed."""
    complaints: list[str] = []
    page = await browser.new_page(viewport=size)
    try:
        page.set_default_timeout(PATIENCE * 1000)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on(
            "console", lambda line: complaints.append(line.text) if line.type == "error" else None
        )
        await page.goto(url)
        yield page
    finally:
        await page.close()
    assert [line for line in complaints if allow not in line] == []


def expect(locator: Any) -> Any:
    from playwright import async_api as playwright

    playwright.expect.set_options(timeout=PATIENCE * 1000)
    return playwright.expect(locator)


async def watch(page: Any, room: Room) -> Any:
    """Open the panel of an episode."""
    card = page.locator(".episode", has_text=room.code[:5])
    await card.get_by_role("button", name="Watch").click()
    panel = page.get_by_label("Watch an episode")
    await expect(panel.locator(".log li", has_text="robot1").first).to_be_visible()
    return panel


async def test_the_operator_watches_pauses_and_ends_a_game(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), live_game(server) as (room, bots):
        async with browser_page(browser, port.url) as page:
            card = page.locator(".episode")
            await expect(card).to_have_count(1)
            await expect(card).to_contain_text("ada")
            await expect(card.locator(".phase")).to_have_text("running")
            await expect(page.locator("#link")).to_have_text("live")

            panel = await watch(page, room)
            await expect(panel.locator(".state")).to_contain_text("Station")
            await expect(panel.locator("code")).to_contain_text("--watch")

            await panel.get_by_role("button", name="Pause").click()
            await expect(panel.locator(".phase")).to_have_text("paused by the operator")
            assert room.episode.paused
            step = room.episode.step
            await expect(card.locator(".phase")).to_have_text("paused by the operator")
            assert room.episode.step == step

            await panel.get_by_role("button", name="Resume").click()
            await expect(panel.locator(".phase")).to_have_text("running")
            assert not room.episode.paused
            await expect(panel.locator(".steps")).not_to_have_text(re.compile(f"step {step} of"))

            await panel.get_by_role("button", name="End").click()
            dialog = page.get_by_role("dialog")
            await dialog.get_by_role("button", name="Cancel").click()
            assert room.episode.phase is Phase.RUNNING
            await panel.get_by_role("button", name="End").click()
            await dialog.get_by_label("Reason").fill("lunch")
            await dialog.get_by_role("button", name="End the episode").click()
            await expect(panel.locator(".phase")).to_have_text("ended")
            over = await bots[0].hears(Over)
            assert (over.outcome["reason"], over.outcome["detail"]) == ("aborted", "lunch")
            await expect(panel.locator(".log li").last).to_have_text(re.compile("aborted: lunch"))


async def test_the_operator_speaks_and_sends_people_out(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), live_game(server) as (room, bots):
        async with browser_page(browser, port.url) as page, connect(server.url, name="eve") as eve:
            game = await eve.join(room.code, role="spectator")
            panel = await watch(page, room)
            await panel.get_by_label("Announce to this episode").fill("Dinner at eight")
            await panel.get_by_role("button", name="Announce").click()
            assert (await bots[0].hears(Announced)).text == "Dinner at eight"
            await expect(panel.locator(".log")).to_contain_text("Dinner at eight")

            await page.get_by_role("button", name="Announce to all").click()
            dialog = page.get_by_role("dialog")
            await dialog.get_by_label("Text").fill("Closing soon")
            await dialog.get_by_role("button", name="Announce").click()
            assert (await bots[1].hears(Announced)).text == "Dinner at eight"
            assert (await bots[1].hears(Announced)).text == "Closing soon"

            mute = panel.get_by_role("button", name="Mute eve")
            await mute.click()
            await expect(mute).to_have_attribute("aria-pressed", "true")
            await expect(panel.locator(".person", has_text="eve")).to_contain_text("muted")
            await mute.click()
            await expect(mute).to_have_attribute("aria-pressed", "false")

            await panel.get_by_role("button", name="Remove eve").click()
            await dialog.get_by_role("button", name="Remove").click()
            await expect(panel.get_by_role("button", name="Remove eve")).to_have_count(0)
            while not isinstance(await game.next_event(), Over):
                pass

            await panel.get_by_role("button", name="Remove grace").click()
            await dialog.get_by_label("Reason").fill("asleep")
            await dialog.get_by_role("button", name="Remove").click()
            assert (await bots[1].hears(Over)).reason == "asleep"
            await expect(panel.locator(".person", has_text="free")).to_have_count(1)
            assert [seat.name for seat in room.episode.seats.values()] == ["ada", ""]


async def test_recordings_are_downloaded_live_and_closed(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), live_game(server) as (room, _):
        async with browser_page(browser, port.url) as page:
            panel = await watch(page, room)
            live = Recording((await _downloaded(page, panel)).read_bytes())
            assert live.outcome is None
            assert live.verify().ok
            assert len(live.steps) > 0

            room.abort("enough")
            await page.get_by_role("tab", name="Recordings").click()
            row = page.locator(".recording")
            await expect(row.locator(".phase")).to_have_text("ended")
            path = await _downloaded(page, row)
            assert path.read_bytes() == (tmp_path / room.recording).read_bytes()


async def _downloaded(page: Any, where: Any) -> Path:
    async with page.expect_download() as download:
        await where.get_by_role("link", name="Download").click()
    path: Path = await (await download.value).path()
    return path


async def test_a_disk_that_is_full_is_seen_at_once(browser: Any, tmp_path: Path) -> None:
    disk = FillingDisk(tmp_path)
    async with viewing(tmp_path, storage=disk) as (server, port, _):
        async with live_game(server) as (room, _), browser_page(browser, port.url) as page:
            alert = page.get_by_role("alert")
            await expect(page.locator(".episode .phase")).to_have_text("running")
            disk.full = True
            await expect(alert).to_contain_text("No space left on device")
            await expect(page.locator(".episode .phase")).to_have_text("cannot be recorded")
            await alert.get_by_role("button", name="See").click()
            problem = page.get_by_label("Watch an episode").locator(".problem")
            await expect(problem).to_contain_text("No space left on device")
            disk.full = False
            await expect(page.locator(".episode .phase")).to_have_text("running")
            await expect(alert).to_be_empty()
            assert room.problem == ""


async def test_a_name_is_text_whatever_it_says(browser: Any, tmp_path: Path) -> None:
    name = "<img src=x onerror=boom()>"
    async with viewing(tmp_path) as (server, port, _), live_game(server, (name, "b")) as (room, _):
        async with browser_page(browser, port.url) as page:
            await expect(page.locator(".episode")).to_contain_text(name)
            panel = await watch(page, room)
            await expect(panel.locator(".people")).to_contain_text(name)
            assert await page.locator("main img, aside img").count() == 0


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
async def test_nothing_is_wider_than_the_screen(
    browser: Any, tmp_path: Path, size: dict[str, int]
) -> None:
    names = ("a-very-long-name-without-any-space-in-it", "b")
    async with viewing(tmp_path) as (server, port, _), live_game(server, names) as (room, _):
        async with browser_page(browser, port.url, size) as page:
            await expect(page.locator(".episode")).to_be_visible()
            width = "document.documentElement.scrollWidth"
            assert await page.evaluate(width) <= size["width"]
            panel = await watch(page, room)
            assert await page.evaluate(width) <= size["width"]
            for element in ("Pause", "End", "Close"):
                box = await panel.get_by_role("button", name=element).bounding_box()
                assert box["x"] >= 0
                assert box["x"] + box["width"] <= size["width"]
            await panel.get_by_role("button", name="Close").click()
            await expect(panel).to_be_hidden()


async def test_light_and_dark_are_the_systems_until_somebody_chooses(
    browser: Any, tmp_path: Path
) -> None:
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        paper = "getComputedStyle(document.body).backgroundColor"
        await page.emulate_media(color_scheme="light")
        light = await page.evaluate(paper)
        await page.emulate_media(color_scheme="dark")
        dark = await page.evaluate(paper)
        assert light != dark
        await page.get_by_role("button", name="Light or dark").click()
        assert await page.evaluate(paper) == light
        await page.reload()
        assert await page.evaluate(paper) == light


async def test_a_token_is_asked_for_once_and_kept_for_the_tab(browser: Any, tmp_path: Path) -> None:
    def authorize(token: str) -> RoleGrant:
        if token != "let-me-in":
            raise ProtocolError("auth/invalid", "this is no operator's token", "token")
        return RoleGrant(Role.OPERATOR, "lab")

    view = {"authorize": authorize, "ask_token": True}
    async with viewing(tmp_path, view=view) as (server, port, api):
        async with (
            live_game(server) as (room, _),
            browser_page(browser, port.url, allow="401") as page,
        ):
            dialog = page.get_by_role("dialog")
            await dialog.get_by_label("Token").fill("guess")
            await dialog.get_by_role("button", name="Show").click()
            await expect(dialog).to_contain_text("this is no operator's token")
            await expect(page.locator(".episode")).to_have_count(0)
            await dialog.get_by_label("Token").fill("let-me-in")
            await dialog.get_by_role("button", name="Show").click()
            await expect(page.locator(".episode")).to_be_visible()
            await page.reload()
            panel = await watch(page, room)
            content = (await _downloaded(page, panel)).read_bytes()
            assert Recording(content).verify().ok
            await panel.get_by_role("button", name="Pause").click()
            await expect(panel.locator(".phase")).to_have_text("paused by the operator")
            assert await _is_closed_to_others(api)


async def _is_closed_to_others(api: Api) -> bool:
    return (await api.http.get("/api/overview")).status_code == 401


async def test_a_token_that_is_over_is_asked_for_again(browser: Any, tmp_path: Path) -> None:
    over: set[str] = set()

    def authorize(token: str) -> RoleGrant:
        if token in over:
            raise ProtocolError("auth/expired", "the token has expired", "token")
        return RoleGrant(Role.OPERATOR, "lab")

    view = {"authorize": authorize, "ask_token": True}
    async with viewing(tmp_path, view=view) as (_, port, _):
        async with browser_page(browser, port.url, allow="401") as page:
            dialog = page.get_by_role("dialog")
            await dialog.get_by_label("Token").fill("one")
            await dialog.get_by_role("button", name="Show").click()
            await expect(page.locator("#link")).to_have_text("live")
            over.add("one")
            await expect(dialog).to_contain_text("the token has expired")
            await dialog.get_by_label("Token").fill("two")
            await dialog.get_by_role("button", name="Show").click()
            await expect(page.locator("#link")).to_have_text("live")


async def test_what_runs_out_is_seen(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resources, "SAMPLE_SECONDS", 0.5)
    async with viewing(tmp_path) as (server, port, _), live_game(server) as (room, _):
        machine = server.health.system = Machine()
        machine.free, machine.open = Disk(900 * 1024**2, 10 * 1024**3), 990
        async with browser_page(browser, port.url) as page:
            warnings = page.get_by_label("Warnings").locator("p")
            await expect(warnings).to_have_count(2)
            await expect(warnings.first).to_contain_text("990 of 1,000 file descriptors")
            await expect(warnings.last).to_contain_text("900 MiB")
            assert await warnings.first.get_attribute("data-severity") == "critical"
            panel = await watch(page, room)
            await expect(panel.locator(".person").first).to_contain_text(" in")
            machine.free, machine.open = Disk(5 * 1024**3, 10 * 1024**3), 90
            await expect(warnings).to_have_count(0)


async def test_who_may_see_one_episode_cannot_speak_to_all(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path, tokens=True) as (server, port, _):
        async with live_game(server) as (mine, _), live_game(server):
            token = bearer(server, episode=mine.id)["Authorization"].removeprefix("Bearer ")
            async with browser_page(browser, port.url, allow="401") as page:
                dialog = page.get_by_role("dialog")
                await dialog.get_by_label("Token").fill(token)
                await dialog.get_by_role("button", name="Show").click()
                await expect(page.locator(".episode")).to_have_count(1)
                await expect(page.get_by_role("button", name="Announce to all")).to_have_count(0)


async def test_the_page_finds_the_server_again(browser: Any, tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        server, _, _ = await stack.enter_async_context(viewing(tmp_path))
        room, _ = await stack.enter_async_context(live_game(server))
        async with operator_view(server, port=0) as port:
            opened = browser_page(browser, port.url, allow="ERR_")
            page = await stack.enter_async_context(opened)
            await expect(page.locator("#link")).to_have_text("live")
        await expect(page.locator("#link")).to_have_text("connecting again")
        async with operator_view(server, port=port.port):
            await expect(page.locator("#link")).to_have_text("live")
            await watch(page, room)
