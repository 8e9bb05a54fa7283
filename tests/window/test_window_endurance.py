"""Windows that stay open for hours: pictures are loaded ahead, and memory does not grow."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pygame
import pytest
from benchmarks import window as bench
from benchmarks.endurance import evening, resize
from benchmarks.idle import resting_game
from benchmarks.window import Led, course, views
from tests.support.window_play import Timer, headless_window

from robotouille.episode.rules import Clock
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.app.local_game import GameSetup, LocalGame
from robotouille_client.window.drawing.kitchen.kitchen_layer import Preloader
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.forms.screen import Display
from robotouille_client.window.pictures import sprites

SIZE, FRAMES = (640, 360), 100
MAKES = {"convert", "convert_alpha", "copy", "load", "load_sized_svg", "render", "rotozoom",
         "scale", "smoothscale"}  # fmt: skip


@contextmanager
def made(monkeypatch: pytest.MonkeyPatch) -> Iterator[Counter[str]]:
    """Count the pictures created in a block, by creator."""
    found: Counter[str] = Counter()
    new, makers = pygame.Surface, (pygame.Surface, pygame.font.Font, ModuleType)

    def called(frame: object, event: str, function: object) -> None:
        name = getattr(function, "__name__", "")
        if (
            event == "c_call"
            and name in MAKES
            and isinstance(getattr(function, "__self__", None), makers)
        ):
            found[name] += 1

    def surface(*arguments: object, **options: object) -> pygame.Surface:
        found["Surface"] += 1
        return new(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(pygame, "Surface", surface)
        sys.setprofile(called)
        try:
            yield found
        finally:
            sys.setprofile(None)


@pytest.mark.slow
def test_an_idle_game_creates_only_a_few_texts_per_step(monkeypatch: pytest.MonkeyPatch) -> None:
    timer = Timer()
    source = resting_game("multi_agent/10@4", now=timer)
    window = headless_window(SIZE, clock=timer)

    def frame() -> None:
        timer.now += 1 / 60
        window.frame(source)

    for _ in range(300):  # Until all players have blinked.
        frame()
    busy, step = [], source.view().step
    with made(monkeypatch) as pictures:
        for _ in range(FRAMES):
            before = pictures.total()
            frame()
            busy.append(pictures.total() - before)
    steps = source.view().step - step
    assert steps == pytest.approx(FRAMES / 12, abs=1)
    assert sum(map(bool, busy)) <= steps, "only a new step is written anew"
    assert max(busy) <= 8, pictures


@pytest.mark.slow
def test_a_busy_game_creates_nothing_between_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = list(views(course(16), 8))
    window, source = headless_window(SIZE), Led(shown[0])

    def show() -> None:
        for view in shown[:FRAMES]:
            source.shown = view
            window.frame(source)

    show()
    with made(monkeypatch) as pictures:
        show()
    assert pictures.total() <= FRAMES // 8, pictures  # The ticket, where it changes.


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="asks Linux for its memory")
def test_memory_does_not_grow_with_each_game() -> None:
    samples = list(evening(600, 6, sizes=((320, 240), (400, 300))))
    assert samples[-1].games == 4
    assert samples[-1].memory - samples[2].memory < 8.0, samples


SAID = ("W" * 200, "漢字" * 50, "😀" * 80, "a\u0301" * 60, "\u202eabc" * 20)
SIZES = ((320, 240), (3840, 2160), (1, 1), (160, 120), (200, 1500), (3000, 130), (641, 359))


@pytest.mark.slow
def test_resizing_and_long_names_while_playing() -> None:
    timer = Timer()
    setup = GameSetup("multi_agent/01", clock=Clock.REALTIME, partner=BotKind.RANDOM, countdown=0.0)
    game = LocalGame(setup, "漢" * 40, timer, None, prompt_partners)
    display = Display(SIZES[0], headless=True)
    window = headless_window(display=display, clock=timer)
    try:
        window.frame(game.source)
        for number in range(len(SIZES)):
            timer.now += 0.2
            resize(display, SIZES[number % len(SIZES)])
            game.source.say(SAID[number % len(SAID)])
            view = game.source.view()
            for action in view.state.actions(view.me or "")[-1:]:
                game.source.act(action)
            key = (pygame.K_TAB, pygame.K_h, pygame.K_t, pygame.K_ESCAPE)[number % 4]
            pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
            pos = (SIZES[number % len(SIZES)][0] // 3, 50)
            moved = {"pos": pos, "rel": (0, 0), "buttons": (0, 0, 0)}
            pygame.event.post(pygame.Event(pygame.MOUSEMOTION, moved))
            window.frame(game.source)
        assert window.drawn > len(SIZES)
    finally:
        game.finish(ended=False)


SIZE = (640, 360)


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Names and sizes of the pictures read from files."""
    read, load = [], sprites._load

    def counted(path: Path, size: int) -> pygame.Surface | None:
        read.append((path.name, size))
        return load(path, size)

    monkeypatch.setattr(sprites, "_load", counted)
    return read


@pytest.mark.slow
def test_a_preloaded_game_reads_hardly_any_file(loaded) -> None:
    painter, surface = Painter(), pygame.Surface(SIZE)
    shown = list(bench.views(bench.course(30), 2))
    painter.paint(surface, shown[0])
    painter.preload(SIZE, 60.0)
    ahead = len(loaded)
    for view in shown:
        painter.paint(surface, view)
    assert len(loaded) - ahead <= 0.1 * ahead


def test_preloading_takes_its_time_on_average(monkeypatch: pytest.MonkeyPatch) -> None:
    view, timer, drawn = next(bench.views(bench.course(1), 1)), Timer(), []
    painter = Painter()
    painter.stage(view.state)

    def slow(path: Path, size: int) -> pygame.Surface:
        timer.now += 1 / 128
        drawn.append(path)
        return pygame.Surface((size, size))

    monkeypatch.setattr(sprites, "_load", slow)
    preloader = Preloader(view.world, painter._resolver, painter._sprites, 40, timer)
    for _ in range(100):
        preloader.work(1 / 512)
    assert len(drawn) == 25


def test_missing_pictures_do_not_stop_preloading(tmp_path: Path, loaded) -> None:
    view = next(bench.views(bench.course(1), 1))
    painter = Painter()
    painter.stage(view.state)
    pictures = sprites.Sprites((tmp_path,), painter.text)
    Preloader(view.world, painter._resolver, pictures, 40).work(60.0)
    assert pictures.roomy
