"""Visits of the operator page in a real browser."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from tests.web.visits import PATIENCE

__all__ = ["DESKTOP", "browser_page"]

DESKTOP = {"width": 1280, "height": 800}


@asynccontextmanager
async def browser_page(
    browser: Any, url: str, size: dict[str, int] = DESKTOP, allow: str = "nothing", **options: Any
) -> AsyncIterator[Any]:
    """Open the page. Errors of the browser fail the test, unless they contain `allow`."""
    errors: list[str] = []
    page = await browser.new_page(viewport=size, **options)
    try:
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
        await page.goto(url)
        yield page
    finally:
        await page.close()
    assert [line for line in errors if allow not in line] == []
