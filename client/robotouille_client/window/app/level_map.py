"""Map of levels: chapters with pictures, the stars that the player has earned, and what is next."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import pygame

from robotouille.certification.stars import score_limits
from robotouille.domain.loading import load_task, task_names
from robotouille.domain.task import Task
from robotouille_client.window.app.play_menu import best_of
from robotouille_client.window.app.settings import SHIFTS, Settings, is_shift
from robotouille_client.window.app.thumbnails import Thumbnails
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.widgets import Button, DrawContext, Row
from robotouille_client.window.input.commands import Command
from robotouille_client.window.pictures.shapes import box, star_points
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    CARD,
    FAINT,
    INK,
    PANEL,
    TEXT,
    TRACK,
    mixed,
)
from robotouille_client.window.sources.texts import dish_title

CHAPTERS = (
    ("Alone", "synchronous"),
    ("Alone, while work takes time", "asynchronous"),
    ("Together", "multi_agent"),
    ("Shifts: orders keep coming", SHIFTS),
)
"""Titles of the chapters, and the families of tasks in them."""

ALL_TASKS = "all tasks"
"""Answer of the button that leads to all tasks."""

WIDTH, BESIDE = 76, 22
"""Width of the map and of the details next to it, in text heights."""
_HEAD, _GAP = 1.4, 0.5
"""Height of a chapter's title and the gap between two levels, in text heights."""
_TILE = 2.5
"""Largest side of a level's picture, in text heights."""


@dataclass(frozen=True, slots=True)
class Level:
    """One level.

    Attributes:
        before: The level that opens it with a star; empty for the first.
        best: The player's most points in a shift, or fewest steps; None before the first.
    """

    task: str
    stars: int
    before: str = ""
    is_open: bool = True
    best: int | None = None

    @property
    def is_shift(self) -> bool:
        return is_shift(self.task)


def levels(
    family: str, stars: Mapping[str, int], best: Mapping[str, int] = MappingProxyType({})
) -> list[Level]:
    """Return the levels of a chapter. Each is open once the one before has a star."""
    found: list[Level] = []
    for name in (n for n in task_names() if n.startswith(f"{family}/")):
        last = found[-1] if found else None
        earned = earned_in(name, stars)
        is_open = last is None or bool(earned) or (last.is_open and last.stars > 0)
        before = "" if last is None else last.task
        most = best_of(best, name, most=family == SHIFTS)
        found.append(Level(name, earned, before, is_open, most))
    return found


def earned_in(task: str, stars: Mapping[str, int]) -> int:
    """Return the most stars that a player has earned in a task, with any number of players."""
    return max((n for name, n in stars.items() if name.partition("@")[0] == task), default=0)


