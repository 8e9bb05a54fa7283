"""Browsers, networks and kitchens that are not as they should be: the page recovers or says why."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from robotouille.installation import data_folder
from robotouille.protocol import messages
from robotouille_server import Server
from tests.support.servers import serving
from tests.web.visits import BROWSER_TEST, expect, get_ready, link, visiting

pytestmark = BROWSER_TEST

ALONE = "synchronous/01_cheese_sandwich"
MARKUP = "<script>document.title = 'harm'</script>"

NO_STORAGE = """
Object.defineProperty(window, "localStorage", {
  get() { throw new DOMException("forbidden", "SecurityError"); },
});
"""
WRONG_CLOCK = """
const real = Date.now;
// The clock is late first, and is then set.
Date.now = () => real() + (performance.now() < 4000 ? -3_600_000 : 3_600_000);
"""
LOST_DELTAS = """
let deltas = 0;
const { set } = Object.getOwnPropertyDescriptor(WebSocket.prototype, "onmessage");
Object.defineProperty(WebSocket.prototype, "onmessage", {
  set(take) {
    set.call(this, (event) => {
      if (event.data.includes('"type":"delta"') && (deltas += 1) % 7 === 0) return;
      take(event);
    });
  },
});
"""

OTHER_VERSION = """
const { send } = WebSocket.prototype;
WebSocket.prototype.send = function (text) {
  send.call(this, text.replace('"protocol":1', '"protocol":9'));
};
"""


def opened(server: Server, task: str = ALONE, **rules: Any) -> str:
    options = {"clock": "realtime", "step_rate": 10, "max_steps": 5000, **rules}
    return link(server.port, server.lobby.create(messages.Create(task=task, **options)).code)


async def plays(page: Any, step: int) -> None:
    """Wait until the game has passed a step, and actions can be chosen."""
    later = "|".join(str(step + more) for more in range(1, 400))
    await expect(page.locator("#progress")).to_have_attribute(
        "title", re.compile(rf"^({later}) of")
    )
    await expect(page.locator("#choices li").first).to_be_visible()


@pytest.mark.parametrize("script", [NO_STORAGE, WRONG_CLOCK, LOST_DELTAS])
async def test_unusual_browser_plays(browser: Any, tmp_path: Path, script: str) -> None:
    async with serving(tmp_path) as server:
        async with visiting(browser, opened(server), "Ada", script=script) as page:
            await get_ready(page)
            await plays(page, 50)
            await page.locator("#said").fill("hello")
            await page.keyboard.press("Enter")
            await expect(page.locator("#lines")).to_contain_text("Ada: hello")


async def test_page_of_another_version_asks_to_be_loaded_again(
    browser: Any, tmp_path: Path
) -> None:
    """A page may be open while its server is updated."""
    async with serving(tmp_path) as server:
        async with visiting(browser, opened(server), "Ada", script=OTHER_VERSION) as page:
            await expect(page.locator("#cover")).to_contain_text("different version")
            async with page.expect_navigation():
                await page.get_by_role("button", name="Try again").click()


async def test_lost_connection_while_a_kitchen_loads(browser: Any, tmp_path: Path) -> None:
    """The first requests for pictures fail, and the WebSocket closes before the look is here."""
    failures = iter(range(2))

    async def fail(route: Any) -> None:
        await (route.abort() if next(failures, None) is not None else route.continue_())

    cut = """
    const { send } = WebSocket.prototype;
    WebSocket.prototype.send = function (text) {
      if (!window.cut && text.includes("get_rendering")) window.cut = !this.close();
      else send.call(this, text);
    };
    """
    async with serving(tmp_path) as server:
        routes = {"**/pictures/kitchen.json": fail}
        url, expected = opened(server), "Failed to load resource"
        async with visiting(
            browser, url, "Ada", script=cut, routes=routes, expected=expected
        ) as page:
            await get_ready(page)
            await plays(page, 5)
            assert await page.evaluate("window.cut")


async def test_offline_browser_joins_when_it_is_online(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        async with visiting(
            browser, opened(server), "Ada", offline=True, expected="ERR_INTERNET"
        ) as page:
            await expect(page.locator("#status")).to_have_text("Connecting …")
            await page.context.set_offline(False)
            await get_ready(page)
            await plays(page, 5)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ("**/pictures/*", None),
        ("**/looks/*", "The kitchen could not be loaded"),
    ],
)
async def test_missing_files_of_a_kitchen(
    browser: Any, tmp_path: Path, files: str, words: str | None
) -> None:
    """Things without a picture are tiles with their names. Without a look, the page says so."""

    async def missing(route: Any) -> None:
        await route.fulfill(status=404, body="")

    async with serving(tmp_path) as server:
        routes, expected = {files: missing}, "404"
        async with visiting(
            browser, opened(server), "Ada", routes=routes, expected=expected
        ) as page:
            if words:
                await expect(page.locator("#cover")).to_contain_text(words)
                await expect(page.get_by_role("button", name="Try again")).to_be_visible()
            else:
                await get_ready(page)
                await plays(page, 5)


async def test_large_kitchen_of_a_stranger(browser: Any, tmp_path: Path) -> None:
    """Forty by thirty tiles, nine seats, and markup wherever a kitchen has words."""
    shipped = data_folder("problems") / "multi_agent/01_lettuce_burger.json"
    problem = json.loads(shipped.read_text(encoding="utf-8"))
    tables = [(x, y) for x in range(1, 39, 3) for y in range(8, 29, 3)]
    seats = [(2 + 3 * seat, 8) for seat in range(9)]
    problem |= {
        "width": 40,
        "height": 30,
        "ground": ["C" * 40] * 30,
        "seats": [9],
        "stations": problem["stations"] + [_at("table", spot) for spot in (*tables, *seats)],
        "players": [{**_at("robot", (x, 7)), "direction": [0, 1]} for x, _ in seats],
        "goal_description": MARKUP,
    }
    tasks = tmp_path / "tasks"
    tasks.mkdir()
    name = "<b>big<i>"
    (tasks / f"{name}.json").write_text(json.dumps(problem), encoding="utf-8")
    async with serving(tmp_path / "recordings", tasks=tasks, absence="bot") as server:
        async with visiting(browser, opened(server, name), MARKUP[:40]) as page:
            await expect(page.locator("#title")).to_have_text("<b>big<i>")
            await expect(page.locator("#cover li")).to_have_count(9)
            await expect(page.locator("#seats")).to_contain_text(MARKUP[:40])
            assert await page.title() == "Robotouille"


def _at(kind: str, spot: tuple[int, int]) -> dict[str, Any]:
    return {"name": kind, "x": spot[0], "y": spot[1]}
