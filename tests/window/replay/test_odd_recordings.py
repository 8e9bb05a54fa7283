"""Recordings that are not as they should be, or quite large: each opens, or is refused in words."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.evening import Evening, wait
from tests.support.games import record, recorded_game
from tests.support.window_play import post
from typer.testing import CliRunner

from robotouille import World, load_task
from robotouille.episode import Clock, Episode, Rules
from robotouille.replay.container import compress, magic
from robotouille.resources import data_folder
from robotouille_client.cli.main import app
from robotouille_client.window.replay.viewer import Viewer

Opener = Callable[..., Viewer]
LETTERS = 100_000

REFUSED = {
    "empty": (lambda: b"", "not a recording"),
    "text": (lambda: b"nothing of the kind\n" * 40, "not a recording"),
    "version": (lambda: magic(9) + b"\0" * 40, "format version 9"),
    "torn_header": (lambda: recorded_game("multi_agent/01", steps=3)[:900], "no header"),
    "cut_at_once": (lambda: compress(recorded_game("multi_agent/01", steps=3))[:900], "cut off"),
}


def use_all(viewer: Viewer) -> None:
    """Go everywhere, and open all there is."""
    keys = (pygame.K_l, pygame.K_END, pygame.K_LEFT, pygame.K_COMMA, pygame.K_f, pygame.K_h)
    for key in (*keys, pygame.K_h, pygame.K_HOME, pygame.K_PERIOD):
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
        viewer.window.frame(viewer)


# What is refused


@pytest.mark.parametrize("name", REFUSED)
def test_the_command_line_says_why(name: str, tmp_path: Path) -> None:
    make, why = REFUSED[name]
    path = tmp_path / f"{name}.rbt"
    path.write_bytes(make())
    picture = str(tmp_path / "picture.png")
    done = CliRunner().invoke(app, ["replay", "play", str(path), "--screenshot", picture])
    assert done.exit_code == 1
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert why in done.output
    assert path.name in done.output.replace("\n", "")


@pytest.mark.parametrize("name", REFUSED)
def test_the_menu_says_why_and_stays(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, why = REFUSED[name]
    monkeypatch.chdir(tmp_path)
    evening = Evening(tmp_path)
    evening.watch(monkeypatch)
    folder = tmp_path / "recordings"
    folder.mkdir()
    (folder / f"{name}.rbt").write_bytes(make())
    told: list[str] = []

    def script() -> Iterator[None]:
        yield from wait(3)
        yield from evening.choose("Replays")
        assert evening.form is not None
        post(pygame.K_RETURN)
        yield from wait(6)
        told.append(f"{evening.form.title}: {evening.form.message}")
        post(pygame.K_ESCAPE)
        yield from wait(3)
        yield from evening.choose("Quit")

    asyncio.run(evening.go(script))
    assert told[0].startswith("Replays: ")
    assert why in told[0]


# What opens


def test_one_that_never_began(opened: Opener, tmp_path: Path) -> None:
    """One of two players came, and it was closed: there is an end, and no step."""
    episode = Episode(World("multi_agent/01"), Rules(clock=Clock.REALTIME, step_rate=5.0))
    episode.join("robot1", "ada", "human", 0.0)
    episode.abort(9.0, "closed")
    path = tmp_path / "never.rbt"
    path.write_bytes(compress(record(episode, episode.events())))
    viewer = opened(path)
    use_all(viewer)
    assert viewer.view().step == 0
    assert viewer.view().outcome


def test_one_of_a_kitchen_that_is_not_here(
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


@pytest.mark.parametrize("size", [(1280, 720), (640, 360), (320, 240)])
def test_one_with_eight_seats(opened: Opener, tmp_path: Path, size: tuple[int, int]) -> None:
    path = tmp_path / "eight.rbt"
    path.write_bytes(compress(recorded_game(str(of_eight(tmp_path)), steps=30)))
    viewer = opened(path, size=size)
    use_all(viewer)
    strip = viewer.strips[0].area
    assert strip.height < size[1] * 0.7, "there is room for a kitchen"
    assert len(viewer.histories[0].lanes) == 8


def of_eight(folder: Path) -> Path:
    """A kitchen that eight can play in."""
    problem = json.loads(Path(load_task("multi_agent/07").source).read_text())
    places = [(1, 1), (5, 5), (2, 1), (4, 5)]
    more = [{"name": "robot", "x": x, "y": y, "direction": [0, 1]} for x, y in places]
    problem["players"] += more
    problem["seats"] = [8]
    path = folder / "eight.json"
    path.write_text(json.dumps(problem))
    return path


def test_one_with_much_chat(opened: Opener, tmp_path: Path) -> None:
    episode = Episode(World("synchronous/01"), Rules(clock=Clock.LOCKSTEP, max_steps=3))
    episode.join("robot1", "ada", "human", 0.0)
    events = episode.events()
    for number in range(LETTERS // 500):
        episode.say("ada", "robot1", f"{number} " + "long " * 99, number * 0.1)
        events += episode.events()
    for seq in (1, 2, 3):
        episode.submit("robot1", seq, None, 100.0 + seq)
        episode.tick(100.0 + seq)
    events += episode.events()
    path = tmp_path / "chat.rbt"
    path.write_bytes(compress(record(episode, events)))
    viewer = opened(path)
    use_all(viewer)
    said = viewer.histories[0].entries(0)
    assert sum(len(entry.words) for entry in said) > LETTERS * 0.9
