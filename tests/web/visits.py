"""Visits of the page in a real browser, for tests that are people who play."""

from __future__ import annotations

import importlib.util
import re
import shutil
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.support.node import libraries

__all__ = [
    "BROWSER_TEST", "DESKTOP", "PATIENCE", "PHONE", "axe_faults", "expect", "get_ready", "launched",
    "link", "playing", "visiting",
]  # fmt: skip

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--headless", "--disable-gpu", "--disable-quic", "--no-first-run"]
DESKTOP, PHONE = {"width": 1280, "height": 720}, {"width": 390, "height": 844}
PATIENCE = 20_000
"""Milliseconds after which a test that waits for the browser fails."""
CHECK = """async () => {
  const { violations } = await axe.run(document, { resultTypes: ["violations"] });
  return violations.map(({ id, impact, nodes }) => [impact, id, nodes.map(({ html }) => html)]);
}"""
NOT_BEGUN = re.compile("Waiting|Connecting")
HAS_DRIVER = importlib.util.find_spec("playwright") is not None
BROWSER_TEST = [
    pytest.mark.asyncio(loop_scope="module"),
    pytest.mark.browser,
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt install chromium"),
    pytest.mark.skipif(not HAS_DRIVER, reason="needs playwright: pip install playwright"),
]
"""Marks of a module whose tests use the fixture `browser`."""


@asynccontextmanager
async def launched(*flags: str) -> AsyncIterator[Any]:
    """Start a browser. Each visit opens its own context in it."""
    from playwright import async_api as playwright

    playwright.expect.set_options(timeout=PATIENCE)
    async with playwright.async_playwright() as driver:
        started = await driver.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, *flags])
        yield started
        await started.close()


def expect(locator: Any) -> Any:
    from playwright import async_api as playwright

    return playwright.expect(locator)


async def axe_faults(page: Any) -> list[Any]:
    """Return the accessibility faults that axe finds on a page: impact, rule and elements."""
    await page.evaluate((libraries(Path(__file__).parent) / "axe-core/axe.min.js").read_text())
    found: list[Any] = await page.evaluate(CHECK)
    return found


def link(port: int, fragment: str, path: str = "play") -> str:
    """Return the address of a kitchen on a server of this machine."""
    return f"http://127.0.0.1:{port}/{path}#{fragment}"


@asynccontextmanager
async def visiting(
    browser: Any,
    url: str,
    name: str,
    size: dict[str, int] = DESKTOP,
    *,
    script: str = "",
    routes: Mapping[str, Callable[[Any], Awaitable[None]]] | None = None,
    enter: Callable[[Any, str], Awaitable[None]] | None = None,
    offline: bool = False,
    expected: str = "WebSocket connection",
    **options: Any,
) -> AsyncIterator[Any]:
    """Open a link and enter a name. Errors in the browser's console fail the test.

    Args:
        browser: The browser, in which the visit gets its own storage.
        url: The link.
        name: The name to enter.
        size: Size of the window.
        script: Script that runs before those of the page.
        routes: Answers to requests, by patterns of their addresses.
        enter: Enters the name, instead of the usual way.
        offline: Lose the network before the name is entered.
        expected: Text of errors that do not fail the test, besides lost connections.
        options: Further options of the browser's context.
    """
    errors: list[str] = []
    context = await browser.new_context(viewport=size, **options)
    await context.add_init_script(script or "0")
    for pattern, answer in (routes or {}).items():
        await context.route(pattern, answer)
    page = await context.new_page()
    page.set_default_timeout(PATIENCE)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    try:
        await page.goto(url)
        if enter:
            await enter(page, name)
        else:
            await page.fill("#name", name)
            await context.set_offline(offline)
            await page.click("#enter-button")
        yield page
    finally:
        await context.close()
    # A connection that the server closes is an error in the console.
    harmless = ("WebSocket connection", expected)
    assert [line for line in errors if not any(each in line for each in harmless)] == []


async def get_ready(page: Any) -> None:
    await page.get_by_role("button", name="I'm ready").click()


@asynccontextmanager
async def playing(
    browser: Any, links: tuple[str, str], **options: Any
) -> AsyncIterator[tuple[Any, Any]]:
    """Let Ada and Ben enter a real-time game from their links, and start it."""
    async with (
        visiting(browser, links[0], "Ada", **options) as ada,
        visiting(browser, links[1], "Ben", PHONE, **options) as ben,
    ):
        for page in (ada, ben):
            await get_ready(page)
            if page is ada:
                await expect(ben.locator("#cover li", has_text="Ada")).to_contain_text("ready")
                await expect(ada.locator("#status")).to_have_text("Waiting for Ben")
        for page in (ada, ben):
            await expect(page.locator("#status")).not_to_have_text(NOT_BEGUN)
        yield ada, ben
