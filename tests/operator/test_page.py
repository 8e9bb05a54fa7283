"""The operator page in a real browser, with an episode of two bots."""

from __future__ import annotations

import asyncio
import re
import tarfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille.episode import Phase
from robotouille.errors import ProtocolError
from robotouille.planning.policies.policy import RandomPolicy
from robotouille.replay.recording import Recording
from robotouille_client import Announced, GameEnded, connect
from robotouille_client.bots import play
from robotouille_server import Server
from robotouille_server import health as resources
from robotouille_server.auth import Role, RoleGrant
from robotouille_server.health import Disk
from robotouille_server.operator import operator_view
from robotouille_server.operator.rows import shown_code
from robotouille_server.rooms.room import Room
from tests.operator.visits import DESKTOP, browser_page
from tests.support.machines import Machine
from tests.support.operator import Api, table, viewing
from tests.web.visits import BROWSER_TEST, PHONE, expect

pytestmark = BROWSER_TEST

TASK = "multi_agent/10@2"
PATIENCE = 30
"""Seconds after which a test that waits for the browser or a bot fails."""

PICTURE = "document.querySelector('.watch .kitchen').toDataURL()"
COLOURS = """(() => {
  const canvas = document.querySelector(".watch .kitchen");
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return new Set(new Uint32Array(data.buffer)).size;
})()"""
"""Number of colours in the picture of the watched kitchen."""


class Bot:
    """Bot that plays at random and keeps the events that it receives."""

    def __init__(self) -> None:
        self._events: asyncio.Queue[Any] = asyncio.Queue()

    async def run(self, server: Server, code: str, name: str, seed: int) -> None:
        async with connect(server.url, name=name, kind="bot") as client:
            game = await client.join(code)
            poll, next_event = game.poll, game.next_event

            def kept_poll() -> Any:
                events = list(poll())
                for event in events:
                    self._events.put_nowait(event)
                return events

            async def kept_next_event() -> Any:
                event = await next_event()
                self._events.put_nowait(event)
                return event

            game.poll = kept_poll  # type: ignore[method-assign]
            game.next_event = kept_next_event  # type: ignore[method-assign]
            await play(game, lambda _, player: RandomPolicy(player, seed))
            kept_poll()

    async def wait_for(self, kind: type) -> Any:
        """Wait for the next event of a type and return it."""
        async with asyncio.timeout(PATIENCE):
            while not isinstance(event := await self._events.get(), kind):
                pass
        return event


@asynccontextmanager
async def live_game(
    server: Server, names: tuple[str, ...] = ("ada", "grace")
) -> AsyncIterator[tuple[Room, list[Bot]]]:
    """Run a long real-time episode of two bots."""
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


async def watch(page: Any, room: Room) -> Any:
    """Open the panel of an episode."""
    card = page.locator(".episode", has_text=room.code[:5])
    await card.get_by_role("button", name="Watch").click()
    panel = page.get_by_label("Watched episode")
    await expect(panel.locator(".log li", has_text="robot1").first).to_be_visible()
    return panel


async def test_operator_watches_pauses_and_ends_an_episode(browser: Any, tmp_path: Path) -> None:
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
            await page.wait_for_function(f"{COLOURS} > 50")
            shown = await page.evaluate(PICTURE)
            await page.wait_for_function(f"shown => {PICTURE} !== shown", arg=shown)
            assert room.broadcaster.spectators == 0, "players would see that an operator watches"

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
            over = await bots[0].wait_for(GameEnded)
            assert (over.outcome["reason"], over.outcome["detail"]) == ("aborted", "lunch")
            await expect(panel.locator(".log li").last).to_have_text(re.compile("aborted: lunch"))


