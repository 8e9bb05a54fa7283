"""Map of levels: which are open, how to reach them, and what a finished game changes."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Iterator

import pygame
import pytest
from tests.support.window_play import post
from tests.support.window_session import WindowSession, wait

from robotouille import Task
from robotouille_client.window.app import thumbnails
from robotouille_client.window.app.level_map import ALL_TASKS, ChapterRow, LevelMap, levels
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.input.commands import Command
from robotouille_client.window.pictures.text_surfaces import Typesetter

FIRST, SECOND, THIRD = (
    "synchronous/01_cheese_sandwich", "synchronous/02_lettuce_sandwich",
    "synchronous/03_lettuce_tomato_sandwich",
)  # fmt: skip


def level_map(**stars: int) -> LevelMap:
    earned = {
        f"{name}@1": n for name, n in zip((FIRST, SECOND, THIRD), stars.values(), strict=False)
    }
    return LevelMap(Settings(learned=True, stars=earned))


def test_a_star_opens_the_next_level() -> None:
    assert [level.is_open for level in levels("synchronous", {})][:3] == [True, False, False]
    earned = {f"{FIRST}@1": 1}
    assert [level.is_open for level in levels("synchronous", earned)][:3] == [True, True, False]
    # A level that was played before is open, however it was reached.
    apart = {f"{THIRD}@1": 2}
    assert [level.is_open for level in levels("synchronous", apart)][:4] == [
        True, False, True, True,
    ]  # fmt: skip
    shown = levels("multi_agent", {"multi_agent/01_lettuce_burger@4": 2})
    assert (shown[0].stars, shown[1].is_open) == (2, True), "with any number of players"


def test_arrows_mark_levels_and_enter_chooses_open_ones() -> None:
    shown = level_map(first=2)
    assert shown.chapters[0].level.task == SECOND, "the next level is marked"
    shown.command(Command.RIGHT)
    shown.command(Command.ENTER)
    assert shown.result is None
    assert shown.message == "Earn a star in 'Lettuce sandwich' first, or choose All tasks."
    shown.command(Command.LEFT)
    shown.command(Command.LEFT)
    shown.command(Command.LEFT)
    shown.command(Command.ENTER)
    assert shown.result == FIRST


@pytest.mark.parametrize("size", [(1120, 630), (500, 400)])
def test_a_click_chooses_a_level(size: tuple[int, int]) -> None:
    shown, surface = level_map(first=2), pygame.Surface(size)
    shown.draw(surface, surface.get_rect(), Typesetter(), 12)
    place = shown.place_of(shown.chapters[0])
    assert place is not None
    pos = (place.x + place.width // 20, place.centery)
    shown.handle(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1), None)  # type: ignore[arg-type]
    assert shown.result == FIRST


def test_newcomers_begin_with_the_tutorial() -> None:
    focused = LevelMap(Settings()).focused
    assert focused is not None
    assert focused.answer == "tutorial"
    assert [row.answer for row in LevelMap(Settings()).rows[-2:]] == [ALL_TASKS, "back"]


def test_the_map_knows_the_best_points_and_steps() -> None:
    shift = "shifts/01_sandwich_bar"
    best = {f"{shift}@1": 286, f"{shift}@2": 229, f"{FIRST}@1": 12}
    assert levels("shifts", {}, best)[0].best == 286
    assert levels("synchronous", {}, best)[0].best == 12
    assert levels("synchronous", {}, best)[1].best is None


@pytest.mark.parametrize(
    ("stars", "words"),
    [
        ({}, "With 1 player, the first star needs 87 points."),
        ({"shifts/01_sandwich_bar@2": 1}, "With 1 player, the second star needs 175 points."),
    ],
)
def test_the_map_names_the_points_of_the_next_star(stars: dict[str, int], words: str) -> None:
    shown = LevelMap(Settings(learned=True, stars=stars), "shifts/01_sandwich_bar")
    chapter = shown.focused
    assert isinstance(chapter, ChapterRow)
    assert words in shown.details(chapter.level)
    assert "Finish the order to earn the first." in shown.details(shown.chapters[0].level)


def test_pictures_of_open_levels_are_drawn_first(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[str] = []

    def draw(load: Callable[[], Task], *_: object) -> None:
        drawn.append(load().name)

    monkeypatch.setattr(thumbnails, "_kitchens", OrderedDict())
    monkeypatch.setattr(thumbnails, "_drawn", draw)
    shown, surface = level_map(first=2), pygame.Surface((1120, 630))
    shown.draw(surface, surface.get_rect(), Typesetter(), 12)
    for _ in range(len(shown.chapters) + 1):
        assert shown.idle()
    opened = [level.task for each in shown.chapters for level in each.levels if level.is_open]
    assert sorted(drawn) == sorted(opened)


async def test_a_level_leads_to_its_game_and_back(session: WindowSession) -> None:
    def script() -> Iterator[None]:
        yield
        yield from session.choose("Levels")
        assert session.titles[-1] == "Levels"
        post(pygame.K_DOWN, pygame.K_DOWN)
        yield
        post(pygame.K_RETURN)
        yield from wait(3)
        assert session.titles[-1] == "Play here"
        assert session.app.settings.task == "multi_agent/01_lettuce_burger"
        yield from session.choose("Back")
        assert session.titles[-1] == "Levels"
        assert session.form.chapters[2].level.task == "multi_agent/01_lettuce_burger"
        assert session.form.focused is session.form.chapters[2]
        yield from session.choose("All tasks")
        assert session.titles[-1] == "Play here"
        yield from session.choose("Back")
        yield from session.choose("Quit")

    await asyncio.wait_for(session.go(script), 60)
