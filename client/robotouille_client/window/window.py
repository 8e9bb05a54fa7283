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
from robotouille_client.window.forms.card_slot import CardSlot
from robotouille_client.window.forms.cards import Cards
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.hands.gamepad import Gamepads
from robotouille_client.window.hands.play_input import PlayInput
from robotouille_client.window.hands.sounds import Sounds
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.sources.texts import path_words
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
        self.drawn = 0
        self._drawn_last: _Drawn | None = None
        self._clock = clock
        self._sleep = sleep
        self._strip = strip
        self._owns_display = display is None
        self._display = display or Display(size, caption=caption, headless=headless)
        self._gamepads = gamepads or Gamepads()
        self._sounds = sounds
        keys = KeyMap(preferences.keys)
        self._cards = CardSlot(cards, keys, clock, self._card_came)
        self._painter = painter or Painter(
            look.rendering if look else None,
            look.pictures if look else None,
            strip,
            preferences=preferences,
            words=words,
        )
        self._input = PlayInput(
            keys=keys,
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
        return self._cards.form

    @property
    def answer(self) -> object:
        """What was chosen on a card that ended the game; None if the window was closed."""
        return self._cards.answer

    def overlay(self, view: View) -> UiOverlay:
        """What only its owner sees over a view."""
        return self._overlay(view, self._hover(view))

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
        over = source.finished and bool(view.outcome or view.farewell)
        if over and self._cards.end(view, at_once=self.frames == 0):
            self._input.close()
        self._cards.stand_still(self._input.helping)
        if not self.closed:
            self._cards.refresh(typing=self._input.typing)
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
        if surface is None:
            return
        card, hover = self.card, self._hover(view)
        lost = bool(view.outcome) and not view.won
        shown = dataclasses.replace(view, hover=view.hover or hover, lost=lost)
        overlay = self._overlay(view, hover)
        if card is not None or self._strip is not None:
            shown = dataclasses.replace(shown, outcome="")  # They say it, and cover nothing.
        self.frames += 1
        below = None if self._strip is None else self._strip.seen()
        drawing = surface.get_size(), self._painter.seen(shown), below, overlay, self._cards.seen
        if drawing == self._drawn_last:
            return
        self._drawn_last = drawing
        self._painter.paint(surface, shown, overlay)
        if card is not None:
            place = self._painter.layout(surface.get_size(), view.world)
            card.draw(surface, place.panel, self._painter.text, max(11, place.text - 2))
        self._display.flip()
        self.drawn += 1

    def _hover(self, view: View) -> str | None:
        """What is under the mouse in the kitchen, where that is what the mouse is for."""
        return self._input.hover(view) if self.card is None else None

    def _overlay(self, view: View, hover: str | None) -> UiOverlay:
        overlay = self._input.overlay(view, hover)
        if self.card is None:
            return overlay
        return dataclasses.replace(overlay, hints=(), keys=CARD_KEYS, mark=None, pointer=None)

    # Events

    def _handle(self, event: pygame.Event, source: Source, view: View) -> None:
        if event.type == pygame.QUIT:
            self.closed = True
        if event.type == pygame.QUIT or self._display.handle(event):
            return
        self._cards.note_keys(event)
        self._input.point(event)
        if self.card is None and self._taken_by_strip(event, view):
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
        if self._cards.takes(event, typing=self._input.typing):
            command = self._cards.handle(event, pressed)
            self.closed = self.closed or self.answer is not None
            return command
        if pressed is not None:
            return self._input.command(pressed, source, view)
        self._cards.wait()
        return self._input.handle(event, source, view)

    def _card_came(self) -> None:
        """The mouse and what is held are a card's now."""
        self._drawn_last = None
        self._input.hands.release()
        if self._strip is not None:
            self._strip.handle(pygame.Event(pygame.WINDOWFOCUSLOST), pygame.Rect(0, 0, 0, 0))

    def _obey(self, command: Command | None, view: View) -> None:
        """Do what is not the game's."""
        if command is Command.FULLSCREEN:
            self._display.toggle_fullscreen()
        elif command is Command.SCREENSHOT:
            self._save_screenshot()
        elif command is Command.SOUND and self._sounds is not None:
            self._input.tell(self._sounds.toggle())
        elif command in (Command.CANCEL, Command.MENU):
            self._cards.leave(view, at_once=self.frames == 0)

    def _taken_by_strip(self, event: pygame.Event, view: View) -> bool:
        surface = self._display.surface
        if self._strip is None or surface is None or self._input.typing:
            return False
        area = self._painter.layout(surface.get_size(), view.world).strip
        return self._strip.handle(event, area)

    def _target(self, pointer: tuple[int, int], view: View) -> str | None:
        surface = self._display.surface
        if surface is None:
            return None
        return self._painter.thing_at(pointer, surface.get_size(), view)

    def _save_screenshot(self) -> None:
        stamp = time.strftime("%Y%m%d-%H%M%S")
        path = self.screenshots / f"robotouille-{stamp}-{self.frames}.png"
        try:
            self.screenshots.mkdir(parents=True, exist_ok=True)
            self.screenshot(path)
        except (pygame.error, OSError) as error:
            self._input.tell(f"The screenshot cannot be saved: {error}")
        else:
            self._input.tell(f"Saved {path_words(path)}")


def _set_aside_what_stays() -> None:
    """Look for garbage now, and then no more in what is left, which is modules and the task: that
    would hold a frame up for some 30 ms, now and then."""
    gc.unfreeze()
    gc.collect()
    gc.freeze()