async def test_operator_announces_mutes_and_removes(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), live_game(server) as (room, bots):
        async with browser_page(browser, port.url) as page, connect(server.url, name="eve") as eve:
            game = await eve.join(room.code, role="spectator")
            panel = await watch(page, room)
            await panel.get_by_label("Announce to this episode").fill("Dinner at eight")
            await panel.get_by_role("button", name="Announce").click()
            assert (await bots[0].wait_for(Announced)).text == "Dinner at eight"
            await expect(panel.locator(".log")).to_contain_text("Dinner at eight")

            await page.get_by_role("button", name="Announce to all").click()
            dialog = page.get_by_role("dialog")
            await dialog.get_by_label("Text").fill("Closing soon")
            await dialog.get_by_role("button", name="Announce").click()
            assert (await bots[1].wait_for(Announced)).text == "Dinner at eight"
            assert (await bots[1].wait_for(Announced)).text == "Closing soon"

            mute = panel.get_by_role("button", name="Mute eve")
            names = ("Announce", "Mute eve", "Remove eve")
            buttons = [panel.get_by_role("button", name=name) for name in names]
            icons = [await one.locator("use").get_attribute("href") for one in buttons]
            assert len(set(icons)) == 3
            await expect(page.locator(", ".join(icons))).to_have_count(3)
            await mute.click()
            await expect(mute).to_have_attribute("aria-pressed", "true")
            await expect(panel.locator(".person", has_text="eve")).to_contain_text("muted")
            await mute.click()
            await expect(mute).to_have_attribute("aria-pressed", "false")

            await panel.get_by_role("button", name="Remove eve").click()
            await dialog.get_by_role("button", name="Remove").click()
            await expect(panel.get_by_role("button", name="Remove eve")).to_have_count(0)
            while not isinstance(await game.next_event(), GameEnded):
                pass

            await panel.get_by_role("button", name="Remove grace").click()
            await dialog.get_by_label("Reason").fill("asleep")
            await dialog.get_by_role("button", name="Remove").click()
            assert (await bots[1].wait_for(GameEnded)).reason == "asleep"
            await expect(panel.locator(".person", has_text="free")).to_have_count(1)
            assert [seat.name for seat in room.episode.seats.values()] == ["ada", ""]


async def test_open_and_closed_recordings_are_downloaded(browser: Any, tmp_path: Path) -> None:
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


def _archived(path: Path) -> list[str]:
    with tarfile.open(path) as tar:
        return tar.getnames()


async def test_lists_stay_in_place_when_figures_appear(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), browser_page(browser, port.url) as page:
        totals = page.get_by_label("Totals")
        await expect(totals).to_contain_text("median –")
        before = (await totals.bounding_box())["height"]
        async with live_game(server):
            await expect(totals).to_contain_text(re.compile("median ≤.*99.9 % ≤"))
            assert (await totals.bounding_box())["height"] == before
            # Slow steps make the longest text.
            for _ in range(1000):
                server.metrics.lateness.observe(0.2)
            await expect(totals).to_contain_text(re.compile("99.9 % ≤ [0-9]{3}"))
            assert (await totals.bounding_box())["height"] == before


async def test_free_seat_is_named_once(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _):
        async with connect(server.url, name="host") as host:
            await host.create(TASK)
        async with browser_page(browser, port.url) as page:
            await page.get_by_role("button", name="Watch").click()
            seat = page.get_by_label("Watched episode").locator(".person").first
            await expect(seat).to_have_text("robot1· free")


async def test_recordings_of_one_task_are_told_apart_and_found(
    browser: Any, tmp_path: Path
) -> None:
    async with viewing(tmp_path) as (server, port, _):
        for pair, names in (("p1", ("ada", "bob")), ("p2", ("cleo", "dan"))):
            create = {"max_steps": 2, "step_rate": 20, "labels": {"pair": pair}}
            async with table(server, names=names, **create) as play:
                await play.until(lambda game: game.outcome)
        await server.lobby.closed()
        async with browser_page(browser, port.url) as page:
            await page.get_by_role("tab", name="Recordings").click()
            rows = page.locator(".recording")
            await expect(rows).to_have_count(2)
            for search in (play.code, "cleo", "pair=p2"):
                await page.get_by_label("Search").fill(search)
                await expect(rows).to_have_count(1)
                await expect(rows.locator(".labels")).to_have_text("pairp2")
                await expect(rows).to_contain_text(shown_code(play.code))
                await expect(rows).to_contain_text("cleo, dan")
                await page.get_by_label("Search").fill("")
                await expect(rows).to_have_count(2)


@pytest.mark.parametrize("token", [False, True], ids=["local", "token"])
async def test_ticked_or_all_matching_recordings_are_one_download(
    browser: Any, tmp_path: Path, token: bool
) -> None:
    async with viewing(tmp_path, tokens=token) as (server, port, _):
        tasks = ["soup", "soup", "soup", "pie"]
        files = [f"2025010{n}T000000Z_{task}_{n}.rbt" for n, task in enumerate(tasks)]
        for name in files:
            (tmp_path / name).write_bytes(name.encode())
        async with browser_page(browser, port.url, allow="401") as page:
            if token:
                minted = server.tokens.mint_role(Role.OPERATOR, "lab", seconds=3600)
                await page.get_by_label("Token").fill(minted)
                await page.get_by_role("button", name="Sign in").click()
            await page.get_by_role("tab", name="Recordings").click()
            bar = page.locator(".archive")
            await expect(bar.get_by_role("link")).to_have_text("Download all 4 recordings")
            assert _archived(await _downloaded(page, bar)) == files[::-1]
            await page.get_by_label("Search").fill("soup")
            await expect(bar.get_by_role("link")).to_have_text("Download all 3 recordings")
            assert _archived(await _downloaded(page, bar)) == files[2::-1]
            for name in (files[0], files[2]):
                await page.get_by_label(f"Select {name}").check()
            await expect(bar.get_by_role("link")).to_have_text("Download 2 recordings")
            assert _archived(await _downloaded(page, bar)) == [files[2], files[0]]
            await page.get_by_label("Search").fill("")
            await page.get_by_label(f"Select {files[2]}").uncheck()
            await expect(bar.get_by_role("link")).to_have_text("Download 1 recording")


