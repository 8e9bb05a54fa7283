"""The examples that show the game inside the page of another program: jsPsych and oTree."""

from __future__ import annotations

import asyncio
import csv
import functools
import json
import re
import shutil
import socket
import subprocess
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.parse import quote
from urllib.request import Request, urlopen

import pytest

from robotouille.protocol import messages
from robotouille_server import Server
from robotouille_server.requests import Opening, open_episode
from tests.support.node import libraries
from tests.support.servers import serving
from tests.support.sources import ROOT
from tests.web.visits import BROWSER_TEST, DESKTOP, PATIENCE, expect

pytestmark = BROWSER_TEST

EMBED, OTREE = ROOT / "examples/embed", ROOT / "examples/otree"
TEAM, ALONE = "multi_agent/01_lettuce_burger@2", "synchronous/01"
SHORT = {"clock": "realtime", "step_rate": 10, "max_steps": 4, "tokens": True}


class Quiet(SimpleHTTPRequestHandler):
    """Handler of files that logs nothing."""

    def log_message(self, format: str, *args: Any) -> None:
        pass


@contextmanager
def files(folder: Path) -> Iterator[str]:
    """Serve a folder, and return its address."""
    server = ThreadingHTTPServer(("localhost", 0), functools.partial(Quiet, directory=folder))
    with server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://localhost:{server.server_port}"
        finally:
            server.shutdown()


def links(server: Server, task: str) -> dict[str, str]:
    """Open a short game, and return the links of its seats."""
    create = messages.Create.model_validate({"task": task, **SHORT})
    _, created = open_episode(server.services, Opening(request=create))
    page = f"http://127.0.0.1:{server.port}/play"
    return {player: f"{page}#{link}" for player, link in created.links.items()}


@asynccontextmanager
async def visit(browser: Any, url: str) -> AsyncIterator[Any]:
    context = await browser.new_context(viewport=DESKTOP)
    page = await context.new_page()
    page.set_default_timeout(PATIENCE)
    await page.goto(url)
    try:
        yield page
    finally:
        await context.close()


async def test_jspsych_experiment_stores_the_outcome(browser: Any, tmp_path: Path) -> None:
    libraries(EMBED)
    with files(EMBED) as lab:
        async with serving(tmp_path, page_parents=lab) as server:
            game = quote(links(server, ALONE)["robot1"], safe="")
            async with visit(browser, f"{lab}/experiment.html?game={game}") as page:
                await page.get_by_role("button", name="Begin").click()
                frame = page.frame_locator("iframe")
                await frame.get_by_role("button", name="I'm ready").click()
                await page.get_by_role("button", name="Well", exact=True).click()
                rows = json.loads(await page.locator("pre").inner_text())
            (room,) = server.lobby.rooms.values()
            assert [seat.name for seat in room.episode.seats.values()] == ["P07"]
    assert rows[1]["game"]["type"] == "ended"
    assert rows[1]["game"]["outcome"]["reason"] == "step_limit"
    assert rows[1]["game"]["outcome"]["steps"] == 4


def template_page(template: str, values: dict[str, str]) -> str:
    """Return a page as oTree makes it from a template: the blocks, in a form, with `js_vars`."""
    blocks = dict(re.findall(r"\{\{ block (\w+) \}\}(.*?)\{\{ endblock \}\}", template, re.DOTALL))
    return (
        f"<!doctype html><title>{blocks['title']}</title>{blocks['styles']}"
        f"<form id='form' action='/thanks.html' method='get'>{blocks['content']}</form>"
        f"<script>const js_vars = {json.dumps(values)};</script>{blocks['scripts']}"
    )


async def test_template_of_otree_submits_the_outcome(browser: Any, tmp_path: Path) -> None:
    """The template runs here in a form like oTree's; oTree itself need not be installed."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "thanks.html").write_text("thanks")
    with files(site) as lab:
        async with serving(tmp_path / "recordings", page_parents=lab) as server:
            values = {"link": links(server, ALONE)["robot1"], "name": "P01"}
            template = (OTREE / "cooking/Game.html").read_text()
            (site / "game.html").write_text(template_page(template, values))
            async with visit(browser, f"{lab}/game.html") as page:
                frame = page.frame_locator("#game")
                await frame.get_by_role("button", name="I'm ready").click()
                await page.wait_for_url(f"{lab}/thanks.html?outcome=step_limit&steps=4")
            (room,) = server.lobby.rooms.values()
            assert [seat.name for seat in room.episode.seats.values()] == ["P01"]


def free_port() -> int:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port: int = listening.getsockname()[1]
    return port


def asked(url: str, **body: Any) -> Any:
    request = Request(url, json.dumps(body).encode(), {"Content-Type": "application/json"})
    with urlopen(request, timeout=20) as answer:
        return json.loads(answer.read())


async def new_session(lab: str, program: subprocess.Popen[bytes]) -> list[str]:
    """Wait for oTree, create a session, and return the addresses of its participants."""
    async with asyncio.timeout(60):
        while program.poll() is None:
            try:
                body = {"session_config_name": "cooking", "num_participants": 2}
                made = await asyncio.to_thread(asked, f"{lab}/api/sessions", **body)
            except (HTTPError, URLError, ConnectionError):
                await asyncio.sleep(0.2)
                continue
            wide = made["session_wide_url"].rpartition("/join/")[2]
            return [f"{lab}/join/{wide}?participant_label={name}" for name in ("a", "b")]
    raise AssertionError("oTree has ended")


@pytest.mark.skipif(
    shutil.which("otree") is None,
    reason="needs oTree on the path: pip install otree, in an environment of its own",
)
async def test_two_players_of_an_otree_session_share_a_game(browser: Any, tmp_path: Path) -> None:
    project, port = tmp_path / "project", free_port()
    shutil.copytree(OTREE, project)
    lab = f"http://127.0.0.1:{port}"
    async with serving(tmp_path / "recordings", page_parents=lab) as server:
        seats = links(server, TEAM)
        with (project / "cooking/opened.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, [f"link.{player}" for player in seats])
            writer.writeheader()
            writer.writerow({f"link.{player}": link for player, link in seats.items()})
        program = subprocess.Popen(["otree", "devserver_inner", str(port)], cwd=project)
        try:
            ada, ben = await new_session(lab, program)
            async with visit(browser, ada) as first, visit(browser, ben) as second:
                for page in (first, second):
                    frame = page.frame_locator("#game")
                    await frame.get_by_role("button", name="I'm ready").click()
                for page in (first, second):
                    await expect(page.locator("body")).to_contain_text(
                        "The game ended: step_limit, after 4 steps."
                    )
            (room,) = server.lobby.rooms.values()
            assert [seat.name for seat in room.episode.seats.values()] == ["P01", "P02"]
        finally:
            program.terminate()
            program.wait(timeout=20)
