"""The page behind nginx and Caddy as the guide configures them, and on servers of several parts."""

from __future__ import annotations

import re
import signal
from collections.abc import AsyncIterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from robotouille.protocol import messages
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from tests.operations.proxies import NAME, PROXIES, front_door, program
from tests.support.clusters import cluster_of
from tests.support.processes import process
from tests.support.worker_processes import free_ports, workers
from tests.web.visits import BROWSER_TEST, expect, launched, link, playing

pytestmark = BROWSER_TEST

TASK, FOREIGN = "multi_agent/01_lettuce_burger@2", "other.example.org"
BEHIND = ("--trust-proxy", "loopback", "--page-names", NAME)
RULES = ("--task", TASK, "--mode", "realtime", "--step-rate", "5", "--countdown", "0")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser() -> AsyncIterator[Any]:
    """Start a browser that looks for the names of the tests on this machine."""
    rules = ",".join(f"MAP {name} 127.0.0.1" for name in (NAME, FOREIGN))
    async with launched(f"--host-resolver-rules={rules}") as started:
        yield started


async def play_a_little(browser: Any, links: tuple[str, str]) -> None:
    """Let two people walk and chat."""
    async with playing(browser, links, ignore_https_errors=True) as (ada, ben):
        for page, other in ((ada, ben), (ben, ada)):
            await page.keyboard.press("ArrowDown")
            await page.get_by_role("button", name="Thanks").click()
            await expect(other.locator("#lines")).to_contain_text("Thank you")
        for page in (ada, ben):
            await expect(page.locator("#progress")).to_have_attribute(
                "title", re.compile(r"^([4-9]|\d\d+) of")
            )


def assert_people_played(recordings: Path) -> None:
    found = map(read_recording, [*recordings.rglob("*.rbt"), *recordings.rglob("*.rbt.part")])
    # Each server opens a kitchen at its start, which nobody need enter.
    (recording,) = (each for each in found if each.participants)
    assert sorted(recording.participants.values()) == [("Ada", "human"), ("Ben", "human")]
    assert any(recording.actions(frame) for frame in recording.steps)


async def refused(browser: Any, url: str) -> bool:
    """Return whether the server does not show the page at an address.

    Caddy has no certificate for a name that is not its own. nginx passes the request on.
    """
    from playwright.async_api import Error

    context = await browser.new_context(ignore_https_errors=True)
    page = await context.new_page()
    try:
        answer = await page.goto(url)
    except Error as error:
        return "ERR_SSL" in str(error)
    finally:
        await context.close()
    return bool(answer.status == 421)


@pytest.fixture(params=PROXIES)
def proxy(request: pytest.FixtureRequest) -> Any:
    if not program(request.param):
        pytest.skip(f"{request.param} is not installed")
    return PROXIES[request.param]


async def test_people_play_through_a_proxy(browser: Any, tmp_path: Path, proxy: Any) -> None:
    recordings, port = tmp_path / "recordings", free_ports(1)
    site = f"https://{NAME}:{port}"
    # The guide's proxies listen on the usual port, which needs no entry.
    with process(recordings, *BEHIND, *RULES, "--origins", site) as (server, url, code):
        with proxy(tmp_path, port, int(url.rpartition(":")[2]), 1):
            await play_a_little(browser, (f"{site}/play#{code}",) * 2)
            assert await refused(browser, f"https://{FOREIGN}:{port}/play#{code}")
        server.send_signal(signal.SIGINT)
        server.wait(timeout=30)
    assert_people_played(recordings)


@pytest.mark.parametrize("name", [None, "nginx"])
async def test_link_works_at_each_worker(browser: Any, tmp_path: Path, name: str | None) -> None:
    """The page of one worker follows the redirect to the other, directly or through a proxy."""
    if name and not program(name):
        pytest.skip(f"{name} is not installed")
    recordings, port = tmp_path / "recordings", free_ports(1)
    door = front_door(port).replace("localhost", NAME)
    site = f"https://{NAME}:{port}"
    proxied = (*BEHIND, "--origins", site, "--worker-url", f"{door}/w{{worker}}")
    flags = proxied if name else ()
    with ExitStack() as stack:
        _, first = stack.enter_context(workers(recordings, 2, "--countdown", "0", *flags))
        async with connect(f"ws://127.0.0.1:{first + 1}", name="lab") as lab:
            created = await lab.create(TASK, clock="realtime", step_rate=5)
        if name:
            stack.enter_context(PROXIES[name](tmp_path, port, first, 2))
            links = (f"{site}/play#{created.code}",) * 2
        else:
            links = link(first + 1, created.code), link(first + 2, created.code)
        await play_a_little(browser, links)
    assert_people_played(recordings)


async def test_link_works_at_each_node_of_a_cluster(browser: Any, tmp_path: Path) -> None:
    async with cluster_of(tmp_path, 2, page_names="127.0.0.1") as nodes:
        ports = [node.server.port for node in nodes]
        for node in nodes:
            # On machines of their own, all nodes have the same port.
            for port in ports:
                node.server.listener._pages.listens("", port)
        lobby = nodes[0].server.lobby
        room = lobby.create(messages.Create(task=TASK, clock="realtime", step_rate=5))
        await play_a_little(browser, (link(ports[0], room.code), link(ports[1], room.code)))
        assert [seat.kind for seat in room.episode.seats.values()] == ["human", "human"]