async def test_ticked_recordings_stay_ticked_on_other_pages(browser: Any, tmp_path: Path) -> None:
    files = [f"20250101T0000{n:02}Z_soup_{n}.rbt" for n in range(51)]
    for name in files:
        (tmp_path / name).write_bytes(name.encode())
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        await page.get_by_role("tab", name="Recordings").click()
        bar = page.locator(".archive")
        await page.get_by_label(f"Select {files[-1]}").check()
        await page.get_by_role("button", name="Next").click()
        await expect(bar).to_contain_text("1 selected on other pages")
        await page.get_by_label(f"Select {files[0]}").check()
        assert _archived(await _downloaded(page, bar)) == [files[-1], files[0]]
        await page.get_by_role("button", name="Previous").click()
        await expect(page.get_by_label(f"Select {files[-1]}")).to_be_checked()
        await page.get_by_role("button", name="Clear selection").click()
        await expect(page.get_by_label(f"Select {files[-1]}")).not_to_be_checked()
        await expect(bar.get_by_role("link")).to_have_text("Download all 51 recordings")


async def test_names_are_never_markup(browser: Any, tmp_path: Path) -> None:
    name = "<img src=x onerror=boom()>"
    async with viewing(tmp_path) as (server, port, _), live_game(server, (name, "b")) as (room, _):
        async with browser_page(browser, port.url) as page:
            await expect(page.locator(".episode")).to_contain_text(name)
            panel = await watch(page, room)
            await expect(panel.locator(".people")).to_contain_text(name)
            assert await page.locator("main img, aside img").count() == 0


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
async def test_page_fits_the_screen(browser: Any, tmp_path: Path, size: dict[str, int]) -> None:
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


async def test_theme_follows_the_system_until_the_button_is_used(
    browser: Any, tmp_path: Path
) -> None:
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        paper = "getComputedStyle(document.body).backgroundColor"
        await page.emulate_media(color_scheme="light")
        light = await page.evaluate(paper)
        await page.emulate_media(color_scheme="dark")
        dark = await page.evaluate(paper)
        assert light != dark
        await page.get_by_role("button", name="Switch between light and dark").click()
        assert await page.evaluate(paper) == light
        await page.reload()
        assert await page.evaluate(paper) == light


async def test_token_is_requested_once_per_tab(browser: Any, tmp_path: Path) -> None:
    def authorize(token: str) -> RoleGrant:
        if token != "let-me-in":
            raise ProtocolError("auth/invalid", "the token is invalid", "token")
        return RoleGrant(Role.OPERATOR, "lab")

    view = {"authorize": authorize, "ask_token": True}
    async with viewing(tmp_path, view=view) as (server, port, api):
        async with (
            live_game(server) as (room, _),
            browser_page(browser, port.url, allow="401") as page,
        ):
            dialog = page.get_by_role("dialog")
            await dialog.get_by_label("Token").fill("guess")
            await dialog.get_by_role("button", name="Sign in").click()
            await expect(dialog).to_contain_text("the token is invalid")
            await expect(page.locator(".episode")).to_have_count(0)
            await dialog.get_by_label("Token").fill("let-me-in")
            await dialog.get_by_role("button", name="Sign in").click()
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


async def test_warnings_appear_and_disappear(
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


async def test_page_reconnects(browser: Any, tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        server, _, _ = await stack.enter_async_context(viewing(tmp_path))
        room, _ = await stack.enter_async_context(live_game(server))
        async with operator_view(server, port=0) as port:
            opened = browser_page(browser, port.url, allow="ERR_")
            page = await stack.enter_async_context(opened)
            await expect(page.locator("#link")).to_have_text("live")
        await expect(page.locator("#link")).to_have_text("reconnecting")
        async with operator_view(server, port=port.port):
            await expect(page.locator("#link")).to_have_text("live")
            await watch(page, room)
