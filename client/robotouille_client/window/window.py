"""A window onto an episode: shows a source's views and sends it what its owner does."""

from __future__ import annotations

import asyncio
import dataclasses
import gc
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pygame

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.forms.cards import Cards
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.shown_card import ShownCard
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.hands.gamepad import Gamepads
from robotouille_client.window.hands.play_input import PlayInput
from robotouille_client.window.hands.sounds import Sounds
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.strip import Strip
from robotouille_client.window.view import Source, View

__all__ = ["Window"]

_Drawn = tuple[tuple[int, int], object, object, UiOverlay, tuple[str, bool]]
PRELOAD_SECONDS = 0.0004
"""After each frame, for pictures that may be needed; one that is begun is drawn to its end."""
_IDLE_SECONDS = 0.02
"""How long a window sleeps that has drawn nothing: input is seen within that time."""
CARD_KEYS = (("Arrows", "choose"), ("Enter", "do it"), ("Esc", "back"))


class Window:
    """One pygame window.

    It draws and listens as its owner's `preferences` have it; `size` is that of a display of its
    own, and `headless` draws the same without a screen. `look` is that of a kitchen which is not
    installed, in place of the preferred one; `words` are laid over those of its language. A `strip`
    is drawn below the kitchen, and asked first about each event; a `painter` that is given draws
    instead of the window's own, and draws the strip itself. A `display` that is given stays open
    when this window is closed. `cards` are shown beside the kitchen when a game is over, and when
    its owner wants to leave it; `answer` is what was chosen there, None if the window was closed.
    `sounds` are told each view. `clock` and `sleep` are injected for tests.

    Of its `frames` only those are `drawn` that look different, or follow an event.
    """

    def __init__(
        self,
        size: tuple[int, int] = (1280, 720),
        *,
        caption: str = "Robotouille",
        fps: int = 60,
        headless: bool = False,
        screenshots: Path | None = None,
        preferences: Preferences = Preferences(),
        look: KitchenLook | None = None,
        words: Language = NO_WORDS,
        strip: Strip | None = None,
        painter: Painter | None = None,
        display: Display | None = None,
        gamepads: Gamepads | None = None,
        cards: Cards | None = None,
        sounds: Sounds | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.fps = fps
        self.screenshots = screenshots or Path.cwd()
        self.closed = False
        self.frames = 0
        self.answer: object = None
        self.drawn = 0
        self._drawn_last: _Drawn | None = None
        self._clock = clock
        self._sleep = sleep
        self._strip = strip
        self._owns_display = display is None
        self._display = display or Display(size, caption=caption, headless=headless)
        self._gamepads = gamepads or Gamepads()
        self._cards = cards
        self._sounds = sounds
        self._card: ShownCard | None = None
        self._keys = KeyMap(preferences.keys)
        self._keys_down: set[int] = set()
        self._over = False
        self._still = False
        self._painter = painter or Painter(
            look.rendering if look else None,
            look.pictures if look else None,
            strip,
            preferences=preferences,
            words=words,
        )
        self._input = PlayInput(
            keys=self._keys,
            look=look,
            words=words,
            target=self._target,
            key_at=self._painter.key_at,
            alone=strip is None,
            may_leave=cards is not None,
            clock=clock,
        )

    @property
    def size(self) -> tuple[int, int]:
        """Its size in pixels, while it does not fill the screen."""
        return self._display.size

    @property
    def card(self) -> Form | None:
        """What is asked beside the kitchen, if anything is."""
        return None if self._card is None else self._card.form

    async def run(self, source: Source, *, linger: float | None = 5.0) -> None:
        """Show a source until the window is closed, or `linger` seconds after it has finished.

        With a linger of None the window stays until it is closed.
        """
        self._open(source.view())
        if self._sounds is not None:
            self._sounds.begin()
        if not self._display.headless:
            _set_aside_what_stays()
        ended: float | None = None
        due = self._clock()
        try:
            while not self.closed:
                drawn = self.drawn
                self.frame(source)
                self.preload()
                idle = _IDLE_SECONDS if self.drawn == drawn else 0.0
                now = self._clock()
                if source.finished and linger is not None:
                    ended = now if ended is None else ended
                    if now - ended >= linger:
                        break
                due = max(due + max(idle, 1 / self.fps), now)
                await self._sleep(due - now)
        finally:
            self.close()

    def frame(self, source: Source) -> None:
        """Handle what has happened since the last frame, then draw."""
        view = source.view()
        self._open(view)
        for event in pygame.event.get():
            self._drawn_last = None
            self._handle(event, source, view)
            view = source.view()
        sent = self._input.hands.queue.sent
        self._input.tick(source, view)
        if self._strip is not None:
            self._strip.tick()
        if self._strip is not None or self._input.hands.queue.sent is not sent:
            view = source.view()
        if self._sounds is not None:
            self._sounds.follow(view)
        self._show_end(source, view)
        self._wait_for_reader()
        self._draw(view)

    def preload(self) -> None:
        """Draw some of the pictures that later frames may need."""
        surface = self._display.surface
        if surface is not None and not self.closed:
            self._painter.preload(surface.get_size(), PRELOAD_SECONDS)

    def screenshot(self, path: Path | str) -> None:
        """Save what the window shows as a picture."""
        self._display.save(path)

    def close(self) -> None:
        """Close the window; it cannot be opened again."""
        self.closed = True
        if self._owns_display:
            self._display.close()

    def _open(self, view: View) -> None:
        if not self._display.is_open:
            if not pygame.font.get_init():
                pygame.font.init()
            self._display.open(self._painter.icon(view.world, 64))
            if not self._display.headless:
                self._gamepads.open()

    def _draw(self, view: View) -> None:
        surface = self._display.surface
        if self.closed or surface is None:
            return
        hover = self._input.hover(view) if self._card is None else None
        lost = bool(view.outcome) and not view.won
        shown = dataclasses.replace(view, hover=view.hover or hover, lost=lost)
        overlay = self._input.overlay(view, hover)
        if self._card is not None or self._strip is not None:
            shown = dataclasses.replace(shown, outcome="")  # They say it, and cover nothing.
        if self._card is not None:
            overlay = dataclasses.replace(
                overlay, hints=(), keys=CARD_KEYS, mark=None, pointer=None
            )
        self.frames += 1
        below = None if self._strip is None else self._strip.seen()
        told = self._update_card()
        drawing = (surface.get_size(), self._painter.seen(shown), below, overlay, told)
        if drawing == self._drawn_last:
            return
        self._drawn_last = drawing
        self._painter.paint(surface, shown, overlay)
        if self._card is not None:
            place = self._painter.layout(surface.get_size(), view.world)
            form = self._card.form
            form.draw(surface, place.panel, self._painter.text, max(11, place.text - 2))
        self._display.flip()
        self.drawn += 1

    def _update_card(self) -> tuple[str, bool]:
        """Bring what is new to the card that is shown; what it tells, and whether it listens."""
        if self._card is None or self._cards is None:
            return "", False
        form = self._card.form
        form.message = self._cards.news() or form.message
        form.listens = self._card.listens and not self._chats_over(self._card)
        return form.message, form.listens

    # Events

    def _handle(self, event: pygame.Event, source: Source, view: View) -> None:
        if event.type == pygame.QUIT:
            self.closed = True
        if event.type == pygame.QUIT or self._display.handle(event):
            return
        self._note_keys(event)
        self._input.point(event)
        if self._card is None and self._taken_by_strip(event, view):
            return
        self._input.tell(self._gamepads.notice(event))
        pressed = self._gamepads.read(event)
        self._obey(self._hand_on(event, pressed, source, view), view)
        if self._gamepads.let_go(event):
            self._input.hands.release()

    def _hand_on(
        self, event: pygame.Event, pressed: Command | None, source: Source, view: View
    ) -> Command | None:
        """Give an event, or what was pressed on a gamepad, to the card or the game."""
        card, typed = self._card, event.type in (pygame.KEYDOWN, pygame.TEXTINPUT)
        if card is not None and not (typed and self._chats_over(card)):
            return self._ask(card, event, pressed)
        if pressed is not None:
            return self._input.command(pressed, source, view)
        if card is not None:
            card.wait()
        return self._input.handle(event, source, view)

    def _note_keys(self, event: pygame.Event) -> None:
        """Follow which keys are held."""
        if event.type == pygame.KEYDOWN:
            self._keys_down.add(event.key)
        elif event.type == pygame.KEYUP:
            self._keys_down.discard(event.key)
        elif event.type == pygame.WINDOWFOCUSLOST:
            self._keys_down.clear()

    def _chats_over(self, card: ShownCard) -> bool:
        """Whether the line of chat that was open when a card came by itself still is: it has the
        keys."""
        return card.by_itself and self._input.typing

    def _obey(self, command: Command | None, view: View) -> None:
        """Do what is not the game's."""
        if command is Command.FULLSCREEN:
            self._display.toggle_fullscreen()
        elif command is Command.SCREENSHOT:
            self._save_screenshot()
        elif command is Command.SOUND and self._sounds is not None:
            self._input.tell(self._sounds.toggle())
        elif command in (Command.CANCEL, Command.MENU) and self._cards is not None:
            self._show(self._cards.leaving(view))

    # Cards

    def _wait_for_reader(self) -> None:
        """Let a game stand still while its owner reads the help, where it is theirs alone."""
        still = self._input.helping and self._card is None and not self._over
        if self._cards is not None and still is not self._still:
            self._still = still
            if self._card is None:
                self._cards.stand_still(still)

    def _show_end(self, source: Source, view: View) -> None:
        """The card of a game that is over, once."""
        over = source.finished and bool(view.outcome or view.farewell)
        if over and self._cards is not None and not self._over:
            self._over = True
            self._input.close()
            card = self._cards.over(view)
            if card is not None:
                self._show(card, by_itself=True)

    def _show(self, form: Form, *, by_itself: bool = False) -> None:
        """Ask something; what was over before it was shown here has no keys of its own."""
        at_once, held = self.frames == 0, self._keys_down
        self._card = ShownCard(form, self._clock, by_itself=by_itself, at_once=at_once, held=held)
        self._drawn_last = None
        self._input.hands.release()
        if self._strip is not None:  # The mouse and what is held are the card's now.
            self._strip.handle(pygame.Event(pygame.WINDOWFOCUSLOST), pygame.Rect(0, 0, 0, 0))

    def _ask(self, card: ShownCard, event: pygame.Event, pressed: Command | None) -> Command | None:
        """Give the card what is done, and take its answer."""
        command = card.handle(event, pressed, self._keys)
        result = card.form.result
        if result == Answer.STAY:
            self._card = None
            if self._cards is not None:
                self._cards.stay()
        elif result is not None:
            self.answer, self.closed = result, True
        return None if command in (Command.CANCEL, Command.MENU) else command

    def _taken_by_strip(self, event: pygame.Event, view: View) -> bool:
        surface = self._display.surface
        if self._strip is None or surface is None or self._input.typing:
            return False
        area = self._painter.layout(surface.get_size(), view.world).strip
        return self._strip.handle(event, area)

    def _target(self, pointer: tuple[int, int], view: View) -> str | None:
        """The station under a point, else the uppermost thing there."""
        surface = self._display.surface
        if surface is None:
            return None
        tile = self._painter.layout(surface.get_size(), view.world).tile_at(pointer)
        stage = self._painter.stage(view.state)
        there = [name for name, placed in stage.placed.items() if placed.tile == tile]
        if tile is None or not there:
            return None
        return min(there, key=lambda name: (name not in stage.stations, stage.placed[name].level))

    def _save_screenshot(self) -> None:
        stamp = time.strftime("%Y%m%d-%H%M%S")
        path = self.screenshots / f"robotouille-{stamp}-{self.frames}.png"
        try:
            self.screenshot(path)
        except (pygame.error, OSError) as error:
            self._input.tell(f"The screenshot cannot be saved: {error}")
        else:
            self._input.tell(f"Saved {path}")


def _set_aside_what_stays() -> None:
    """Look for garbage now, and then no more in what is left, which is modules and the task: that
    would hold a frame up for some 30 ms, now and then."""
    gc.unfreeze()
    gc.collect()
    gc.freeze()
