"""Keys of the replay viewer and the help that explains them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pygame

from robotouille_client.window.replay.histories.history import History, Mark
from robotouille_client.window.replay.viewer_state import Playhead, ViewerState

# Seconds before a held key repeats, and between its repetitions.
REPEAT_AFTER, REPEAT_EVERY = 0.35, 0.04
# Steps that Shift and an arrow key move.
_MANY = 10
# Number of presses of Page Down that go through the whole game.
_PAGES = 10

_HELP = (
    ("Space", "play or pause; at the end, start over"),
    ("Left Right", "one step; with Shift ten; hold to keep going"),
    ("PgUp PgDn", "jump a tenth of the game"),
    ("Home End", "the beginning, the end"),
    (", .", "the previous mark, the next mark"),
    ("+ −", "faster, slower: 0.25× to 16×"),
    ("F", "follow a player; again: the next, then nobody"),
    ("L", "the log of who did what; click a line to go there"),
)
_CURVE_HELP = (("G", "draw the steps to go; again: stop"),)
_EXPORT_HELP = (("I O V", "start and end of a clip; save it as a video"),)
_WINDOW_HELP = (
    ("P or F12", "save a picture"),
    ("Mouse", "click or drag to go there; the wheel zooms"),
    ("F11", "full screen"),
    ("H", "this help"),
    ("Esc or Q", "close what is open, or leave"),
)
_RIGHT, _LEFT = (pygame.K_RIGHT, pygame.K_LEFT)
_HELD = frozenset({
    _RIGHT, _LEFT, pygame.K_PAGEUP, pygame.K_PAGEDOWN, pygame.K_COMMA, pygame.K_PERIOD,
})  # fmt: skip
# Keys of a player that would open the chat, which a replay does not have.
_SWALLOWED = frozenset({pygame.K_t, pygame.K_RETURN, pygame.K_KP_ENTER})


@dataclass(frozen=True, slots=True)
class ViewerActions:
    """Actions of a viewer besides moving through a game; None if it lacks one.

    Attributes:
        curve: Starts or stops the search for the steps to go.
        export: Starts or stops writing the marked clip as a video.
        picture: Saves a picture. By default the window's own key does that.
        talks: True if the viewer may chat, as the spectator of a live game can.
    """

    curve: Callable[[], None] | None = None
    export: Callable[[], None] | None = None
    picture: Callable[[], None] | None = None
    talks: bool = False


class ViewerKeys:
    """Reads the keyboard of a viewer that shows one history, or two side by side."""

    def __init__(
        self,
        histories: Sequence[History],
        playhead: Playhead,
        state: ViewerState,
        now: Callable[[], float],
        actions: ViewerActions = ViewerActions(),
    ) -> None:
        self._histories = histories
        self._playhead = playhead
        self._state = state
        self._now = now
        self._actions = actions
        self._held: tuple[int, bool, float] | None = None
        curve, export = actions.curve, actions.export
        self._does: dict[int, Callable[[], None]] = {
            pygame.K_SPACE: playhead.toggle,
            pygame.K_HOME: lambda: playhead.seek(0, playing=False),
            pygame.K_END: lambda: playhead.seek(playhead.length, playing=False),
            pygame.K_f: self._follow,
            pygame.K_l: self._toggle_log,
            pygame.K_h: self._toggle_help,
            pygame.K_p: actions.picture or (lambda: _press_again(pygame.K_F12)),
            pygame.K_q: self._leave,
            pygame.K_i: lambda: self._set_span(first=playhead.step),
            pygame.K_o: lambda: self._set_span(last=playhead.step),
            pygame.K_g: lambda: self._run(curve, "Steps to go need a recording"),
            pygame.K_v: lambda: self._run(export, "Videos need a single recording"),
            **dict.fromkeys(
                (pygame.K_PLUS, pygame.K_EQUALS, pygame.K_KP_PLUS),
                lambda: playhead.change_speed(1),
            ),
            **dict.fromkeys((pygame.K_MINUS, pygame.K_KP_MINUS), lambda: playhead.change_speed(-1)),
        }
        if actions.picture is not None:
            self._does[pygame.K_F12] = actions.picture

    @property
    def help(self) -> tuple[tuple[str, str], ...]:
        """Rows of a key and its meaning."""
        curve = _CURVE_HELP if self._actions.curve else ()
        export = _EXPORT_HELP if self._actions.export else ()
        talk = (("T", "say something"),) if self._actions.talks else ()
        return (*_HELP, *curve, *export, *talk, *_WINDOW_HELP)

    def has(self, key: int) -> bool:
        """Return whether a key does something in this viewer."""
        if key == pygame.K_g:
            return self._actions.curve is not None
        if key in (pygame.K_i, pygame.K_o, pygame.K_v):
            return self._actions.export is not None
        return key in self._does or key in _HELD

    def handle(self, event: pygame.Event) -> bool:
        """Handle an event. Return whether it was a key of the viewer."""
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
        """Repeat a held key that is due."""
        if self._held is None:
            return
        key, shift, due = self._held
        now = self._now()
        if now >= due:
            # After a slow frame, missed repetitions of the key are skipped.
            self._held = (key, shift, max(due + REPEAT_EVERY, now))
            self._go(key, shift=shift)

    def release(self) -> None:
        """Forget the held key."""
        self._held = None

    def press(self, key: int, *, shift: bool = False) -> bool:
        """Do what a key, or its button, stands for. Return whether the viewer has the key."""
        if key == pygame.K_ESCAPE:
            open_page = self._state.help or self._state.log
            self._state.help = self._state.log = False
            return open_page
        if key in _SWALLOWED:
            return not self._actions.talks
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
        page = max(1, round(self._playhead.length / _PAGES))
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
            self._state.show_message("No more marks ahead" if forwards else "No earlier marks")
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
        """Close open pages, then let the window ask before it leaves."""
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
        state.show_message(f"Clip: steps {begin} to {end}. Press V to save it as a video.")

    def _run(self, action: Callable[[], None] | None, why_not: str) -> None:
        if action is None:
            self._state.show_message(why_not)
        else:
            action()


def _press_again(key: int) -> None:
    """Post a key event, so that the window does what it always does for that key."""
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
