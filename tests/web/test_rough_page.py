"""The page behind a slow connection, and behind one that loses packets.

The server runs in a network namespace, with the kernel's TCP.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from tests.support.processes import process
from tests.support.unreliable_link import UnavailableError, UnreliableLink, unreliable_link
from tests.web.visits import BROWSER_TEST, expect, get_ready, visiting

pytestmark = BROWSER_TEST

HALF_ROUND_TRIP, RATE = 0.05, 10_000_000 / 8
"""Seconds one way, and bytes a second."""
STEPS = 40
DRAWN = """
const { drawImage } = CanvasRenderingContext2D.prototype;
CanvasRenderingContext2D.prototype.drawImage = function (...given) {
  if (this.canvas.id === "kitchen") window.drawn = true;
  return drawImage.apply(this, given);
};
"""
# Chromium reports that it ignores this header without TLS.
EXPECTED = "Cross-Origin-Opener-Policy"
CHOOSE = "document.querySelector('#choices button')?.click()"


@contextmanager
def kitchen(folder: Path, line: UnreliableLink) -> Iterator[str]:
    """Run a server behind a link; yield the address of a kitchen for one."""
    rules = ("--mode", "realtime", "--step-rate", "5", "--max-steps", str(STEPS))
    task = ("--task", "synchronous/01_cheese_sandwich", "--countdown", "0")
    flags = ("--host", line.address, *rules, *task)
    with process(folder, *flags, prefix=line.prefix) as (_, url, code):
        yield f"http{url.removeprefix('ws')}/play#{code}"


@contextmanager
def link(**faults: float) -> Iterator[UnreliableLink]:
    try:
        with unreliable_link(delay=HALF_ROUND_TRIP, rate=RATE, seed=3, **faults) as line:
            yield line
    except UnavailableError as error:
        pytest.skip(str(error))


async def test_first_picture_of_a_game_needs_few_bytes(browser: Any, tmp_path: Path) -> None:
    with link() as line, kitchen(tmp_path, line) as url:
        async with visiting(
            browser, url, "Ada", script=DRAWN, expected=EXPECTED, bypass_csp=True
        ) as page:
            await page.wait_for_function("window.drawn")
            assert 30_000 < line.received <= 120 * 1024


async def test_game_on_a_line_that_loses_packets_is_played_to_its_end(
    browser: Any, tmp_path: Path
) -> None:
    with link(loss=0.03, jitter=0.02) as line, kitchen(tmp_path, line) as url:
        async with visiting(browser, url, "Ada", expected=EXPECTED) as page:
            await get_ready(page)
            await expect(page.locator("#cover")).to_be_hidden()
            while await page.locator("#cover").is_hidden():
                await page.evaluate(CHOOSE)
                await page.wait_for_timeout(300)
            await expect(page.locator("#cover")).to_contain_text("Time is up")
        assert line.lost > 0
        recording = read_recording(next(tmp_path.glob("*.rbt")))
    assert recording.verify().ok
    acted = [move["seq"] for frame in recording.steps for move in frame["moves"]]
    assert len(acted) >= 5
    assert acted == sorted(set(acted)), "each action was done once, in its order"
