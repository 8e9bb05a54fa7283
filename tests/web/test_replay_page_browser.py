"""Pages of recordings in a real browser, opened from disk without a network."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from robotouille.replay.annotations import Codebook, read_annotations
from robotouille.replay.recording import Recording
from robotouille.web.recording_page import page_data, replay_page
from robotouille.web.single_file import single_file
from robotouille.web.site import STATIC
from tests.support.games import recorded_game
from tests.support.random_play import talkative_stream

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

FLAGS = ["--no-sandbox", "--headless", "--disable-gpu", "--disable-quic", "--no-first-run"]
DESKTOP, PHONE = {"width": 1280, "height": 720}, {"width": 390, "height": 844}
PATIENCE = 20_000
"""Milliseconds after which a test that waits for the browser fails."""
EVIL = '<script>document.title = "evil"</script><img src="x" onerror="document.title = \'evil\'">'
STEPS = 200


@pytest.fixture(scope="module")
def game() -> Recording:
    return Recording(recorded_game("multi_agent/09@2", steps=STEPS))


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser() -> AsyncIterator[Any]:
    """Start one browser for all tests. Each page opens its own context in it."""
    from playwright import async_api as playwright

    playwright.expect.set_options(timeout=PATIENCE)
    async with playwright.async_playwright() as driver:
        started = await driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield started
        await started.close()


def expect(locator: Any) -> Any:
    from playwright import async_api as playwright

    return playwright.expect(locator)


@asynccontextmanager
async def opened(
    browser: Any, content: str, folder: Path, size: dict[str, int] = DESKTOP, **options: Any
) -> AsyncIterator[Any]:
    """Open a page from disk. Errors in the console, and requests, fail the test."""
    file = folder / "page.html"
    file.write_text(content, encoding="utf-8")
    errors: list[str] = []
    requests: list[str] = []
    context = await browser.new_context(viewport=size, locale="en-US", **options)
    await context.set_offline(True)
    page = await context.new_page()
    page.set_default_timeout(PATIENCE)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    page.on("request", lambda request: requests.append(request.url))
    try:
        await page.goto(file.as_uri())
        await expect(page.locator("#position")).to_contain_text("Step 0 of")
        yield page
    finally:
        await context.close()
    assert errors == []
    assert [url for url in requests if not url.startswith(("data:", file.as_uri()))] == []


async def shown_atoms(page: Any, run: int = 0) -> tuple[int, list[str]]:
    """Return the step that the page shows, and the facts of its state."""
    step, names = await page.evaluate(
        "run => { const { step, reel } = robotouille.runs[run];"
        " return [step, reel.state(step).names()]; }",
        run,
    )
    return step, names


async def test_states_are_those_of_the_recording(
    browser: Any, game: Recording, tmp_path: Path
) -> None:
    states = dict(game.states())
    async with opened(browser, replay_page([("game", game)]), tmp_path) as page:
        for step in (0, 1, 63, 64, 65, 130, STEPS, 128, 7):
            await page.evaluate("step => robotouille.player.seek(step)", step)
            await expect(page.locator("#position")).to_contain_text(f"Step {step} of {STEPS}")
            shown, atoms = await shown_atoms(page)
            assert shown == step
            assert atoms == sorted(states[step].fact_names())


async def test_keys_play_step_and_jump(browser: Any, game: Recording, tmp_path: Path) -> None:
    async with opened(browser, replay_page([("game", game)]), tmp_path) as page:
        position = page.locator("#position")
        for key, step in (
            ("ArrowRight", 1),
            ("Shift+ArrowRight", 11),
            ("ArrowLeft", 10),
            ("End", STEPS),
            ("Home", 0),
        ):
            await page.keyboard.press(key)
            await expect(position).to_contain_text(f"Step {step} of")
        await page.keyboard.press("+")
        await expect(page.get_by_label("Speed")).to_have_value("2")
        await page.keyboard.press("Space")
        await expect(page.get_by_role("button", name="Pause")).to_be_visible()
        await expect(position).not_to_contain_text("Step 0 of")
        await page.keyboard.press("Space")
        await expect(page.get_by_role("button", name="Play")).to_be_visible()


async def test_play_ends_at_the_last_step(browser: Any, tmp_path: Path) -> None:
    game = Recording(recorded_game("synchronous/01", steps=12))
    content = replay_page([("game", game)])
    async with opened(browser, content, tmp_path, reduced_motion="reduce") as page:
        await page.get_by_label("Speed").select_option("8")
        await page.get_by_role("button", name="Play").click()
        await expect(page.locator("#position")).to_contain_text(f"Step {game.length} of")
        await expect(page.get_by_role("button", name="Play")).to_be_visible()
        await expect(page.locator("#outcome")).to_contain_text("steps")


async def test_timeline_is_a_slider_for_mouse_and_screen_reader(
    browser: Any, game: Recording, tmp_path: Path
) -> None:
    async with opened(browser, replay_page([("game", game)]), tmp_path) as page:
        slider = page.get_by_role("slider")
        await slider.click(position={"x": 400, "y": 20})
        value = int(await slider.get_attribute("aria-valuenow"))
        assert 0 < value < STEPS
        assert f"Step {value} of {STEPS}" in await slider.get_attribute("aria-valuetext")
        box = await slider.bounding_box()
        await page.mouse.move(box["x"] + 100, box["y"] + 20)
        await page.mouse.down()
        await page.mouse.move(box["x"] + box["width"] + 50, box["y"] + 20)
        await page.mouse.up()
        await expect(page.locator("#position")).to_contain_text(f"Step {STEPS} of")


async def test_texts_of_participants_are_never_markup(browser: Any, tmp_path: Path) -> None:
    stream = talkative_stream((EVIL, "p"), EVIL, "s", EVIL)
    async with opened(browser, replay_page([(EVIL, Recording(stream))]), tmp_path) as page:
        await page.keyboard.press("End")
        await expect(page.locator(".line.said").first).to_contain_text("<script>")
        assert await page.locator("#replay script, img[onerror]").count() == 0
        assert "evil" not in await page.title()


async def test_two_recordings_go_by_step_or_by_time(browser: Any, tmp_path: Path) -> None:
    games = [Recording(recorded_game("synchronous/01", seed=n, steps=40 - n)) for n in (0, 10)]
    content = replay_page([(f"game {n}", game) for n, game in enumerate(games)])
    async with opened(browser, content, tmp_path) as page:
        await page.evaluate("robotouille.player.seek(20)")
        await expect(page.locator("#position")).to_contain_text("Step 20 of")
        for run, game in enumerate(games):
            step, atoms = await shown_atoms(page, run)
            assert step == 20
            assert atoms == sorted(dict(game.states())[20].fact_names())
        await page.get_by_role("button", name="By time").click()
        assert (await shown_atoms(page, 0))[0] == 20
        await page.get_by_role("button", name="Recording 2").click()
        await expect(page.get_by_role("button", name="Recording 2")).to_have_attribute(
            "aria-pressed", "true"
        )


async def test_labels_are_set_by_keys_and_saved(
    browser: Any, game: Recording, tmp_path: Path
) -> None:
    labels = [{"id": "help", "title": EVIL, "key": "h"}, {"id": "wait", "title": "W", "key": "w"}]
    codebook = Codebook.model_validate({"labels": labels})
    content = replay_page([("game", game)], codebook=codebook)
    async with opened(browser, content, tmp_path, accept_downloads=True) as page:
        await page.evaluate("robotouille.player.seek(20)")
        await page.keyboard.press("h")
        await page.keyboard.press("Shift+W")
        await page.evaluate("robotouille.player.seek(12)")
        await expect(page.locator("#position")).to_contain_text("Step 12 of")
        await page.keyboard.press("w")
        save = page.get_by_role("button", name="Save the labels")
        await save.click()
        await expect(page.locator(".coding [role=status]")).to_contain_text("Enter the coder")
        await page.keyboard.type("when h w")
        async with page.expect_download() as saving:
            await save.click()
        file = tmp_path / "labels.json"
        await (await saving.value).save_as(file)
        assert await page.locator(".coding img").count() == 0
    found = read_annotations(file)
    assert (found.coder, found.steps, found.labels) == ("when h w", STEPS, ("help", "wait"))
    spans = [(each.label, each.first, each.last) for each in found.annotations]
    assert spans == [("wait", 12, 20), ("help", 20, 20)]


async def test_phone_shows_everything_without_scrolling_sideways(
    browser: Any, game: Recording, tmp_path: Path
) -> None:
    content = replay_page([("game", game)])
    async with opened(browser, content, tmp_path, PHONE, has_touch=True) as page:
        await page.locator(".stage").tap()
        await expect(page.get_by_role("button", name="Pause")).to_be_visible()
        await page.get_by_role("button", name="Pause").tap()
        assert await page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        for name in ("Beginning", "One step on", "End"):
            box = await page.get_by_role("button", name=name, exact=True).bounding_box()
            assert min(box["width"], box["height"]) >= 42


async def test_states_that_contradict_the_task_give_a_message(
    browser: Any, game: Recording, tmp_path: Path
) -> None:
    data = page_data([("game", game)])
    data["recordings"][0]["deltas"][100] = {"add": [10**6]}
    html = (STATIC / "replay/index.html").read_text(encoding="utf-8")
    file = tmp_path / "page.html"
    file.write_text(single_file("replay/main.js", html, ["page.css", "replay/replay.css"], data))
    page = await browser.new_page()
    await page.goto(file.as_uri())
    await expect(page.locator("#message")).to_contain_text("cannot be shown")
    await expect(page.locator("#replay")).to_be_hidden()
    await page.close()


async def test_old_browsers_show_why_they_cannot(
    browser: Any, game: Recording, tmp_path: Path
) -> None:
    file = tmp_path / "page.html"
    file.write_text(replay_page([("game", game)]), encoding="utf-8")
    page = await browser.new_page()
    await page.add_init_script("delete globalThis.DecompressionStream")
    await page.goto(file.as_uri())
    await expect(page.locator("#message")).to_contain_text("too old")
    await page.close()
