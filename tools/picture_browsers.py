"""Draw docs/images/browsers.png: a game of two people in two browsers.

python tools/picture_browsers.py [OUT.png]

The people follow the shipped plan of the task, by the buttons of the page. The tool needs
Chromium, and the development extra.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame
from playwright.async_api import Page, async_playwright, expect

from robotouille import State, World, load_task
from robotouille.domain.rendering import language_of
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from robotouille.protocol import messages
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.wording import Wording
from robotouille_server import Server, ServerSettings, serve

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "browsers.png"
TASK = "multi_agent/03_lettuce_fried_onion_fried_chicken_burger"
NAMES, SIZES = ("Ada", "Ben"), ((1280, 720), (390, 844))
STEPS = 8
SAYS = {3: (0, "I fry, you cut?"), 6: (1, "On it!")}
"""Seat and chat message, by step."""
GAP, HEIGHT = 28, 720
GROUND = (250, 246, 238)


async def enter(page: Page, url: str, name: str) -> None:
    await page.goto(url)
    await page.fill("#name", name)
    await page.click("#enter-button")
    await page.get_by_role("button", name="I'm ready").click()


async def choose(page: Page, words: str) -> None:
    choices = page.locator("#choices")
    await choices.get_by_role("button", name=words, exact=True).first.click()


async def play(pages: list[Page], world: World) -> None:
    """Play the first steps of the plan."""
    plan = (data_folder("problems") / f"{TASK}@2.plan").read_text(encoding="utf-8")
    state = world.initial
    for step, joint in enumerate(list(read_plan(plan, world))[:STEPS]):
        for seat, player in enumerate(world.players):
            page = pages[seat]
            await expect(page.locator("#progress")).to_have_text(re.compile(rf"\b{step} of"))
            if step in SAYS and SAYS[step][0] == seat:
                await page.fill("#said", SAYS[step][1])
                await page.press("#said", "Enter")
            if not state.busy_steps(player):
                acting = next((a for a in joint if a.player == player), None)
                await choose(page, _words(world, state, player, acting))
        state = state.step(list(joint)).state


def _words(world: World, state: State, player: str, action: Any) -> str:
    if action is None:
        return "Wait"
    names = dict(zip(world.players, NAMES, strict=True))
    others = {each: name for each, name in names.items() if each != player}
    wording = Wording(world, language_of(world.task), player, others)
    return capitalised(wording.action(action, state))


async def pictures(server: Server) -> list[bytes]:
    """Return a picture of each browser."""
    request = messages.Create(task=f"{TASK}@2", clock="lockstep", seats=2)
    room = server.lobby.create(request)
    url = f"http://127.0.0.1:{server.port}/play#{room.code}"
    async with async_playwright() as driver:
        flags = ["--no-sandbox", "--disable-gpu"]
        browser = await driver.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        pages = [
            await browser.new_page(
                viewport={"width": width, "height": height}, device_scale_factor=1 + seat
            )
            for seat, (width, height) in enumerate(SIZES)
        ]
        for page, name in zip(reversed(pages), reversed(NAMES), strict=True):
            await enter(page, url, name)
        for page in pages:
            await expect(page.locator("#seats li", has_text="you")).to_have_count(1)
        # The first to join gets the first seat that stands in nobody's way.
        order = [seat.name for seat in room.episode.seats.values()]
        world = World(load_task(f"{TASK}@2"))
        await play([pages[NAMES.index(name)] for name in order], world)
        await asyncio.sleep(1)
        found = [await page.screenshot() for page in pages]
        await browser.close()
    return found


def composed(found: list[bytes]) -> pygame.Surface:
    """Return both pictures next to each other."""
    surfaces = [pygame.image.load(io.BytesIO(each), "browser.png") for each in found]
    scaled = [
        pygame.transform.smoothscale(each, (each.get_width() * HEIGHT // each.get_height(), HEIGHT))
        for each in surfaces
    ]
    width = sum(each.get_width() for each in scaled) + GAP * (len(scaled) + 1)
    picture = pygame.Surface((width, HEIGHT + 2 * GAP))
    picture.fill(GROUND)
    left = GAP
    for each in scaled:
        picture.blit(each, (left, GAP))
        left += each.get_width() + GAP
    return picture


async def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", nargs="?", type=Path, default=PICTURE)
    out: Path = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        settings = ServerSettings(port=0, recordings=Path(folder), countdown=0.0, operator=False)
        async with serve(settings) as server:
            picture = composed(await pictures(server))
    pygame.image.save(picture, out)
    print(out)


if __name__ == "__main__":
    asyncio.run(main())
