"""Replays of recordings on the operator's port, in a real browser."""

from __future__ import annotations

import gzip
import json
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from http import HTTPStatus
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille.replay.annotations import read_annotations
from robotouille.replay.recording import Recording
from robotouille.web.recording_page import page_data
from robotouille.web.single_file import encoded
from robotouille_server.auth import Role
from robotouille_server.operator.recordings import replay_pages
from tests.operator.visits import browser_page
from tests.support.games import recorded_game
from tests.support.operator import audited, bearer, table, viewing
from tests.support.random_play import talkative_stream
from tests.support.replay_pages import FACT_NAMES
from tests.web.visits import BROWSER_TEST, axe_faults, expect

pytestmark = BROWSER_TEST

NAME = "20260101T000000Z_burger_1.rbt"
EVIL = '<script>document.title = "evil"</script><img src="x" onerror="document.title = 1">'
STEPS = 60


@pytest.fixture(scope="module")
def stream() -> bytes:
    return recorded_game("multi_agent/09@2", steps=STEPS)


@asynccontextmanager
async def opened_replay(page: Any) -> AsyncIterator[Any]:
    """Open the replay of the only recording from the operator page."""
    await page.get_by_role("tab", name="Recordings").click()
    async with page.expect_popup() as popup:
        await page.get_by_role("link", name="Replay").click()
    replay = await popup.value
    errors: list[str] = []
    replay.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    await expect(replay.locator("#position")).to_contain_text("Step 0 of")
    yield replay
    # The browser reports the answer to a codebook that the server refuses.
    assert [line for line in errors if "status of 400" not in line] == []


async def test_data_are_those_of_the_page_in_a_file(
    browser: Any, tmp_path: Path, stream: bytes
) -> None:
    (tmp_path / NAME).write_bytes(stream)
    async with viewing(tmp_path) as (_, _, api):
        answer = await api.http.get(f"/api/recordings/{NAME}/replay")
        assert answer.headers["content-type"] == "application/gzip"
        data = json.loads(gzip.decompress(answer.content))
        expected = page_data([(NAME.removesuffix(".rbt"), Recording(stream))])
        assert data == json.loads(encoded(expected))
    assert audited(tmp_path)[-1]["what"] == "replay"


async def test_token_of_the_operator_page_opens_the_replay(
    browser: Any, tmp_path: Path, stream: bytes
) -> None:
    (tmp_path / NAME).write_bytes(stream)
    async with viewing(tmp_path, tokens=True) as (server, port, _):
        async with browser_page(browser, port.url, allow="401") as page:
            minted = server.tokens.mint_role(Role.OPERATOR, "lab", seconds=3600)
            await page.get_by_label("Token").fill(minted)
            await page.get_by_role("button", name="Sign in").click()
            async with opened_replay(page) as replay:
                assert replay.url == f"{port.url}replay#{NAME}"
                await replay.keyboard.press("End")
                await expect(replay.locator("#position")).to_contain_text(f"Step {STEPS} of")
                shown = await replay.evaluate(f"robotouille.runs[0].reel.state(60).{FACT_NAMES}")
                states = dict(Recording(stream).states())
                assert shown == sorted(states[STEPS].fact_names())
                assert await axe_faults(replay) == []


async def test_running_game_is_shown_up_to_its_last_step(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, port, _), table(server, step_rate=20) as play:
        await play.until(lambda game: game.step >= 5)
        server.lobby.rooms[play.episode].pause()
        async with browser_page(browser, port.url) as page, opened_replay(page) as replay:
            step = server.lobby.rooms[play.episode].episode.step
            await expect(replay.locator("#position")).to_contain_text(f"Step 0 of {step}")


async def test_texts_of_participants_are_never_markup(browser: Any, tmp_path: Path) -> None:
    (tmp_path / NAME).write_bytes(talkative_stream((EVIL, "p"), EVIL, "s", EVIL))
    async with viewing(tmp_path) as (_, port, _), browser_page(browser, port.url) as page:
        async with opened_replay(page) as replay:
            await replay.keyboard.press("End")
            await expect(replay.locator(".line.said").first).to_contain_text("<script>")
            assert await replay.locator("#replay script, img[onerror]").count() == 0
            assert "evil" not in await replay.title()


