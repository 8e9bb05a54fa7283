"""The keys of the viewer: what they do, and how that is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pygame

from robotouille_client.window.replay.history.history import History, Mark
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.viewer_state import ViewerState

__all__ = ["ViewerKeys"]

REPEAT_AFTER, REPEAT_EVERY = 0.35, 0.04
"""Seconds after which a key that is held acts again, and how often then."""
_MANY = 10
_SHARE = 10
"""A page is one part in so many of the episode."""

_HELP = (
    ("Space", "pause, go on; at the end, begin anew"),
    ("Left Right", "one step; Shift: ten steps; hold to go on"),
    ("PgUp PgDn", "a tenth of the episode"),
    ("Home End", "the beginning, the end"),
    (", .", "the mark before, the next mark"),
    ("+ −", "faster, slower: 0.25× to 16×"),
    ("F", "follow a seat; the next one; nobody"),
    ("L", "the log: who did what; click a line to go there"),
)
_CURVE_HELP = (("G", "work out the steps to go, as a curve; again: stop"),)
_EXPORT_HELP = (("I O V", "first and last step of a span; save it as a video"),)
_WINDOW_HELP = (
    ("P or F12", "save a picture"),
    ("Mouse", "click or drag: go there; wheel: zoom; buttons do what keys do"),
    ("F11", "fill the screen"),
    ("H", "this help"),
    ("Esc or Q", "close what is open; leave"),
)
_RIGHT, _LEFT = (pygame.K_RIGHT, pygame.K_LEFT)
_HELD = frozenset({
    _RIGHT, _LEFT, pygame.K_PAGEUP, pygame.K_PAGEDOWN, pygame.K_COMMA, pygame.K_PERIOD,
})  # fmt: skip
_SWALLOWED = frozenset({pygame.K_t, pygame.K_RETURN, pygame.K_KP_ENTER})
"""Keys that mean something to a player, and nothing here."""


class ViewerKeys:
    """Reads the keyboard of a viewer's owner.

    Args:
        histories: The one that is shown, or those side by side.
        curve: Begins to work out the steps to go, or stops; None where that cannot be done.
        export: Writes the marked span as a video, or stops; None where that cannot be done.
        picture: Saves a picture; None where the window does that.
        talks: Whoever watches an episode that is going on may talk: T and Enter are left alone.
    """

    def __init__(
        self,
        histories: Sequence[History],
        playhead: Playhead,
        state: ViewerState,
        now: Callable[[], float],
        *,
        curve: Callable[[], None] | None = None,
        export: Callable[[], None] | None = None,
        picture: Callable[[], None] | None = None,
        talks: bool = False,
    ) -> None:
        self._histories = histories
        self._playhead = playhead
        self._state = state
        self._now = now
        self._curve = curve
        self._export = export
        self._talks = talks
        self._held: tuple[int, bool, float] | None = None
        self._does: dict[int, Callable[[], None]] = {
            pygame.K_SPACE: playhead.toggle,
            pygame.K_HOME: lambda: playhead.seek(0, playing=False),
            pygame.K_END: lambda: playhead.seek(playhead.length, playing=False),
            pygame.K_f: self._follow,
            pygame.K_l: self._toggle_log,
            pygame.K_h: self._toggle_help,
            pygame.K_p: picture or (lambda: _press_again(pygame.K_F12)),
            pygame.K_q: self._leave,
            pygame.K_i: lambda: self._set_span(first=playhead.step),
            pygame.K_o: lambda: self._set_span(last=playhead.step),
            pygame.K_g: lambda: self._or_not(curve, "Steps to go are for recordings"),
            pygame.K_v: lambda: self._or_not(export, "Videos are of one recording"),
            **dict.fromkeys(
                (pygame.K_PLUS, pygame.K_EQUALS, pygame.K_KP_PLUS),
                lambda: playhead.change_speed(1),
            ),
            **dict.fromkeys((pygame.K_MINUS, pygame.K_KP_MINUS), lambda: playhead.change_speed(-1)),
        }
        if picture is not None:
            self._does[pygame.K_F12] = picture

    @property
    def help(self) -> tuple[tuple[str, str], ...]:
        """Rows of (key, what it does)."""
        curve = _CURVE_HELP if self._curve else ()
        export = _EXPORT_HELP if self._export else ()
        talk = (("T", "say something"),) if self._talks else ()
        return (*_HELP, *curve, *export, *talk, *_WINDOW_HELP)

    def has(self, key: int) -> bool:
        """Whether a key does something here."""
        if key == pygame.K_g:
            return self._curve is not None
        if key in (pygame.K_i, pygame.K_o, pygame.K_v):
            return self._export is not None
        return key in self._does or key in _HELD

    def handle(self, event: pygame.Event) -> bool:
        """Whether an event was a key of the viewer."""
        if event.type == pygame.KEYUP:
            if self._held is not None and self._held[0] == event.key:
                self._held = None
            return False
        if event.type == pygame.WINDOWFOCUSLOST:
            self._held = None
        if event.type != pygame.KEYDOWN:
            return False
        shift = bool(getattr(event, "mod", 0) & pygame.KMOD_SHIFT)
        return self.press(event.key, shift=shift)

    def tick(self) -> None:
        """Do again what a key that is held does."""
        if self._held is None:
            return
        key, shift, due = self._held
        now = self._now()
        if now >= due:
            self._held = (key, shift, max(due + REPEAT_EVERY, now))
            self._go(key, shift=shift)

    def release(self) -> None:
        """Nothing is held any more."""
        self._held = None

    def press(self, key: int, *, shift: bool = False) -> bool:
        """Whether a key that goes down, or a button that does the same, is one of the viewer."""
        if key == pygame.K_ESCAPE:
            open_page = self._state.help or self._state.log
            self._state.help = self._state.log = False
            return open_page
        if key in _SWALLOWED:
            return not self._talks
        if key in _HELD:
            self._held = (key, shift, self._now() + REPEAT_AFTER)
            self._go(key, shift=shift)
        elif key in self._does:
            self._does[key]()
        else:
            return False
        return True

    def _go(self, key: int, *, shift: bool) -> None:
        steps = _MANY if shift else 1
        page = max(1, round(self._playhead.length / _SHARE))
        match key:
            case pygame.K_RIGHT:
                self._playhead.move(steps)
            case pygame.K_LEFT:
                self._playhead.move(-steps)
            case pygame.K_PAGEDOWN:
                self._playhead.move(page)
            case pygame.K_PAGEUP:
                self._playhead.move(-page)
            case _:
                self._go_to_mark(forwards=key == pygame.K_PERIOD)

    def _go_to_mark(self, *, forwards: bool) -> None:
        step, followed = self._playhead.step, self._state.followed
        found: list[Mark] = []
        for history in self._histories:
            find = history.next_mark if forwards else history.previous_mark
            for player in (None,) if followed is None else (followed, ""):
                mark = find(step, player)
                found += [mark] if mark else []
        if not found:
            self._state.tell("No mark further on" if forwards else "No mark before")
            return
        nearest = (min if forwards else max)(found, key=lambda mark: mark.step)
        self._playhead.seek(nearest.step, playing=False)

    def _follow(self) -> None:
        players = (*self._histories[0].world.players, None)
        followed = self._state.followed
        self._state.followed = players[(players.index(followed) + 1) % len(players)]

    def _toggle_log(self) -> None:
        self._state.log = not self._state.log

    def _toggle_help(self) -> None:
        self._state.help = not self._state.help

    def _leave(self) -> None:
        """Close what is open, and let the window ask."""
        self._state.help = self._state.log = False
        _press_again(pygame.K_ESCAPE)

    def _set_span(self, first: int | None = None, last: int | None = None) -> None:
        state = self._state
        if first is not None:
            state.first = first
            state.last = None if state.last is not None and state.last <= first else state.last
        if last is not None:
            state.last = last
            state.first = None if state.first is not None and state.first >= last else state.first
        begin, end = state.span(self._playhead.length)
        state.tell(f"Marked: steps {begin} to {end}. V saves them as a video.")

    def _or_not(self, does: Callable[[], None] | None, why_not: str) -> None:
        if does is None:
            self._state.tell(why_not)
        else:
            does()


def _press_again(key: int) -> None:
    """What the window does by another key: there is one way to do it."""
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
