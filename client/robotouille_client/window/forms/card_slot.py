"""Cards next to the kitchen: what a game is about, whether to leave it, and its result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Protocol

import pygame

from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.input.commands import Command, KeyMap
from robotouille_client.window.view import View


class Cards(Protocol):
    """Cards of one kind of game. Every answer but `stay` closes the game."""

    def start_card(self, view: View) -> Form | None:
        """Return the card before a game, which waits for it; None to show none."""

    def end_card(self, view: View) -> Form | None:
        """Return the card for the end of the game; None to show none."""

    def leave_card(self, view: View) -> Form:
        """Return the card that asks whether to leave a running game."""

    def message(self) -> str:
        """Return a new message for the card that is shown, or ""."""

    def stay(self) -> None:
        """Continue a game that the player decided not to leave."""

    def pause(self, paused: bool) -> None:
        """Pause or resume a game without other people, while the player reads the help."""


QUIET_SECONDS = 0.7
"""Time without a key press after which a card that opened by itself accepts keys.

A player still presses keys of the game when the card opens.
"""
MOVING_SECONDS = 2.5
"""Time for which something moves on a card that opened by itself, such as stars."""
_WINDOW_COMMANDS = (Command.FULLSCREEN, Command.SCREENSHOT, Command.SOUND)
"""Commands of the window, which work whatever is shown."""
_NOT_REPEATED = (Command.ENTER, Command.CANCEL)
"""Commands that nobody presses repeatedly during a game."""


class ShownCard:
    """Card that a player opened, or that opened `by_itself` at the end of a game.

    A card accepts arrows, Enter, Esc, the mouse and gamepads, but no letters or space, which
    belong to the game. A card that opened by itself ignores everything until the player has
    stopped playing or typing for a moment. A key held since before the card opened does not count.

    Args:
        at_once: True if the card accepts keys immediately, e.g. when the player returns to it.
    """

    def __init__(
        self,
        form: Form,
        clock: Callable[[], float],
        *,
        by_itself: bool = False,
        at_once: bool = False,
        held: Iterable[int] = (),
    ) -> None:
        self.form = form
        self.by_itself = by_itself
        self._clock = clock
        moves = by_itself and not at_once and any(row.moves for row in form.rows)
        self._moves_from = clock() if moves else -math.inf
        self._held = set(held)
        patience = QUIET_SECONDS if by_itself and not at_once else 0.0
        self._mouse_from = self._keys_from = clock() + patience

    @property
    def listens(self) -> bool:
        """True if the card accepts keys and buttons now."""
        return self._clock() >= self._keys_from

    @property
    def age(self) -> float:
        """Seconds since the card opened; infinite if nothing on it moves any more."""
        age = self._clock() - self._moves_from
        return age if age < MOVING_SECONDS else math.inf

    def wait(self) -> None:
        """Wait a moment longer, because the player pressed a key of the game."""
        if self.by_itself:
            self._keys_from = max(self._keys_from, self._clock() + QUIET_SECONDS)

    def handle(self, event: pygame.Event, pressed: Command | None, keys: KeyMap) -> Command | None:
        """Handle an event, or the gamepad command read from it.

        Return a command that is not for the form.
        """
        if event.type == pygame.KEYUP:
            self._held.discard(event.key)
        elif event.type == pygame.WINDOWFOCUSLOST:
            # A key may be released while another window has the focus.
            self._held.clear()
        if pressed is not None:
            return self.form.command(pressed) if self._accepts(pressed) else None
        if event.type == pygame.KEYDOWN:
            return self._key(event, keys)
        # Clicks on a card are deliberate, so keys that are still pressed do not delay them.
        accepted = self._clock() >= self._mouse_from and event.type != pygame.TEXTINPUT
        return self.form.handle(event, keys) if accepted else None

    def _key(self, event: pygame.Event, keys: KeyMap) -> Command | None:
        name = pygame.key.name(event.key).casefold()
        # Letters and space belong to the game and the chat, even if they are bound to a command.
        asked, letter = keys.command(name), len(name) == 1 or name == "space"
        if event.key in self._held:
            return None
        if asked in _WINDOW_COMMANDS and (self.listens or not letter):
            return asked
        if letter:
            self.wait()
            return None
        return self.form.handle(event, keys) if self._accepts(asked) else None

    def _accepts(self, asked: Command | None) -> bool:
        listens = self.listens
        if not (listens or asked in _NOT_REPEATED):
            self.wait()
        return listens


class CardSlot:
    """Place for the cards of a game; stays empty if there are none.

    `answer` is the player's choice on a card that closed the game; None until then. `starting` is
    true while the card before a game is shown.

    Args:
        opened: Function called when a card opens.
        still: True if nothing on a card moves.
    """

    def __init__(
        self,
        cards: Cards | None,
        keys: KeyMap,
        clock: Callable[[], float],
        opened: Callable[[], None],
        *,
        still: bool = False,
    ) -> None:
        self._still = still
        self.answer: object = None
        self.starting = False
        self._cards = cards
        self._keys = keys
        self._clock = clock
        self._opened = opened
        self._card: ShownCard | None = None
        self._held: set[int] = set()
        self._ended = False
        self._paused = False

    @property
    def form(self) -> Form | None:
        """The form of the card that is shown; None if there is none."""
        return None if self._card is None else self._card.form

    @property
    def seen(self) -> tuple[str, bool, float]:
        """Message, state and age of the card, which decide whether it must be drawn again."""
        form = self.form
        return ("", False, 0.0) if form is None else (form.message, form.listens, form.age)

    # Cards

    def start(self, view: View) -> None:
        """Show the card before a game, if there is one."""
        card = None if self._cards is None else self._cards.start_card(view)
        if card is not None:
            self._show(card, at_once=True)
            self.starting = True

    def leave(self, view: View, *, at_once: bool = False) -> None:
        """Ask whether to leave the game."""
        if self._cards is not None:
            self._show(self._cards.leave_card(view), at_once=at_once)

    def end(self, view: View, *, at_once: bool = False) -> bool:
        """Show the card for the end of the game; return False if the end was known before."""
        if self._cards is None or self._ended:
            return False
        self._ended = True
        card = self._cards.end_card(view)
        if card is not None:
            self._show(card, by_itself=True, at_once=at_once)
        return True

    def _show(self, form: Form, *, by_itself: bool = False, at_once: bool) -> None:
        held = self._held
        self._card = ShownCard(form, self._clock, by_itself=by_itself, at_once=at_once, held=held)
        self._opened()

    def pause_for_help(self, reading: bool) -> None:
        """Pause a game without other people while the player reads the help."""
        paused = reading and self._card is None and not self._ended
        if self._cards is not None and paused is not self._paused:
            self._paused = paused
            if self._card is None:
                # A card pauses the game by itself, and closing the help must not end that pause.
                self._cards.pause(paused)

    def refresh(self, *, typing: bool) -> None:
        """Update the message of the card, and whether it accepts keys."""
        if self._card is not None and self._cards is not None:
            form = self._card.form
            form.message = self._cards.message() or form.message
            form.age = math.inf if self._still else self._card.age
            form.listens = self._card.listens and not (typing and self._card.by_itself)

    # Events

    def note_keys(self, event: pygame.Event) -> None:
        """Track which keys are held."""
        if event.type == pygame.KEYDOWN:
            self._held.add(event.key)
        elif event.type == pygame.KEYUP:
            self._held.discard(event.key)
        elif event.type == pygame.WINDOWFOCUSLOST:
            self._held.clear()

    def takes(self, event: pygame.Event, *, typing: bool) -> bool:
        """Return whether an event is for a card.

        A card that opened by itself leaves the keys to a line of chat that was open.
        """
        if self._card is None:
            return False
        typed = event.type in (pygame.KEYDOWN, pygame.TEXTINPUT)
        return not (typed and typing and self._card.by_itself)

    def handle(self, event: pygame.Event, pressed: Command | None) -> Command | None:
        """Pass an event to the card and take its answer; return commands of the window."""
        card = self._card
        if card is None:
            return None
        command = card.handle(event, pressed, self._keys)
        if card.form.result == MenuChoice.STAY:
            self._card, self.starting = None, False
            if self._cards is not None:
                self._cards.stay()
        else:
            self.answer = card.form.result
        return None if command in (Command.CANCEL, Command.MENU) else command

    def wait(self) -> None:
        """Delay the card, because the player typed something else."""
        if self._card is not None:
            self._card.wait()
