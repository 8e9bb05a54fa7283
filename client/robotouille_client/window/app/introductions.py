"""Cards before shifts: what the stations are for, and the points for stars."""

from __future__ import annotations

from collections.abc import Callable

from robotouille.certification.stars import ScoreLimits, score_limits
from robotouille.domain.rendering import Language, language_of
from robotouille.world.presentation.wording import Wording
from robotouille.world.world import World
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.widgets import Button, Row, Words
from robotouille_client.window.sources.texts import dish_title
from robotouille_client.window.view import View


class Introductions:
    """The cards before shifts. The player sees each card once."""

    def __init__(self) -> None:
        self._seen: set[str] = set()

    def to(
        self, world: World, words: Language, button: str = "Start"
    ) -> Callable[[View], Form] | None:
        """Return what makes the card of a game; None without a shift, and if it has been seen."""
        task = world.task
        if world.shift is None or task.name in self._seen:
            return None
        self._seen.add(task.name)
        wording = Wording(world, language_of(task).with_words(words))
        return lambda view: shift_card(view, wording, button)


def shift_card(view: View, wording: Wording, button: str) -> Form:
    """Return the card before a shift. A button closes it."""
    task = view.world.task
    rows: list[Row] = [Words(task.goal_description)] if task.goal_description else []
    rows += [Words(f"{kind.capitalize()}: {use}.") for kind, use in wording.purposes()]
    limits = score_limits(task.problem, len(view.seats))
    if limits is not None:
        rows.append(Words(star_words(limits)))
    rows.append(Button(button, MenuChoice.STAY))
    title = dish_title(task.name, task.goal_description)
    return Form(title, rows, cancel=MenuChoice.STAY, layout=FormLayout(shrinks=True))


def star_words(limits: ScoreLimits) -> str:
    """Return the points of a shift for one, two and three stars in words."""
    return f"One star takes {limits.one} points, two take {limits.two}, three take {limits.three}."
