"""The card before a game: what the stations are for, and what the stars need."""

from __future__ import annotations

from collections.abc import Callable

from robotouille.certification.stars import ScoreLimits, StarLimits, score_limits
from robotouille.domain.rendering import Language, language_of
from robotouille.world.presentation.wording import Wording
from robotouille.world.shift import ShiftRules
from robotouille.world.world import World
from robotouille_client.window.app.game_cards import limits_of_game
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.widgets import Button, Row, Words
from robotouille_client.window.sources.texts import dish_title, time_words
from robotouille_client.window.view import View


def introduction(
    world: World, words: Language, button: str = "Start"
) -> Callable[[View], Form | None]:
    """Return a function that makes the card of a game from its first view."""
    wording = Wording(world, language_of(world.task).with_words(words))
    return lambda view: start_card(view, wording, button)


def start_card(view: View, wording: Wording, button: str) -> Form | None:
    """Return the card before a shift or a game in real time, which a button closes.

    Other games have no card, because their players have no time to lose.
    """
    task, stars = view.world.task, star_words(view)
    shift = view.world.shift
    if not (shift or stars):
        return None
    rows: list[Row] = [Words(task.goal_description)] if task.goal_description else []
    if shift is not None:
        rows += [Words(f"{kind.capitalize()}: {use}.") for kind, use in wording.purposes()]
        rows.append(Words(f"The shift lasts {_length(view, shift)}."))
    if stars:
        rows.append(Words(stars))
    rows.append(Button(button, MenuChoice.STAY))
    title = dish_title(task.name, task.goal_description)
    return Form(title, rows, cancel=MenuChoice.STAY, layout=FormLayout(shrinks=True))


def _length(view: View, shift: ShiftRules) -> str:
    """Return the length of a shift in words."""
    steps = min(shift.steps, view.max_steps or shift.steps)
    return f"{steps} steps" if view.step_seconds is None else time_words(steps * view.step_seconds)


def star_words(view: View) -> str:
    """Return what the stars of a shift or of a game in real time need; empty if unknown."""
    task, seconds = view.world.task, view.step_seconds
    scores = score_limits(task.problem, len(view.seats))
    if scores is not None:
        return _points_words(scores)
    limits = None if seconds is None else limits_of_game(task, seconds)
    return "" if limits is None or seconds is None else _steps_words(limits, seconds)


def _points_words(limits: ScoreLimits) -> str:
    return f"One star needs {limits.one} points, two need {limits.two}, three need {limits.three}."


def _steps_words(limits: StarLimits, step_seconds: float) -> str:
    three, two = (
        f"{steps} steps ({round(steps * step_seconds)} s)" for steps in (limits.three, limits.two)
    )
    return f"Three stars need at most {three}, two need {two}. Any finished game earns one."
