"""Window that shows a game and turns input into the local player's actions."""

from __future__ import annotations

import dataclasses
import gc
import time
from pathlib import Path

import pygame

from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.window_layout import KeyRows, UiOverlay
from robotouille_client.window.forms.card_slot import Cards, CardSlot
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.screen import Devices, Display
from robotouille_client.window.input.commands import Command, Gamepads, KeyMap
from robotouille_client.window.input.play_input import PlayInput
from robotouille_client.window.options import DisplayOptions, TimeSource, WindowStyle
from robotouille_client.window.sources.texts import path_words
from robotouille_client.window.view import GameSource, View

_Drawn = tuple[tuple[int, int], object, int, object, UiOverlay, tuple[str, bool, float]]
PRELOAD_SECONDS = 0.0004
"""Mean time after each frame for drawing pictures that later frames may need."""
_IDLE_SECONDS = 0.02
"""Sleep after a frame in which nothing changed; the longest delay until input is handled.

Without input, the window sleeps twice as long until it looks for news of the game.
"""
CARD_KEYS: KeyRows = (("Arrows", "choose"), ("Enter", "OK"), ("Esc", "back"))


class Window:
    """pygame window that shows one game.

    Frames that look the same as the last one are not drawn again: `frames` counts all frames,
    `drawn` the drawn ones.

    Args:
        cards: Cards shown next to the kitchen when the game has ended or the player wants to
            leave. Without cards the window closes itself.
    """

    def __init__(
        self,
        options: DisplayOptions = DisplayOptions(),
        *,
        style: WindowStyle = WindowStyle(),
        cards: Cards | None = None,
        devices: Devices = Devices(),
        time_source: TimeSource = TimeSource(),
    ) -> None:
        self.fps = options.fps
        self.screenshots = options.screenshots or Path.cwd()
        self.closed = False
        self.frames = 0
        self.drawn = 0
        self._drawn_last: _Drawn | None = None
        self._clock = clock = time_source.clock
        self._sleep = time_source.sleep
        self._strip = style.strip
        self._owns_display = devices.display is None
        self._display = devices.display or Display(
            options.size, caption=options.caption, headless=options.headless
        )
        self._gamepads = devices.gamepads or Gamepads()
        self._sounds = devices.sounds
        keys = KeyMap(style.preferences.keys)
        still = style.preferences.reduced_motion
        self._cards = CardSlot(cards, keys, clock, self._take_input_for_card, still=still)
        self._painter = style.painter or Painter(
            style.look.rendering if style.look else None,
            style.look.pictures if style.look else None,
            style.strip,
            preferences=style.preferences,
            words=style.words,
            background=True,
        )
        self._input = PlayInput(
            keys,
            style,
            target=self._target,
            key_at=self._painter.key_at,
            may_leave=cards is not None,
            clock=clock,
        )

    @property
    def size(self) -> tuple[int, int]:
        """Size in pixels while the window does not fill the screen."""
        return self._display.size

    @property
    def card(self) -> Form | None:
        """The card shown next to the kitchen; None if there is none."""
        return self._cards.form

    @property
    def answer(self) -> object:
        """The choice on the card that closed the game; None if the player closed the window."""
        return self._cards.answer

    def overlay(self, view: View) -> UiOverlay:
        """Return the hints, tips and notices that only the local player sees."""
        return self._overlay(view, self._hover(view))

    async def run(self, source: GameSource, *, linger: float | None = 5.0) -> None:
        """Show a source until the window is closed, or until `linger` seconds after its end.

        With `linger=None` the window stays until it is closed.
        """
        self._open(source.view())
        if self._sounds is not None:
            self._sounds.begin()
        if not self._display.headless:
            _freeze_loaded_objects()
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
                if idle and not pygame.event.peek():
                    # Building a view takes longer than looking for input.
                    due += _IDLE_SECONDS
                    await self._sleep(_IDLE_SECONDS)
        finally:
            self.close()

    def frame(self, source: GameSource) -> None:
        """Handle the events since the last frame, then draw."""
        view = source.view()
        self._open(view)
        if self.frames == 0:
            self._cards.start(view)
        for event in pygame.event.get():
            # An event may change anything, e.g. uncover a part of the window.
            self._drawn_last = None
            self._handle(event, source, view)
            view = source.view()
        sent = self._input.controller.queue.sent
        self._input.tick(source, view)
        if self._strip is not None:
            self._strip.tick()
        if self._strip is not None or self._input.controller.queue.sent is not sent:
            view = source.view()
        if self._sounds is not None:
            self._sounds.follow(view)
        over = source.finished and bool(view.outcome or view.farewell)
        if over and self._cards.end(view, at_once=self.frames == 0):
            self._input.close()
        self._cards.pause_for_help(self._input.helping)
        if not self.closed:
            self._cards.refresh(typing=self._input.typing)
            self._draw(view)

    def preload(self) -> None:
        """Draw some of the pictures that later frames may need."""
        surface = self._display.surface
        if surface is not None and not self.closed:
            # Drawing a picture on first use would delay that frame.
            self._painter.preload(surface.get_size(), PRELOAD_SECONDS)

    def screenshot(self, path: Path) -> None:
        """Save the window's contents as a picture.

        Raises:
            OSError: The file cannot be written.
            pygame.error: The suffix is not that of a picture.
        """
        self._display.save(path)

    def close(self) -> None:
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
            # The card or the strip shows the outcome, so the kitchen stays visible.
            shown = dataclasses.replace(shown, outcome="")
        if self._cards.starting:
            # The card says what the kitchen is for, so it is seen as it is.
            shown = dataclasses.replace(shown, pause=None, starts_in=None)
        self.frames += 1
        below = None if self._strip is None else self._strip.redraw_key()
        drawing = (
            surface.get_size(),
            self._painter.redraw_key(shown),
            self._painter.collect_pictures(),
            below,
            overlay,
            self._cards.seen,
        )
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
        """Return the object under the mouse, unless the mouse belongs to a card."""
        return self._input.hover(view) if self.card is None else None

    def _overlay(self, view: View, hover: str | None) -> UiOverlay:
        overlay = self._input.overlay(view, hover)
        if self.card is None:
            return overlay
        keys: KeyRows = CARD_KEYS
        if self._cards.starting and self.card.focused is not None:
            # The card before a game has one answer.
            begins = self.card.focused.label.lower()
            stays = self.card.cancel == MenuChoice.STAY
            keys = (("Enter", begins), ("Esc", begins if stays else "leave"))
        return dataclasses.replace(overlay, hints=(), keys=keys, marks=(), pointer=None)

    # Events

    def _handle(self, event: pygame.Event, source: GameSource, view: View) -> None:
        if event.type == pygame.QUIT:
            self.closed = True
        if event.type == pygame.QUIT or self._display.handle(event):
            return
        self._cards.note_keys(event)
        self._input.point(event)
        if self.card is None and self._strip_handles(event, view):
            return
        self._input.show_notice(self._gamepads.notice(event))
        if event.type == pygame.CONTROLLERDEVICEREMOVED:
            self._input.release()
        pressed = self._gamepads.read(event)
        if view.companion is not None and self.card is None and self._gamepads.for_companion(event):
            self._input.companion_command(pressed, source, view)
            if self._gamepads.let_go(event):
                self._input.companion.release()
            return
        self._run_command(self._dispatch(event, pressed, source, view), view)
        if self._gamepads.let_go(event):
            self._input.controller.release()

    def _dispatch(
        self, event: pygame.Event, pressed: Command | None, source: GameSource, view: View
    ) -> Command | None:
        """Pass an event or gamepad command to the card or the game; return unhandled commands."""
        if self._cards.takes(event, typing=self._input.typing):
            command = self._cards.handle(event, pressed)
            self.closed = self.closed or self.answer is not None
            return command
        if pressed is not None:
            return self._input.command(pressed, source, view)
        self._cards.wait()
        return self._input.handle(event, source, view)

    def _take_input_for_card(self) -> None:
        self._drawn_last = None
        self._input.release()
        if self._strip is not None:
            self._strip.handle(pygame.Event(pygame.WINDOWFOCUSLOST), pygame.Rect(0, 0, 0, 0))

    def _run_command(self, command: Command | None, view: View) -> None:
        if command is Command.FULLSCREEN:
            self._display.toggle_fullscreen()
        elif command is Command.SCREENSHOT:
            self._save_screenshot()
        elif command is Command.SOUND and self._sounds is not None:
            self._input.show_notice(self._sounds.toggle())
        elif command in (Command.CANCEL, Command.MENU):
            self._cards.leave(view, at_once=self.frames == 0)

    def _strip_handles(self, event: pygame.Event, view: View) -> bool:
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
            self._input.show_notice(f"Could not save the screenshot: {error}")
        else:
            self._input.show_notice(f"Screenshot saved: {path_words(path)}")


def _freeze_loaded_objects() -> None:
    # A full collection delays a frame by about 30 ms. Modules and the task stay until the end,
    # so later collections need not visit them.
    gc.unfreeze()
    gc.collect()
    gc.freeze()
