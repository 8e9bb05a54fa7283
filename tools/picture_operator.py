"""Draw docs/images/operator.png: the operator page during a study.

python tools/picture_operator.py [--out OUT.png]

Needs the extra `operator`, playwright and Debian's chromium. Takes about a minute.
"""

from __future__ import annotations

import argparse
import asyncio
import shutil
import tempfile
from collections.abc import Sequence
from contextlib import AsyncExitStack
from pathlib import Path

from playwright.async_api import async_playwright

from robotouille.episode import Clock
from robotouille_client import connect
from robotouille_client.bots import play
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_server import ServerSettings, serve
from robotouille_server.operator import operator_view

IMAGE = Path(__file__).parents[1] / "docs" / "images" / "operator.png"
SIZE = {"width": 1280, "height": 860}
SECONDS = 45.0
PAIRS = (
    (
        "multi_agent/01",
        {"condition": "human", "pair": "p1", "round": "2"},
        ("margaret", "katherine"),
    ),
    ("multi_agent/10@2", {"condition": "bot", "pair": "p2", "round": "1"}, ("alan", "grace")),
    ("multi_agent/05", {"condition": "bot", "pair": "p3", "round": "1"}, ("tony",)),
    ("multi_agent/03", {"condition": "human", "pair": "p4", "round": "3"}, ("barbara", "edsger")),
)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync"]


async def draw(folder: Path, out: Path) -> None:
    """Let bots play under people's names and take the picture."""
    settings = ServerSettings(port=0, recordings=folder, mode=Clock.REALTIME)
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serve(settings))
        view = await stack.enter_async_context(operator_view(server, port=0))
        lab = await stack.enter_async_context(connect(server.url, name="lab"))
        playing = []
        for number, (task, labels, names) in enumerate(PAIRS):
            made = await lab.create(
                task, clock="realtime", step_rate=4, timing="people", labels=labels
            )
            for seat, name in enumerate(names):
                kind = "model" if labels["condition"] == "bot" and seat else "human"
                client = await stack.enter_async_context(
                    connect(server.url, name=name, kind=kind)  # type: ignore[arg-type]
                )
                game = await client.join(made.code)
                bot = BotKind.PLANNER if seat == 0 else BotKind.RANDOM
                playing.append(asyncio.create_task(play(game, policy_maker(bot, number))))
        await asyncio.sleep(SECONDS)
        async with async_playwright() as web:
            browser = await web.chromium.launch(
                executable_path=shutil.which("chromium"), args=FLAGS
            )
            page = await browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
            await page.goto(view.url)
            await page.locator("article", has_text="p2").get_by_text("Watch").click()
            await page.wait_for_timeout(4_000)
            await page.screenshot(path=out)
            await browser.close()
        for task in playing:
            task.cancel()


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=IMAGE, help="output file")
    out = parser.parse_args(arguments).out
    with tempfile.TemporaryDirectory() as name:
        asyncio.run(draw(Path(name), out))
    print(out)


if __name__ == "__main__":
    main()
