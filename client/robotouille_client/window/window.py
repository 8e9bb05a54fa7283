"""A window onto an episode: shows a source's views and sends it what its owner does."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import time
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from pathlib import Path

import pygame

from robotouille.world.people.wording import Wording
from robotouille.world.world import State
from robotouille_client.window.chat_line import ChatLine
from robotouille_client.window.controls import Button, Controls, Meaning
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.strip import Strip
from robotouille_client.window.view import Source, View

__all__ = ["Window"]

_NOTICE_SECONDS = 3.0
_IDLE_SECONDS = 0.02
"""How long a window sleeps that has drawn nothing: input is seen within that time."""
_BUTTONS: dict[int, Button] = {1: "left", 2: "middle", 3: "right"}
_Asked = tuple[State, str | None, str | None, tuple[bool, bool, bool]]
_Drawn = tuple[tuple[int, int], View, UiOverlay]
_OWN_KEYS = (
    ("T or Enter", "say something (Enter sends, Esc cancels)"),
    ("H", "this help"),
    ("F12", "save a screenshot of the window"),
)


class Window:
    """One pygame window.

    `headless` draws the same without a screen. `extra_keys` do more than the window does by
    itself, e.g. pause a recording. `look` is that of a kitchen which is not installed. A `strip` is
    drawn below the kitchen, and asked first about each event; a `painter` that is given draws
    instead of the window's own, and draws the strip itself. `clock` and `sleep` are injected for
    tests.

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
        extra_keys: Mapping[str, Callable[[], None]] | None = None,
        look: KitchenLook | None = None,
        strip: Strip | None = None,
        painter: Painter | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.size = size
        self.caption = caption
        self.fps = fps
        self.headless = headless
        self.screenshots = screenshots or Path.cwd()
        self.closed = False
        self.frames = 0
        self.drawn = 0
        self._drawn_last: _Drawn | None = None
        self._extra_keys = extra_keys or {}
        self._clock = clock
        self._sleep = sleep
        self._look = look
        self._strip = strip
        self._painter = painter or Painter(
            look.rendering if look else None, look.pictures if look else None, strip
        )
        self._chat = ChatLine()
        self._controls: Controls | None = None
        self._help = False
        self._pointer: tuple[int, int] | None = None
        self._notice = ""
        self._notice_until = 0.0
        self._pending: Callable[[View], Meaning] | None = None
        self._surface: pygame.Surface | None = None
        self._advice: tuple[_Asked, tuple[str, ...], str] | None = None

    async def run(self, source: Source, *, linger: float | None = 5.0) -> None:
        """Show a source until the window is closed, or `linger` seconds after it has finished.

        With a linger of None the window stays until it is closed.
        """
        self._open(source.view())
        ended: float | None = None
        due = self._clock()
        try:
            while not self.closed:
                drawn = self.drawn
                self.frame(source)
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
        if self._surface is None:
            self._open(source.view())
        for event in pygame.event.get():
            self._drawn_last = None
            self._handle(event, source, source.view())
        self._retry(source, source.view())
        self._draw(source.view())

    def screenshot(self, path: Path | str) -> None:
        """Save what the window shows as a picture."""
        if self._surface is not None:
            pygame.image.save(self._surface, path)

    def close(self) -> None:
        """Close the window; it cannot be opened again."""
        self.closed = True
        if self._surface is not None:
            self._surface = None
            pygame.display.quit()

    # Drawing

    def _open(self, view: View) -> None:
        if self._surface is not None:
            return
        if self.headless:
            os.environ["SDL_VIDEODRIVER"] = "dummy"
        pygame.display.init()
        pygame.font.init()
        icon = self._painter.icon(view.world, 64)
        if icon is not None:
            pygame.display.set_icon(icon)
        self._surface = pygame.display.set_mode(self.size, pygame.RESIZABLE)
        pygame.display.set_caption(self.caption)

    def _draw(self, view: View) -> None:
        surface = pygame.display.get_surface()
        if self.closed or surface is None:
            return
        self._surface = surface
        hover = None if view.frozen else self._target(view)
        shown = dataclasses.replace(view, hover=view.hover or hover)
        overlay = self._ui_overlay(view, hover)
        self.frames += 1
        drawing = (surface.get_size(), self._painter.seen(shown), overlay)
        if drawing == self._drawn_last and self._strip is None:
            return  # A strip may have changed; nothing says so.
        self._drawn_last = drawing
        self._painter.paint(surface, shown, overlay)
        pygame.display.flip()
        self.drawn += 1

    def _ui_overlay(self, view: View, hover: str | None) -> UiOverlay:
        interrupted = (view.pause is not None, view.offline is not None, view.frozen)
        key = (view.state, view.me, hover, interrupted)
        if self._advice is None or self._advice[0] != key:
            self._advice = (key, self._tips(view, hover), self._prompt(view))
        _, tips, prompt = self._advice
        return UiOverlay(
            pointer=self._pointer,
            tips=tips,
            prompt=self._notice if self._clock() < self._notice_until else prompt,
            typing=self._chat.typed,
            help=(*self._controls_of(view).help(), *_OWN_KEYS) if self._help else (),
        )

    def _prompt(self, view: View) -> str:
        if view.pause is not None and view.offline is None:
            return "T to chat · H for help"
        if view.frozen:
            return ""
        if view.me is None:
            return "" if self._strip is not None else "You are watching · H for help"
        options = self._controls_of(view).options(view.state, view.me)
        wording = self._wording(view)
        words = [f"[{o.key.upper()}] {wording.action(o.action, view.state)}" for o in options]
        return " · ".join(words) or ("" if view.step else "H for help")

    def _tips(self, view: View, hover: str | None) -> tuple[str, ...]:
        if hover is None:
            return ()
        name = self._wording(view).thing(hover, view.state)
        title = name[:1].upper() + name[1:]
        if view.me is None:
            return (title,)
        meaning = self._controls_of(view).click(view.state, view.me, hover)
        if not meaning.valid:
            return (title, meaning.hint) if meaning.hint else (title,)
        return (meaning.hint,)

    def _wording(self, view: View) -> Wording:
        names = {seat.player: seat.name for seat in view.seats}
        return self._controls_of(view).wording(view.me, names)

    # Events

    def _handle(self, event: pygame.Event, source: Source, view: View) -> None:
        if event.type == pygame.QUIT:
            self.closed = True
        elif self._taken_by_strip(event, view):
            return
        elif event.type == pygame.MOUSEMOTION:
            self._pointer = event.pos
        elif event.type == pygame.WINDOWLEAVE:
            self._pointer = None
        elif event.type == pygame.MOUSEBUTTONDOWN:
            self._pointer = event.pos
            self._click(_BUTTONS.get(event.button), source, view)
        elif event.type == pygame.TEXTINPUT:
            self._chat.text(event.text)
        elif event.type == pygame.KEYDOWN:
            self._key(event.key, source, view)

    def _taken_by_strip(self, event: pygame.Event, view: View) -> bool:
        if self._strip is None or self._surface is None or self._chat.typed is not None:
            return False
        area = self._painter.layout(self._surface.get_size(), view.world).strip
        return self._strip.handle(event, area)

    def _click(self, button: Button | None, source: Source, view: View) -> None:
        target, me = self._target(view), view.me
        if self._help:
            self._help = False
        elif target is not None and me is not None and button is not None:
            self._do(partial(self._clicked, me, target, button), source, view)

    def _clicked(self, me: str, target: str, button: Button, view: View) -> Meaning:
        return self._controls_of(view).click(view.state, me, target, button)

    def _pressed(self, me: str, key: str, view: View) -> Meaning:
        return self._controls_of(view).key(view.state, me, key)

    def _key(self, key: int, source: Source, view: View) -> None:
        name = pygame.key.name(key).casefold()
        if self._chat.typed is not None:
            said = self._chat.key(name)
            if said:
                source.say(said)
            return
        me = view.me
        if name in self._extra_keys:
            self._extra_keys[name]()
        elif name == "escape":
            self._help, self._pending = False, None
        elif name == "f12":
            self._save_screenshot()
        elif me is not None and name in self._controls_of(view).keys:
            self._do(partial(self._pressed, me, name), source, view)
        elif name == "h":
            self._help = not self._help
        elif name in ("t", "return"):
            self._chat.open(name)

    def _do(self, read: Callable[[View], Meaning], source: Source, view: View) -> None:
        """Act on an input, or keep it until the player is no longer busy."""
        if view.frozen:
            return
        meaning = read(view)
        self._pending = None
        if meaning.action is not None:
            source.act(meaning.action)
        elif view.me is not None and view.state.busy_steps(view.me):
            self._pending = read
            self._tell(f"{meaning.hint}; what you asked for comes next (Esc to cancel)")
        elif meaning.hint:
            self._tell(meaning.hint[0].upper() + meaning.hint[1:])

    def _retry(self, source: Source, view: View) -> None:
        if self._pending is None or view.me is None or view.frozen:
            return
        if view.state.busy_steps(view.me):
            return
        read, self._pending = self._pending, None
        self._notice = ""
        self._do(read, source, view)

    def _target(self, view: View) -> str | None:
        """The station under the mouse, else the uppermost thing there."""
        if self._pointer is None or self._surface is None:
            return None
        place = self._painter.layout(self._surface.get_size(), view.world)
        tile = place.tile_at(self._pointer)
        stage = self._painter.stage(view.state)
        there = [name for name, placed in stage.placed.items() if placed.tile == tile]
        if tile is None or not there:
            return None
        return min(there, key=lambda name: (name not in stage.stations, stage.placed[name].level))

    def _controls_of(self, view: View) -> Controls:
        if self._controls is None or self._controls.world is not view.world:
            look = self._look
            self._controls = (
                Controls(view.world, look.bindings, look.rendering.language)
                if look
                else Controls(view.world)
            )
        return self._controls

    def _save_screenshot(self) -> None:
        stamp = time.strftime("%Y%m%d-%H%M%S")
        path = self.screenshots / f"robotouille-{stamp}-{self.frames}.png"
        try:
            self.screenshot(path)
        except (pygame.error, OSError) as error:
            self._tell(f"The screenshot cannot be saved: {error}")
        else:
            self._tell(f"Saved {path}")

    def _tell(self, notice: str) -> None:
        self._notice = notice
        self._notice_until = self._clock() + _NOTICE_SECONDS
