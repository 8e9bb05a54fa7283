"""The place beside a kitchen in which one card at a time is shown, and answered."""

from __future__ import annotations

from collections.abc import Callable

import pygame

from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.forms.cards import Cards
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.shown_card import ShownCard
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.view import View

__all__ = ["CardSlot"]


class CardSlot:
    """Shows the `cards` of a game when their time comes; where it has none, nothing is ever shown.

    `answer` is what was chosen on a card, None until then; who stays in the game takes the card
    away.

    Args:
        came: Is called when a card comes; what is over the kitchen has no keys of its own then.
    """

    def __init__(
        self,
        cards: Cards | None,
        keys: KeyMap,
        clock: Callable[[], float],
        came: Callable[[], None],
    ) -> None:
        self.answer: object = None
        self._cards = cards
        self._keys = keys
        self._clock = clock
        self._came = came
        self._card: ShownCard | None = None
        self._held: set[int] = set()
        self._over = False
        self._still = False

    @property
    def form(self) -> Form | None:
        """What is asked, if anything is."""
        return None if self._card is None else self._card.form

    @property
    def seen(self) -> tuple[str, bool]:
        """What can be seen to change in a card: what it tells, and whether it listens."""
        form = self.form
        return ("", False) if form is None else (form.message, form.listens)

    # What is shown

    def leave(self, view: View, *, at_once: bool = False) -> None:
        """Ask whether one means to leave a game; `at_once` is as for a `ShownCard`."""
        if self._cards is not None:
            self._show(self._cards.leaving(view), at_once=at_once)

    def end(self, view: View, *, at_once: bool = False) -> bool:
        """Show the card of a game that is over; whether it was not over before."""
        if self._cards is None or self._over:
            return False
        self._over = True
        card = self._cards.over(view)
        if card is not None:
            self._show(card, by_itself=True, at_once=at_once)
        return True

    def _show(self, form: Form, *, by_itself: bool = False, at_once: bool) -> None:
        held = self._held
        self._card = ShownCard(form, self._clock, by_itself=by_itself, at_once=at_once, held=held)
        self._came()

    def stand_still(self, reading: bool) -> None:
        """Let a game stand still while its owner reads the help, where it is theirs alone."""
        still = reading and self._card is None and not self._over
        if self._cards is not None and still is not self._still:
            self._still = still
            if self._card is None:
                self._cards.stand_still(still)

    def refresh(self, *, typing: bool) -> None:
        """Bring what is new to the card that is shown; its owner may be typing a line of chat."""
        if self._card is not None and self._cards is not None:
            form = self._card.form
            form.message = self._cards.news() or form.message
            form.listens = self._card.listens and not (typing and self._card.by_itself)

    # Events

    def note_keys(self, event: pygame.Event) -> None:
        """Follow which keys are held."""
        if event.type == pygame.KEYDOWN:
            self._held.add(event.key)
        elif event.type == pygame.KEYUP:
            self._held.discard(event.key)
        elif event.type == pygame.WINDOWFOCUSLOST:
            self._held.clear()

    def takes(self, event: pygame.Event, *, typing: bool) -> bool:
        """Whether an event is for a card: one that came by itself leaves the keys to the line of
        chat that was open."""
        if self._card is None:
            return False
        typed = event.type in (pygame.KEYDOWN, pygame.TEXTINPUT)
        return not (typed and typing and self._card.by_itself)

    def handle(self, event: pygame.Event, pressed: Command | None) -> Command | None:
        """Give the card an event, which a gamepad may have `pressed` a command with, and take its
        answer; a command that is the window's comes back."""
        card = self._card
        if card is None:
            return None
        command = card.handle(event, pressed, self._keys)
        if card.form.result == Answer.STAY:
            self._card = None
            if self._cards is not None:
                self._cards.stay()
        else:
            self.answer = card.form.result
        return None if command in (Command.CANCEL, Command.MENU) else command

    def wait(self) -> None:
        """Something was typed that is not for the card."""
        if self._card is not None:
            self._card.wait()
