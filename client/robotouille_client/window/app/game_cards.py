"""Cards of a game: the result, and the question whether to leave."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pygame

from robotouille.certification.certificate import load_certificate
from robotouille.certification.stars import StarLimits, score_limits, star_limits
from robotouille.certification.step_limit import retimed_length
from robotouille.domain.loading import load_task, shipped_task
from robotouille.domain.schema import Shift
from robotouille.domain.task import Task, Timing
from robotouille.errors import RobotouilleError
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.widgets import Button, DrawContext, Row, Words
from robotouille_client.window.pictures.shapes import box, star_points
from robotouille_client.window.pictures.theme import ACCENT, BAD, FAINT, GOOD, TEXT, TRACK, Colour
from robotouille_client.window.sources.texts import orders_words, outcome_words, points_of, won
from robotouille_client.window.view import View

_PARTS: tuple[tuple[str, tuple[str, ...], Colour], ...] = (
    ("busy", ("acted", "busy"), GOOD),
    ("waiting for others", ("waiting",), BAD),
    ("", ("idle",), TRACK),
    ("away", ("away",), FAINT),
    ("played by a bot", ("substituted",), FAINT),
)
"""Parts of a seat's time: words, the activities of an outcome, and a colour."""


@dataclass(frozen=True, slots=True)
class SeatShare:
    """One seat's steps in each of `_PARTS`."""

    name: str
    steps: tuple[int, ...]

    @classmethod
    def of(cls, name: str, row: Mapping[str, Any]) -> SeatShare:
        """Read a seat's row of an outcome in JSON; activities that the server omits count as 0."""
        # The counts come from a server, so they may be negative.
        counted = (sum(max(0, int(row.get(kind, 0))) for kind in kinds) for _, kinds, _ in _PARTS)
        return cls(name, tuple(counted))

    @property
    def shares(self) -> tuple[float, ...]:
        """Shares of the time, one for each of `_PARTS`."""
        return tuple(steps / max(1, sum(self.steps)) for steps in self.steps)

    @property
    def words(self) -> str:
        """Shares in words, such as `busy 40% of the time, waiting for others 5%`."""
        rows = zip(self.shares, _PARTS, strict=True)
        told = [f"{words} {share:.0%}" for share, (words, _, _) in rows if words and share]
        return ", ".join([f"{told[0]} of the time", *told[1:]]) if told else "did nothing"