async def test_labels_of_a_codebook_are_saved_as_a_file(
    browser: Any, tmp_path: Path, stream: bytes
) -> None:
    recordings, codebook = tmp_path / "recordings", tmp_path / "codebook.json"
    recordings.mkdir()
    (recordings / NAME).write_bytes(stream)
    codebook.write_text(json.dumps({"labels": [{"id": "help", "title": EVIL, "key": "H"}]}))
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps({"labels": [{"id": "help", "title": "Help", "key": " "}]}))
    async with viewing(recordings) as (_, port, _), browser_page(browser, port.url) as page:
        async with opened_replay(page) as replay:
            for file in (wrong, codebook):
                async with replay.expect_file_chooser() as choosing:
                    await replay.get_by_role("button", name="Codebook").click()
                await (await choosing.value).set_files(file)
                if file is wrong:
                    await expect(replay.locator("#bar [role=alert]")).to_contain_text(
                        "wrong.json is not a codebook: invalid labels.0.key"
                    )
            await expect(replay.locator(".coding")).to_contain_text("<script>")
            await replay.keyboard.press("ArrowRight")
            await replay.keyboard.press("h")
            await replay.get_by_label("Coder").fill("c1")
            async with replay.expect_download() as saving:
                await replay.get_by_role("button", name="Save the labels").click()
            saved = tmp_path / "labels.json"
            await (await saving.value).save_as(saved)
    found = read_annotations(saved)
    assert [(each.label, each.first, each.last) for each in found.annotations] == [("help", 1, 1)]
    assert found.coder == "c1"


async def test_aborted_requests_keep_no_place(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stream: bytes
) -> None:
    (tmp_path / NAME).write_bytes(stream)
    path = f"/api/recordings/{NAME}/replay"
    async with viewing(tmp_path) as (_, _, api):
        with monkeypatch.context() as patch:
            patch.setattr(
                replay_pages, "COMMAND", (sys.executable, "-c", "import time; time.sleep(600)")
            )
            for _ in range(replay_pages.AT_ONCE + replay_pages.MAX_WAITING + 2):
                with pytest.raises(httpx.ReadTimeout):
                    await api.http.get(path, timeout=0.2)
        assert (await api.http.get(path)).status_code == HTTPStatus.OK


async def test_recordings_that_cannot_be_shown_are_explained(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stream: bytes
) -> None:
    (tmp_path / NAME).write_bytes(b"not a recording")
    large = NAME.replace("_1", "_2")
    (tmp_path / large).write_bytes(stream)
    monkeypatch.setattr(replay_pages, "MAX_REPLAYED", len(stream) - 1)
    async with viewing(tmp_path, tokens=True) as (server, port, api):
        headers = bearer(server)
        for name, status, words in (
            (NAME, 422, "not a"),
            (large, 422, "larger than"),
            ("nothing.rbt", 404, "no recording"),
            ("..%2Fsecret.rbt", 404, ""),
        ):
            answer = await api.http.get(f"/api/recordings/{name}/replay", headers=headers)
            assert answer.status_code == status
            assert words in answer.json()["message"]
        other = bearer(server, episode="KQXZB-MHTWA")
        answer = await api.http.get(f"/api/recordings/{NAME}/replay", headers=other)
        assert (answer.status_code, answer.json()["code"]) == (403, "auth/episode")
    async with viewing(tmp_path) as (_, port, _):
        async with browser_page(browser, f"{port.url}replay#{NAME}", allow="422") as page:
            await expect(page.get_by_role("alert")).to_contain_text("cannot be shown")


async def test_slow_process_is_ended(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stream: bytes
) -> None:
    (tmp_path / NAME).write_bytes(stream)
    monkeypatch.setattr(replay_pages, "SECONDS", 0.01)
    async with viewing(tmp_path) as (_, _, api):
        answer = await api.http.get(f"/api/recordings/{NAME}/replay")
        assert (answer.status_code, answer.json()["code"]) == (422, "recording/unshown")
        assert "0.01 s" in answer.json()["message"]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of data")
async def test_process_that_needs_too_much_memory_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stream: bytes
) -> None:
    (tmp_path / NAME).write_bytes(stream)
    start = "from robotouille.web import recording_data as made\nmade.MAX_MEMORY = 1\nmade.main()"
    monkeypatch.setattr(replay_pages, "COMMAND", (sys.executable, "-c", start))
    async with viewing(tmp_path) as (_, _, api):
        answer = await api.http.get(f"/api/recordings/{NAME}/replay")
        assert (answer.status_code, answer.json()["code"]) == (422, "recording/unshown")
        assert "of memory" in answer.json()["message"]


async def test_policy_of_the_replay_allows_no_inline_scripts(browser: Any, tmp_path: Path) -> None:
    async with viewing(tmp_path, tokens=True) as (_, _, api):
        answer = await api.http.get("/replay")
        assert answer.status_code == 200
        policy = answer.headers["content-security-policy"]
        assert "script-src 'self';" in policy
        assert "connect-src 'self';" in policy
        assert "frame-ancestors 'none'" in policy
        assert "<script>" not in answer.text
        assert "style=" not in answer.text
