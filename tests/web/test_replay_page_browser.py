"""Pages of recordings in a real browser, opened from disk without a network."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robotouille.replay.annotations import Codebook, read_annotations
from robotouille.replay.recording import Recording
from robotouille.web.recording_page import page_data, replay_page
from robotouille.web.single_file import encoded, single_file
from robotouille.web.site import STATIC
from robotouille_client.cli.main import app
from tests.support.games import recorded_game
from tests.support.random_play import talkative_stream
from tests.support.replay_pages import FACT_NAMES
from tests.web.visits import BROWSER_TEST, DESKTOP, PATIENCE, PHONE, axe_faults, expect

pytestmark = BROWSER_TEST

EVIL = '<script>document.title = "evil"</script><img src="x" onerror="document.title = \'evil\'">'
STEPS = 200


@pytest.fixture(scope="module")
def game() -> Recording:
    return Recording(recorded_game("multi_agent/09@2", steps=STEPS))


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
        f" return [step, reel.state(step).{FACT_NAMES}]; }}",
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
        await expect(slider).not_to_have_attribute("aria-valuenow", "0")
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


async def saved_labels(
    browser: Any, content: str, folder: Path, coder: str, spans: tuple[tuple[int, int], ...]
) -> Path:
    """Let a coder mark spans of steps by keyboard alone, and save them."""
    folder.mkdir()
    async with opened(browser, content, folder, accept_downloads=True) as page:
        step = 0
        for first, last in spans:
            for key, target in (("h" if first == last else "Shift+H", first), ("h", last)):
                for _ in range(target - step):
                    await page.keyboard.press("ArrowRight")
                await expect(page.locator("#position")).to_contain_text(f"Step {target} of")
                if (key, target) != ("h", first):
                    await page.keyboard.press(key)
                step = target
            if first == last:
                await page.keyboard.press("h")
        await page.get_by_role("button", name="Save the labels").focus()
        await page.keyboard.press("Enter")
        await page.keyboard.type(coder)
        async with page.expect_download() as saving:
            await page.keyboard.press("Tab")
            await page.keyboard.press("Enter")
        file = folder / "labels.json"
        await (await saving.value).save_as(file)
    return file


async def test_agreement_of_two_coders_is_as_computed_by_hand(browser: Any, tmp_path: Path) -> None:
    """Meg marks steps 1 and 8 of 10, and Owen 0 to 2 and 5, as in Krippendorff's example."""
    game = Recording(recorded_game("synchronous/01", steps=9))
    assert game.length == 9
    codebook = Codebook.model_validate({"labels": [{"id": "help", "title": "Help", "key": "h"}]})
    content = replay_page([("game", game)], codebook=codebook)
    coders = {"meg": ((1, 1), (8, 8)), "owen": ((0, 2), (5, 5))}
    files = [
        str(await saved_labels(browser, content, tmp_path / coder, coder, spans))
        for coder, spans in coders.items()
    ]
    done = CliRunner().invoke(app, ["replay", "agreement", *files, "--json"])
    (found,) = json.loads(done.output)
    # Both agree on 6 steps of 10, and by chance on 0.2 * 0.4 + 0.8 * 0.6 = 0.56.
    assert found["kappa"] == pytest.approx((0.6 - 0.56) / (1 - 0.56))
    # Values 20, ones 6, zeros 14, steps that differ 4.
    assert found["alpha"] == pytest.approx(1 - 19 * 8 / (2 * 6 * 14))


async def test_page_has_no_accessibility_faults(
    browser: Any, game: Recording, tmp_path: Path
) -> None:
    talk = Recording(talkative_stream(("ada", "p"), "sam", "s", "words"))
    codebook = Codebook.model_validate({"labels": [{"id": "idle", "title": "Idle", "key": "l"}]})
    pages = {
        "two": replay_page([("one", game), ("other", game)]),
        "talk": replay_page([("talk", talk)], codebook=codebook),
    }
    for content in pages.values():
        async with opened(browser, content, tmp_path, reduced_motion="reduce") as page:
            for size in (DESKTOP, PHONE):
                await page.set_viewport_size(size)
                assert await axe_faults(page) == [], size
            await page.keyboard.press("End")
            await page.keyboard.press("l")
            assert await axe_faults(page) == []
            await page.get_by_role("button", name="Help").click()
            await expect(page.get_by_role("dialog")).to_be_visible()
            assert await axe_faults(page) == []


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
    data = json.loads(encoded(page_data([("game", game)])))
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
