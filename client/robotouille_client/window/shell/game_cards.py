"""The cards of a game."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button
from robotouille_client.window.shell.end_card import end_card
from robotouille_client.window.view import View

__all__ = ["LEAVE_BUTTONS", "REVIEW_BUTTONS", "GameCards"]

REVIEW_BUTTONS = (("Watch the replay", Answer.WATCH), ("Save a video", Answer.VIDEO))
"""What can be done with a game that is over and was kept."""
LEAVE_BUTTONS = (("Menu", Answer.MENU), ("Quit", Answer.QUIT))


class GameCards:
    """What is asked in a game and after it; `buttons` are words and answers, asked for then.

    `stand_still` is told whether the game's owner is being asked whether to leave it, or reads the
    help. Without a `menu` to go to, whoever leaves a game closes the window. `news` are told on the
    card, as soon as there are any. `ended` is called when the game is over, before its card
    is shown.
    """

    def __init__(
        self,
        outcome: Callable[[], Mapping[str, Any] | None],
        buttons: Callable[[], Sequence[tuple[str, object]]],
        stand_still: Callable[[bool], None] = lambda still: None,
        *,
        menu: bool = True,
        news: Callable[[], str] = lambda: "",
        ended: Callable[[], None] = lambda: None,
    ) -> None:
        self._outcome = outcome
        self._buttons = buttons
        self._menu = menu
        self._news = news
        self._ended = ended
        self._stand_still = stand_still
        self._message = ""
        self._chosen: object = None
        self._card: Form | None = None

    def over(self, view: View) -> Form:
        """What one sees, and may do, when a game is over."""
        self._ended()
        form = end_card(view, self._outcome(), self._buttons())
        form.message = self._message
        row = next((row for row in form.rows if row.answer == self._chosen), None)
        if row is not None and self._chosen is not None:
            form.focus(row)
        self._card = form
        return form

    def came_back(self, message: str, chosen: object) -> None:
        """The game is shown once more, e.g. after its replay, which was `chosen`: its card tells
        what came of that."""
        self._message, self._chosen = message, chosen

    def leaving(self, view: View) -> Form:
        """Whether one means to leave a game that goes on."""
        self._stand_still(True)
        rows = [
            Button("Go on", Answer.STAY),
            Button("Leave it", Answer.MENU if self._menu else Answer.QUIT),
        ]
        if self._menu:
            rows.append(Button("Quit", Answer.QUIT))
        return Form("Leave this game?", rows, cancel=Answer.STAY)

    def stay(self) -> None:
        self._stand_still(False)

    def stand_still(self, still: bool) -> None:
        self._stand_still(still)

    def news(self) -> str:
        """What has happened since a card is shown, which offers what can be done about it."""
        if self._card is not None:
            _offer(self._card, self._buttons())
        return self._news()


def _offer(card: Form, buttons: Sequence[tuple[str, object]]) -> None:
    """Give a card other buttons; those that it has already stay, and the focus with them."""
    shown = {row.answer: row for row in card.rows if row.answer is not None}
    if list(shown) == [answer for _, answer in buttons]:
        return
    told = [row for row in card.rows if row.answer is None]
    card.set_rows([*told, *(shown.get(a) or Button(label, a) for label, a in buttons)])