class ShareRow(Row):
    """Name of a seat, with a bar of its time and the same in words."""

    focusable = False

    def __init__(self, share: SeatShare) -> None:
        super().__init__(share.name)
        self._share = share

    def lines(self, context: DrawContext, width: int) -> int:
        return 2 + len(context.text.wrap(self._share.words, context.size - 2, width))

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        name, top = (
            context.text.fit(self.label, context.size, area.width),
            area.y + context.size // 3,
        )
        target.blit(context.text.line(name, context.size, TEXT), (area.x, top))
        y = top + context.text.height(context.size)
        x = float(area.x)
        for share, (_, _, colour) in zip(self._share.shares, _PARTS, strict=True):
            width = area.width * share
            if width >= 1:
                piece = pygame.Rect(round(x), y, round(width), max(6, context.size // 2))
                target.blit(box(piece.size, colour, 2), piece)
            x += width
        y += max(6, context.size // 2) + 3
        for words in context.text.wrap(self._share.words, context.size - 2, area.width):
            target.blit(context.text.line(words, context.size - 2, FAINT), (area.x, y))
            y += context.text.height(context.size - 2)


# Seconds until the points have been counted, between two stars, and of a star's stamp.
_COUNTED, _BETWEEN, _STAMPED = 0.9, 0.4, 0.22
# Size of a star when its stamp begins, as a multiple. The row, of two lines, has just room for it.
_STAMP = 4 / 3


@dataclass(frozen=True, slots=True)
class Rating:
    """Stars of a finished game, of three.

    Attributes:
        words: Line that says what the next star needs.
        points: Points of a shift; None for other games.
    """

    stars: int
    words: str
    points: int | None = None


class StarsRow(Row):
    """Stars of a finished game, with what the next one needs.

    While the card is new, the points are counted up, and the stars are stamped one by one.
    """

    focusable = False
    moves = True

    def __init__(self, rating: Rating) -> None:
        super().__init__(rating.words)
        self.stars = rating.stars
        self._points = rating.points

    def lines(self, context: DrawContext, width: int) -> int:
        points = 0 if self._points is None else 2
        return 2 + points + len(context.text.wrap(self.label, context.size, width))

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        line, y, age = context.text.height(context.size), area.y, context.age
        if self._points is not None:
            counted = round(self._points * min(1.0, age / _COUNTED))
            total = context.text.line(f"{counted} points", round(context.size * 1.6), TEXT)
            target.blit(total, (area.x, y))
            y, age = y + 2 * line, age - _COUNTED
        side = line * 3 // 2
        for number in range(3):
            middle = area.x + line + number * (side + side // 4), y + line
            pygame.draw.polygon(target, TRACK, star_points(middle, side / 2))
            began = age - (number + 1) * _BETWEEN
            if number < self.stars and began > 0:
                size = 1 + (_STAMP - 1) * max(0.0, 1 - began / _STAMPED)
                pygame.draw.polygon(target, ACCENT, star_points(middle, size * side / 2))
        y += line * 2
        for words in context.text.wrap(self.label, context.size, area.width):
            target.blit(context.text.line(words, context.size, TEXT), (area.x, y))
            y += line


def end_card(
    view: View, outcome: Mapping[str, Any] | None, buttons: Sequence[tuple[str, object]]
) -> Form:
    """Return the card for the end of a game.

    Args:
        view: The last view.
        outcome: The outcome in JSON; None if it is unknown.
        buttons: Labels and answers. The first button has the focus.
    """
    rows: list[Row] = []
    rating = None
    people = [player for player in (view.me, view.companion) if player is not None]
    if outcome is not None:
        rating = rate_game(view.world.task, len(view.seats), view.step_seconds, outcome, people)
        counted = rating is not None and rating.points is not None
        rows.append(Words(f"{orders_words(outcome) if counted else outcome_words(outcome)}."))
        if rating is not None:
            rows.append(StarsRow(rating))
        if words := best_words(view.world.task):
            rows.append(Words(words))
        names = {seat.player: seat.name for seat in view.seats}
        for seat in outcome.get("seats", ()):
            player = str(seat.get("player", ""))
            you = " (you)" if player == view.me else ""
            rows.append(ShareRow(SeatShare.of((names.get(player) or player) + you, seat)))
    elif view.farewell is not None:
        rows.append(Words(f"{view.farewell.title}. {view.farewell.text}"))
    rows += [Button(label, answer) for label, answer in buttons]
    layout = FormLayout(accent=GOOD if view.won else BAD, shrinks=True)
    title = _title(view, outcome, rating, people)
    return Form(title, rows, cancel=MenuChoice.MENU, layout=layout)


def _title(
    view: View,
    outcome: Mapping[str, Any] | None,
    rating: Rating | None,
    people: Collection[str],
) -> str:
    """Return the title of the card for the end of a game, which follows from the stars."""
    over = outcome is not None and outcome.get("reason") == "shift_over"
    if not (view.won or over):
        return "Game over" if outcome is None else "Not this time"
    if outcome is not None and only_watched(outcome, people):
        return "The others did it!"
    if rating is None:
        return "Well done!"
    first = "You did it!" if rating.points is None else "Good start!"
    return ("Shift over", first, "Well done!", "Excellent!")[rating.stars]


IDLE = "You only watched this time. Lend a hand to earn stars!"
"""Words about a game in which the people at the window did nothing."""


def rate_game(
    task: Task,
    seats: int,
    step_seconds: float | None,
    outcome: Mapping[str, Any],
    people: Collection[str] = (),
) -> Rating | None:
    """Return the stars of a game that has ended.

    Args:
        people: Players at this window. If they did nothing, there are no stars.

    Returns:
        None if the goal was not reached, and if the task has no limits or no known plan.
    """
    scores = score_limits(task.problem, seats)
    if scores is not None:
        points = points_of(outcome) or 0
        if only_watched(outcome, people):
            return Rating(0, IDLE, points)
        stars = scores.stars(points)
        return Rating(stars, f"{_stars_need(stars)} {scores[min(stars, 2)]} points.", points)
    limits = limits_of_game(task, step_seconds) if won(outcome) else None
    if limits is None:
        return None
    if only_watched(outcome, people):
        return Rating(0, IDLE)
    stars = limits.stars(int(outcome.get("steps", 0)))
    most = limits.two if stars == 1 else limits.three
    return Rating(stars, f"{_stars_need(stars)} at most {most} steps.")


def limits_of_game(task: Task, step_seconds: float | None) -> StarLimits | None:
    """Return the steps for the stars of a game with a goal; None without a known plan."""
    shipped = shipped_task(task)
    rate = 1 / step_seconds if step_seconds else None
    return None if shipped is None else star_limits(shipped, rate)


def _stars_need(earned: int) -> str:
    """Return the beginning of the sentence about the next star."""
    return ("One star needs", "Two stars need", "Three stars need")[min(earned, 2)]


def only_watched(outcome: Mapping[str, Any], people: Collection[str]) -> bool:
    """Return whether some players did nothing in a game that has ended."""
    rows = [row for row in outcome.get("seats", ()) if row.get("player") in people]
    return bool(rows) and not any(row.get("acted") for row in rows)


def best_words(task: Task) -> str:
    """Return the best known or possible result of a task in words; empty if none is known.

    In the `benchmark` timing a known plan may be proven to be the shortest. In the `people` timing,
    where walks and work take longer, it is only a good one. Tasks from a server have no certificate
    file, so the shipped task of the same name is used if its content is the same.
    """
    if task.problem.shift is not None:
        return _most_words(task, task.problem.shift)
    shipped = shipped_task(task)
    length = None if shipped is None else retimed_length(shipped)
    if length is None:
        return ""
    try:
        certificate = load_certificate(load_task(task.name, seats=task.seats))
    except (RobotouilleError, OSError):
        return ""
    if task.timing is Timing.BENCHMARK and certificate.optimal:
        return f"Best possible: {length} steps."
    return f"Best known: {length} steps."


def _most_words(task: Task, shift: Shift) -> str:
    """Return the points of planner bots in a shift, or else those that nobody can exceed."""
    # Bots earn other points in the `people` timing, where walks are short compared with work.
    points = shift.planner if task.timing is Timing.BENCHMARK else shift.planner_people
    known = points.get(task.seats)
    if known is not None:
        return f"Best known: {known} points."
    bound = shift.bound(task.profile.delay_factor)
    return "" if bound is None else f"No more than {bound} points are possible."


REVIEW_BUTTONS = (("Watch the replay", MenuChoice.WATCH), ("Save a video", MenuChoice.VIDEO))
"""Buttons for a game whose recording was kept."""
LEAVE_BUTTONS = (("Menu", MenuChoice.MENU), ("Quit", MenuChoice.QUIT))


class GameCards:
    """Cards of one game.

    Args:
        outcome: Function that returns the outcome; None if it is unknown.
        buttons: Function that returns the labels and answers of the end card's buttons.
        pause: Function that pauses or resumes the game.
        menu: True if there is a menu. Without it, leaving the game closes the window.
        message: Function that returns a new message for the card, or "".
        ended: Function called when the game has ended, before its card is shown.
        start: Function that returns the card before the game, or None to show none. The card also
            comes before the question whether the player is ready.
    """

    def __init__(
        self,
        outcome: Callable[[], Mapping[str, Any] | None],
        buttons: Callable[[], Sequence[tuple[str, object]]],
        pause: Callable[[bool], None] = lambda paused: None,
        *,
        menu: bool = True,
        message: Callable[[], str] = lambda: "",
        ended: Callable[[], None] = lambda: None,
        start: Callable[[View], Form | None] = lambda view: None,
    ) -> None:
        self._outcome = outcome
        self._buttons = buttons
        self._menu = menu
        self._new_message = message
        self._ended = ended
        self._start = start
        self._pause = pause
        self._message = ""
        self._chosen: object = None
        self._card: Form | None = None

    @property
    def _leave(self) -> MenuChoice:
        """Result of a card that leaves the game."""
        return MenuChoice.MENU if self._menu else MenuChoice.QUIT

    def start_card(self, view: View) -> Form | None:
        # A game on a server that has begun goes on while the player reads.
        goes_on = view.code and (view.lobby is None or view.lobby.ready is not False)
        card = None if view.over or goes_on else self._start(view)
        if card is not None:
            self._pause(True)
            if not view.code:  # In a waiting room, Esc returns to the room.
                card.cancel = self._leave
        return card

    def end_card(self, view: View) -> Form:
        self._ended()
        form = end_card(view, self._outcome(), self._buttons())
        form.message = self._message
        row = next((row for row in form.rows if row.answer == self._chosen), None)
        if row is not None and self._chosen is not None:
            form.focus(row)
        self._card = form
        return form

    def returned(self, message: str, chosen: object) -> None:
        """Set the message and focus of the card when the player returns to it."""
        self._message, self._chosen = message, chosen

    def leave_card(self, view: View) -> Form:
        self._pause(True)
        rows = [
            Button("Keep playing", MenuChoice.STAY),
            Button("Leave", self._leave),
        ]
        if self._menu:
            rows.append(Button("Quit", MenuChoice.QUIT))
        return Form("Leave this game?", rows, cancel=MenuChoice.STAY)

    def stay(self) -> None:
        self._pause(False)

    def pause(self, paused: bool) -> None:
        self._pause(paused)

    def message(self) -> str:
        if self._card is not None:
            _set_buttons(self._card, self._buttons())
        return self._new_message()


def _set_buttons(card: Form, buttons: Sequence[tuple[str, object]]) -> None:
    # Buttons that stay are kept as they are, so that the focus does not jump.
    shown = {row.answer: row for row in card.rows if row.answer is not None}
    if list(shown) == [answer for _, answer in buttons]:
        return
    words = [row for row in card.rows if row.answer is None]
    card.set_rows([*words, *(shown.get(a) or Button(label, a) for label, a in buttons)])
