"""A window that is open for hours: nothing is made anew each frame, and nothing grows."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pygame
import pytest
from benchmarks.endurance import evening, resize
from benchmarks.idle import resting_game
from benchmarks.window import Led, course, views
from tests.support.window_play import Timer

from robotouille.episode.rules import Clock
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.forms.display import Display
from robotouille_client.window.shell.games.local_game import GameSetup, LocalGame
from robotouille_client.window.window import Window

SIZE, FRAMES = (640, 360), 200
MAKES = {"convert", "convert_alpha", "copy", "load", "load_sized_svg", "render", "rotozoom",
         "scale", "smoothscale"}  # fmt: skip


@contextmanager
def made(monkeypatch: pytest.MonkeyPatch) -> Iterator[Counter[str]]:
    """How many pictures are made meanwhile, by what makes them."""
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


def test_a_game_in_which_nobody_moves_makes_a_few_words_a_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    timer = Timer()
    source = resting_game("multi_agent/10@4", now=timer)
    window = Window(SIZE, headless=True, clock=timer)

    def frame() -> None:
        timer.now += 1 / 60
        window.frame(source)

    try:
        for _ in range(60):
            frame()
        busy, step = [], source.view().step
        with made(monkeypatch) as pictures:
            for _ in range(FRAMES):
                before = pictures.total()
                frame()
                busy.append(pictures.total() - before)
        steps = source.view().step - step
    finally:
        window.close()
    assert steps == pytest.approx(FRAMES / 12, abs=1)
    assert sum(map(bool, busy)) <= steps, "only a new step is written anew"
    assert max(busy) <= 8, pictures


def test_a_game_in_which_all_move_makes_nothing_between_its_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Once all of it has been seen, and its pictures drawn."""
    shown = list(views(course(28), 8))
    window, source = Window(SIZE, headless=True), Led(shown[0])

    def show() -> None:
        for view in shown[:FRAMES]:
            source.shown = view
            window.frame(source)

    try:
        show()
        with made(monkeypatch) as pictures:
            show()
    finally:
        window.close()
    assert pictures.total() <= FRAMES // 8, pictures  # The ticket, where it changes.


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="asks Linux for its memory")
def test_game_after_game_takes_no_more_memory() -> None:
    """600 steps in four games, half of them as long as it takes to fill all that is kept."""
    samples = list(evening(600, 6, sizes=((320, 240), (400, 300))))
    assert samples[-1].games == 4
    assert samples[-1].memory - samples[2].memory < 8.0, samples


SAID = ("W" * 200, "漢字" * 50, "😀" * 80, "a\u0301" * 60, "\u202eabc" * 20)
SIZES = ((320, 240), (3840, 2160), (1, 1), (160, 120), (200, 1500), (3000, 130), (641, 359))


def test_any_size_any_words_while_playing() -> None:
    """Its owner drags the edge all the time, and has a name of 40 wide letters."""
    timer = Timer()
    setup = GameSetup("multi_agent/01", clock=Clock.REALTIME, partner=BotKind.RANDOM, countdown=0.0)
    game = LocalGame(setup, "漢" * 40, timer, None, prompt_partners)
    display = Display(SIZES[0], headless=True)
    window = Window(display=display, clock=timer)
    try:
        window.frame(game.source)
        for number in range(4 * len(SIZES)):
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
        assert window.drawn > 4 * len(SIZES)
    finally:
        display.close()
        game.finish(over=False)
