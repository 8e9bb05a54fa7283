"""Odd or large recordings: each one opens, or is refused with a reason."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.games import record, recorded_game
from tests.support.window_play import post
from tests.support.window_session import WindowSession, wait
from typer.testing import CliRunner

from robotouille import World, load_task
from robotouille.episode import Clock, Episode, Rules
from robotouille.installation import data_folder
from robotouille.replay.compression import compress
from robotouille.replay.container import MAGIC
from robotouille_client.cli.main import app
from robotouille_client.window.replay.viewer import RecordingViewer

Opener = Callable[..., RecordingViewer]
REFUSED = {
    "empty": (lambda: b"", "not a recording"),
    "text": (lambda: b"nothing of the kind\n" * 40, "not a recording"),
    "version": (lambda: MAGIC[:-1] + b"\x09" + b"\0" * 40, "format version 9"),
    "torn_header": (
        lambda: recorded_game("multi_agent/01", steps=3)[:900],
        "the header is missing",
    ),
    "cut_at_once": (lambda: compress(recorded_game("multi_agent/01", steps=3))[:900], "cut off"),
}


def use_all(viewer: RecordingViewer) -> None:
    """Visit every page and both ends."""
    keys = (pygame.K_l, pygame.K_END, pygame.K_LEFT, pygame.K_COMMA, pygame.K_f, pygame.K_h)
    for key in (*keys, pygame.K_h, pygame.K_HOME, pygame.K_PERIOD):
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
        viewer.window.frame(viewer)


# Refused


@pytest.mark.parametrize("name", REFUSED)
def test_the_command_line_gives_the_reason(name: str, tmp_path: Path) -> None:
    make, why = REFUSED[name]
    path = tmp_path / f"{name}.rbt"
    path.write_bytes(make())
    picture = str(tmp_path / "picture.png")
    done = CliRunner().invoke(app, ["replay", "play", str(path), "--screenshot", picture])
    assert done.exit_code == 1
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert why in done.output
    assert path.name in done.output.replace("\n", "")


@pytest.mark.parametrize("name", ["text", "cut_at_once"])
async def test_the_menu_gives_the_reason_and_stays(name: str, session: WindowSession) -> None:
    make, why = REFUSED[name]
    folder = session.folder / "recordings"
    folder.mkdir()
    (folder / f"{name}.rbt").write_bytes(make())

    def script() -> Iterator[None]:
        yield from wait(3)
        yield from session.choose("Replays")
        post(pygame.K_RETURN)
        yield from wait(6)
        assert session.form.title == "Replays"
        assert why in session.form.message
        post(pygame.K_ESCAPE)
        yield from wait(3)
        yield from session.choose("Quit")

    await asyncio.wait_for(session.go(script), 60)
    assert not session.user.ended


# Opened


def test_a_game_that_never_started(opened: Opener, tmp_path: Path) -> None:
    episode = Episode(World("multi_agent/01"), Rules(clock=Clock.REALTIME, step_rate=5.0))
    episode.join("robot1", "ada", "human", 0.0)
    episode.abort(9.0, "closed")
    path = tmp_path / "never.rbt"
    path.write_bytes(compress(record(episode, episode.events())))
    viewer = opened(path)
    use_all(viewer)
    assert viewer.view().step == 0
    assert viewer.view().outcome


def test_a_kitchen_that_is_not_installed(
    opened: Opener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "theirs"
    folder.mkdir()
    domain = json.loads((data_folder("domains") / "workshop.json").read_text())
    domain.pop("rendering_json", None)
    (folder / "forge.json").write_text(json.dumps({**domain, "name": "forge"}))
    shipped = Path(load_task("workshop/01").source)
    problem = json.loads(shipped.read_text())
    (folder / "axe.json").write_text(json.dumps({**problem, "domain": "forge"}))
    path = tmp_path / "axe.rbt"
    path.write_bytes(compress(recorded_game(str(folder / "axe.json"), steps=8)))
    for file in folder.iterdir():
        file.unlink()
    monkeypatch.chdir(tmp_path)
    viewer = opened(path)
    use_all(viewer)
    assert viewer.playhead.length == 8


@pytest.mark.parametrize("size", [pytest.param((1280, 720), marks=pytest.mark.slow), (320, 240)])
def test_eight_seats(opened: Opener, tmp_path: Path, size: tuple[int, int]) -> None:
    path = tmp_path / "eight.rbt"
    path.write_bytes(compress(recorded_game(str(of_eight(tmp_path)), steps=30)))
    viewer = opened(path, size=size)
    use_all(viewer)
    strip = viewer.strips[0].area
    assert strip.height < size[1] * 0.7, "there is room for a kitchen"
    assert len(viewer.histories[0].lanes) == 8


def of_eight(folder: Path) -> Path:
    """Write a kitchen for eight players."""
    problem = json.loads(Path(load_task("multi_agent/07").source).read_text())
    places = [(1, 1), (5, 5), (2, 1), (4, 5)]
    more = [{"name": "robot", "x": x, "y": y, "direction": [0, 1]} for x, y in places]
    problem["players"] += more
    problem["seats"] = [8]
    path = folder / "eight.json"
    path.write_text(json.dumps(problem))
    return path
