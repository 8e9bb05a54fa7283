"""Forms that a game shows beside its kitchen."""

from __future__ import annotations

from typing import Protocol

from robotouille_client.window.forms.form import Form
from robotouille_client.window.view import View

__all__ = ["Cards"]


class Cards(Protocol):
    """What is asked in a game; each answer but `stay` ends it."""

    def over(self, view: View) -> Form | None:
        """What one sees, and may do, when a game is over; None: no more than before."""

    def leaving(self, view: View) -> Form:
        """Whether one means to leave a game that goes on."""

    def news(self) -> str:
        """What is to be told on a card that is shown; empty for nothing new."""

    def stay(self) -> None:
        """One goes on with the game, which one did not mean to leave."""

    def stand_still(self, still: bool) -> None:
        """Its owner reads something, and is done with it: a game that is theirs alone waits."""