class ChapterRow(Row):
    """Levels of a chapter from left to right. Its `answer` is the level that was chosen.

    Args:
        refused: Function that receives the level if the player chooses one that is not open.
    """

    def __init__(
        self,
        label: str,
        found: Sequence[Level],
        pictures: Thumbnails,
        refused: Callable[[Level], None],
    ) -> None:
        super().__init__(label)
        self.levels = tuple(found)
        self._pictures = pictures
        self._refused = refused
        # The first level without stars is next; in a finished chapter, the last one.
        open_ones = [n for n, level in enumerate(self.levels) if level.is_open]
        fresh = (n for n in open_ones if not self.levels[n].stars)
        self.index = self.next = next(fresh, open_ones[-1])

    @property
    def level(self) -> Level:
        """The marked level."""
        return self.levels[self.index]

    def height(self, context: DrawContext, width: int) -> int:
        return round(context.size * (_HEAD + _GAP)) + self._tile(context, width) * 4 // 3

    def command(self, command: Command) -> bool:
        if command in (Command.LEFT, Command.RIGHT):
            step = -1 if command is Command.LEFT else 1
            self.index = min(len(self.levels) - 1, max(0, self.index + step))
            return False
        if command not in (Command.USE, Command.ENTER):
            return False
        if not self.level.is_open:
            self._refused(self.level)
            return False
        self.answer = self.level.task
        return True

    def point(self, share: float) -> None:
        self.index = min(len(self.levels) - 1, max(0, int(share * len(self.levels))))

    def click(self, share: float) -> bool:
        self.point(share)
        return self.command(Command.ENTER)

    def _tile(self, context: DrawContext, width: int) -> int:
        """Return the side of a level's picture."""
        gap = round(context.size * _GAP)
        return min(round(context.size * _TILE), width // len(self.levels) - gap)

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        size = context.size
        earned = sum(level.stars for level in self.levels)
        words = f"{self.label}   {earned} of {3 * len(self.levels)} stars"
        line = context.text.line(words, size, ACCENT if context.focused else FAINT)
        target.blit(line, area.topleft)
        side, step = self._tile(context, area.width), area.width / len(self.levels)
        top = area.y + round(size * _HEAD)
        places = [
            pygame.Rect(round(area.x + (n + 0.5) * step - side / 2), top, side, side)
            for n in range(len(self.levels))
        ]
        path = [place.center for place in places]
        pygame.draw.lines(target, TRACK, False, path, max(3, size // 4))
        for number, (level, place) in enumerate(zip(self.levels, places, strict=True)):
            marked = context.focused and number == self.index
            if marked or number == self.next:
                # The stars are below, so the frame is thin there.
                edge = place.inflate(size // 2, size // 2)
                edge.height = place.bottom + 2 - edge.top
                target.blit(box(edge.size, ACCENT if marked else TEXT, size // 2), edge)
            self._level(target, place, level, context)

    def _level(
        self, target: pygame.Surface, place: pygame.Rect, level: Level, context: DrawContext
    ) -> None:
        target.blit(box(place.size, CARD, context.size // 3), place)
        room = (place.width - 4, place.height - 4)
        picture = self._pictures.at(level.task, room, urgent=level.is_open)
        if picture is not None:
            target.blit(picture, picture.get_rect(center=place.center))
        if not level.is_open:
            shade = pygame.Surface(place.size, pygame.SRCALPHA)
            shade.fill((*PANEL, 190))
            target.blit(shade, place)
            _padlock(target, place.center, place.width // 6)
        radius = max(4, place.width // 8)
        for number in range(3):
            middle = place.centerx + (number - 1) * radius * 9 // 4, place.bottom + radius * 3 // 2
            colour = ACCENT if number < level.stars else TRACK
            pygame.draw.polygon(target, colour, star_points(middle, radius))
        if level.is_shift and level.best is not None:
            points = context.text.line(str(level.best), context.size * 3 // 4, TEXT)
            left = place.centerx + radius * 4, place.bottom + radius * 3 // 2
            target.blit(points, points.get_rect(midleft=left))


def _padlock(target: pygame.Surface, middle: tuple[int, int], size: int) -> None:
    body = pygame.Rect(0, 0, 2 * size, round(1.5 * size))
    body.midtop = middle
    width = max(2, size // 3)
    arch = pygame.Rect(0, 0, round(1.3 * size), 2 * size)
    arch.midbottom = (middle[0], middle[1] + size)
    pygame.draw.rect(target, FAINT, arch, width, border_radius=size)
    pygame.draw.rect(target, mixed(FAINT, INK, 0.1), body, border_radius=max(2, size // 4))


class LevelMap(Form):
    """All chapters. The result is a task, the tutorial, `ALL_TASKS`, or `back`.

    Nothing is hidden from those who want to choose freely: all tasks are one button away.
    """

    def __init__(self, settings: Settings, last: str = "") -> None:
        self._settings = settings
        self._thumbnails = Thumbnails(settings.preferences.rendering)
        self._tasks: dict[str, Task] = {}
        tutorial = "Tutorial again" if settings.learned else "Tutorial (two minutes)"
        self._ends = [
            Button(tutorial, MenuChoice.TUTORIAL),
            Button("All tasks", ALL_TASKS),
            Button("Back", "back"),
        ]
        self.chapters = [
            ChapterRow(
                title,
                levels(family, settings.stars, settings.best),
                self._thumbnails,
                self._refuse,
            )
            for title, family in CHAPTERS
        ]
        super().__init__(
            "Levels",
            [*self.chapters, *self._ends],
            layout=FormLayout(pinned=len(self._ends)),
            idle=self._thumbnails.load,
        )
        for chapter in self.chapters:
            tasks = [level.task for level in chapter.levels]
            if last in tasks:
                chapter.index = tasks.index(last)
                self.focus(chapter)
        if not settings.learned:
            self.focus(self._ends[0])

    def width(self, size: int) -> int:
        return WIDTH * size

    def _refuse(self, level: Level) -> None:
        self.message = f"Earn a star in {self._title(level.before)!r} first, or choose All tasks."

    def _title(self, task: str) -> str:
        return dish_title(task, self._task(task).goal_description)

    def _task(self, name: str) -> Task:
        # Loading a task is slow, and the map is drawn again for each input.
        if name not in self._tasks:
            self._tasks[name] = load_task(name)
        return self._tasks[name]

    def _draw_beside(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> int:
        row, width = self.focused, BESIDE * size
        if area.width < 2 * width:
            return 0
        if not isinstance(row, ChapterRow):
            return width
        level, x, y = row.level, area.right - width, area.y
        room = (width, min(width, area.height * 3 // 5))
        picture = self._thumbnails.at(level.task, room, urgent=True)
        if picture is not None:
            target.blit(picture, picture.get_rect(midtop=(x + width // 2, y)))
            y += picture.get_height() + size // 2
        for words in (self._title(level.task), *self.details(level)):
            for line in text.wrap(words, size, width):
                if y + text.height(size) <= area.bottom:
                    target.blit(text.line(line, size, TEXT), (x, y))
                y += text.height(size)
            y += size // 3
        return width

    def details(self, level: Level) -> tuple[str, ...]:
        """Return the goal of a level, the stars in it, and what the next star needs."""
        goal = self._task(level.task).goal_description
        if not level.is_open:
            return (goal, f"Opens with a star in {self._title(level.before)!r}.")
        stars = {0: "No star yet.", 1: "One star."}.get(level.stars, f"{level.stars} stars.")
        if level.best is not None:
            stars += f" Best: {level.best} {'points' if level.is_shift else 'steps'}."
        return (goal, stars, *self._next_star(level))

    def _next_star(self, level: Level) -> tuple[str, ...]:
        """Return what the next star of a shift takes, or the first one of another level."""
        if not level.is_shift:
            return () if level.stars else ("Finish the order to earn the first.",)
        task = self._task(level.task)
        counts = task.problem.seats or (task.seats,)
        seats = self._settings.seats if self._settings.seats in counts else task.seats
        limits = score_limits(task.problem, seats)
        if limits is None or level.stars > 2:
            return ()
        nth, who = ("first", "second", "third")[level.stars], "player" + "s" * (seats > 1)
        return (f"With {seats} {who}, the {nth} star needs {limits[level.stars]} points.",)
