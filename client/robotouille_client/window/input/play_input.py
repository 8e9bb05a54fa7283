"""Keyboard and mouse input during a game, and the texts that only the local player sees."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import pygame

from robotouille.domain.rendering import language_of
from robotouille.world.presentation.signals import POINTING, Intent, Signal
from robotouille.world.scene import scene
from robotouille_client.window.drawing.window_layout import ActionMark, UiOverlay
from robotouille_client.window.input.commands import DIRECTIONS, FIXED, SIGNALS, Command, KeyMap
from robotouille_client.window.input.companion_input import CompanionInput
from robotouille_client.window.input.controls import Button, Controls
from robotouille_client.window.input.hints import PlayHints
from robotouille_client.window.input.input_controller import MAX_CHOICES, InputController
from robotouille_client.window.options import WindowStyle
from robotouille_client.window.view import GameSource, View

MAX_LENGTH = 200


class ChatLine:
    """Line of chat being typed. `typed` is None while nobody types."""

    def __init__(self) -> None:
        self.typed: str | None = None
        self._swallow = ""

    def open(self, key: str) -> None:
        """Start a line.

        The letter of the key that opened it arrives later as text, and is ignored then.
        """
        self.typed = ""
        self._swallow = key if len(key) == 1 else ""

    def text(self, text: str) -> None:
        """Add letters."""
        if self.typed is None:
            return
        swallow, self._swallow = self._swallow, ""
        if swallow and text.casefold() == swallow:
            return
        letters = "".join(letter for letter in text if letter.isprintable())
        self.typed = (self.typed + letters)[:MAX_LENGTH]

    def key(self, name: str) -> str:
        """Handle a key; return the line if the key sent it."""
        self._swallow = ""
        said = ""
        if name == "backspace":
            self.typed = (self.typed or "")[:-1]
        elif name == "escape":
            self.typed = None
        elif name in ("return", "enter"):
            said, self.typed = (self.typed or "").strip(), None
        return said


_NOTICE_SECONDS = 3.0
READ_SECONDS = 1.5
"""Time for which a notice is shown before another one replaces it that answers no key."""
_BUTTONS: dict[int, Button] = {1: "left", 2: "middle", 3: "right"}


class PlayInput:
    """Keys, clicks and commands during a game.

    Args:
        target: Function that finds the object at a point of the window.
        key_at: Function that finds the key drawn at a point of the window.
        may_leave: True to show the key for leaving.
    """

    def __init__(
        self,
        keys: KeyMap,
        style: WindowStyle,
        *,
        target: Callable[[tuple[int, int], View], str | None],
        key_at: Callable[[tuple[int, int]], str],
        may_leave: bool,
        clock: Callable[[], float],
    ) -> None:
        self.controller = InputController(keys, clock)
        self.companion = CompanionInput(clock)
        self._hints = PlayHints(self.controller, alone=style.strip is None, may_leave=may_leave)
        self._style = style
        self._target = target
        self._key_at = key_at
        self._clock = clock
        self._chat = ChatLine()
        self._controls: Controls | None = None
        self._help = False
        self._pointer: tuple[int, int] | None = None
        self._notice = ""
        self._notice_until = 0.0
        self._news: deque[str] = deque(maxlen=2)
        self._tells_news = False

    @property
    def typing(self) -> bool:
        """True if a line of chat is open."""
        return self._chat.typed is not None

    @property
    def helping(self) -> bool:
        return self._help

    def show_notice(self, notice: str) -> None:
        """Show a notice for a few seconds, if it is not empty."""
        if notice:
            self._notice = notice
            self._notice_until = self._clock() + _NOTICE_SECONDS
            self._tells_news = False

    def _answer(self, notice: str) -> None:
        """Show the answer to an input. An input without one outdates what is about earlier ones."""
        if not notice:
            # The player may have pressed the next key before reading why the last one did nothing.
            seconds = 0.0 if self._tells_news else READ_SECONDS
            read = self._notice_until - _NOTICE_SECONDS + seconds
            self._notice_until = min(self._notice_until, read)
        self.show_notice(notice)

    def _show_news(self, notice: str) -> None:
        """Show a notice that answers no key, once the player has had time to read the last one."""
        if notice:
            self._news.append(notice)
        if self._news and self._clock() >= self._notice_until - _NOTICE_SECONDS + READ_SECONDS:
            self.show_notice(self._news.popleft())
            self._tells_news = True

    def hover(self, view: View) -> str | None:
        """Return the object under the mouse."""
        if view.frozen or self._pointer is None:
            return None
        return self._target(self._pointer, view)

    def tick(self, source: GameSource, view: View) -> None:
        """Send the actions that are due."""
        self._show_news(self.controller.tick(source, view))
        self._show_news(self.companion.tick(source, view))

    def close(self) -> None:
        """Close the help and the list, and release held keys. A line of chat stays open."""
        self._help, self.controller.choices = False, None
        self.release()

    def release(self) -> None:
        """Let go of the directions that are held."""
        self.controller.release()
        self.companion.release()

    # Events

    def point(self, event: pygame.Event) -> None:
        """Follow the mouse, including events that are not for the game."""
        if event.type in (pygame.MOUSEMOTION, pygame.MOUSEBUTTONDOWN):
            self._pointer = event.pos
        elif event.type == pygame.WINDOWLEAVE:
            self._pointer = None
        elif event.type == pygame.WINDOWFOCUSLOST:
            self.release()

    def handle(self, event: pygame.Event, source: GameSource, view: View) -> Command | None:
        """Handle an event; return a command that is not for the game."""
        # Arrow keys and Shift do not edit a line of chat.
        if self.companion.takes(event, view):
            self.show_notice(self.companion.handle(event, self.controls(view), source, view))
            return None
        if event.type == pygame.MOUSEBUTTONDOWN:
            # While a line of chat is open, keys edit the line, so the drawn keys do nothing.
            key = "" if self.typing else self._key_at(event.pos).casefold()
            if key and event.button == 1:
                return self._key(key, source, view)
            self._click(_BUTTONS.get(event.button), source, view)
        elif event.type == pygame.TEXTINPUT:
            self._chat.text(event.text)
        elif event.type == pygame.KEYUP:
            self.controller.release(self.controller.keys.command(_name(event)))
        elif event.type == pygame.KEYDOWN:
            return self._key(_name(event), source, view)
        return None

    def companion_command(self, command: Command | None, source: GameSource, view: View) -> None:
        """Run a command of the companion's gamepad."""
        if command is not None:
            self.show_notice(self.companion.command(command, self.controls(view), source, view))

    def command(
        self, command: Command, source: GameSource, view: View, key: str = ""
    ) -> Command | None:
        """Run a command; return it if it is not for the game."""
        if command is Command.CANCEL:
            return None if self._cancel() else command
        if command is Command.MENU:
            self.close()
            return command
        # E at the countdown is meant for the game, and waits for it. Only Enter takes back.
        waits = command is Command.USE and view.starts_in is not None
        if command in (Command.USE, Command.ENTER) and not waits and self._be_ready(source, view):
            return None
        if self.controller.choices is not None and self._in_list(command, source, view):
            return None
        if command is Command.HELP:
            self._help = not self._help
        # Commands of gamepads have no key. They cannot type, so they do not open the chat.
        elif command is Command.CHAT or (command is Command.ENTER and key):
            self._chat.open(key)
        elif view.me is None or command is Command.SOUND:
            return command
        elif command in DIRECTIONS:
            self._answer(self.controller.walk(self.controls(view), command, source, view))
        elif command in (Command.USE, Command.ENTER):
            self._answer(self.controller.use(self.controls(view), key, source, view))
        elif command is Command.LIST:
            self.controller.open_list(view)
        elif command in SIGNALS:
            self._signal(SIGNALS[command], source, view)
        else:
            return command
        return None

    def _be_ready(self, source: GameSource, view: View) -> bool:
        """Switch between ready and not ready; return False if the game does not ask for it."""
        if view.lobby is None or not view.asks_if_ready:
            return False
        source.be_ready(not view.lobby.ready)
        return True

    def _cancel(self) -> bool:
        """Close what is open or drop queued actions; return whether there was anything."""
        if self._chat.typed is not None:
            self._chat.typed = None
            return True
        if self._help or self.controller.choices is not None:
            self._help, self.controller.choices = False, None
            return True
        return self.controller.queue.clear()

    def _in_list(self, command: Command, source: GameSource, view: View) -> bool:
        if command in (Command.UP, Command.DOWN):
            self.controller.choose(1 if command is Command.DOWN else -1)
        elif command in (Command.LEFT, Command.RIGHT):
            self.controller.choose(MAX_CHOICES if command is Command.RIGHT else -MAX_CHOICES)
        elif command in (Command.USE, Command.ENTER):
            self._answer(self.controller.pick(self.controls(view), None, source, view))
        else:
            return False
        return True

    def _click(self, button: Button | None, source: GameSource, view: View) -> None:
        target = self.hover(view)
        if self._help:
            self._help = False
        elif button == "left" and view.lobby is not None and view.lobby.ready is False:
            self._be_ready(source, view)
        elif target is None or view.me is None or button is None:
            return
        elif button == "middle" and not self._binds("middle", view):
            self._signal(Intent.LOOK, source, view)
        elif button == "right" and self._uses(target, view):
            self._answer(self.controller.use(self.controls(view), "", source, view))
        else:
            self._answer(self.controller.click(self.controls(view), target, button, source, view))

    def _signal(self, intent: Intent, source: GameSource, view: View) -> None:
        """Send a signal about what is under the mouse, or else about the player's own place."""
        if len(view.world.players) < 2 or view.over:
            return
        target = self._pointed_at(intent, view)
        if target is None:
            self.show_notice("Point at what you need, then press the key again")
        else:
            source.signal(Signal(intent, target))

    def _pointed_at(self, intent: Intent, view: View) -> str | None:
        """Return the target of a signal; empty if it needs none, None if nothing can be meant."""
        placed, hover = scene(view.state), self.hover(view)
        if intent is Intent.NEED and hover in view.world.players:
            # A player is not needed, but what the player holds.
            return next((name for name, each in placed.items() if each.host == hover), None)
        if hover == view.me:
            hover = None
        if intent not in POINTING:
            return hover if hover in view.world.players else ""
        if hover in view.world.floor.plain:
            # A table alone is seldom meant if something lies on it.
            on_it = [(each.level, name) for name, each in placed.items() if each.host == hover]
            return max(on_it)[1] if on_it else hover
        if hover is not None:
            return hover
        blocked = (station for player, station, _ in view.blocked if player == view.me and station)
        here = placed[view.me].at if view.me is not None else None
        return next(blocked, None if intent is Intent.NEED else here)

    def _uses(self, target: str, view: View) -> bool:
        """Return whether a right click is on the player's own station and has no binding."""
        return (
            not self._binds("right", view)
            and view.me is not None
            and scene(view.state)[view.me].at == target
        )

    def _binds(self, button: Button, view: View) -> bool:
        """Return whether the domain has actions for a mouse button."""
        clicks = self.controls(view).bindings.mouse_click_actions
        return any(click.input_instructions.button == button for click in clicks)

    def _key(self, name: str, source: GameSource, view: View) -> Command | None:
        if self._chat.typed is not None:
            said = self._chat.key(name)
            if said and (view.outcome or view.farewell):
                self.show_notice(f"Not sent, the game is over: {said}")
            elif said:
                source.say(said)
            return None
        command = self.controller.keys.command(name)
        if self.controller.choices is not None:
            if name in tuple("123456789"):
                self._answer(self.controller.pick(self.controls(view), int(name), source, view))
                return None
        elif self._is_bound(name, command, view):
            self._answer(self.controller.key(self.controls(view), name, source, view))
            return None
        return self.command(command, source, view, name) if command else None

    def _is_bound(self, name: str, command: Command | None, view: View) -> bool:
        """Return whether a key belongs to the domain.

        The input file's bindings come first, except for the use key. The use key also tries the
        file's binding first, but has more to offer if that action is not possible.
        """
        if view.me is None or name in FIXED or name not in self.controls(view).keys:
            return False
        return command is not Command.USE

    def controls(self, view: View) -> Controls:
        """Return the controls for a view's world."""
        # The next game may show another world in the same window.
        if self._controls is None or self._controls.world is not view.world:
            look = self._style.look
            language = look.rendering.language if look else language_of(view.world.task)
            bindings = look.bindings if look else None
            language = language.with_words(self._style.words)
            self._controls = Controls(view.world, bindings, language)
        self._controls.names = {seat.player: seat.name for seat in view.seats}
        return self._controls

    # Drawing

    def overlay(self, view: View, hover: str | None) -> UiOverlay:
        """Return what the player sees over the view."""
        told, controls = self._hints, self.controls(view)
        tips, hints = told.advice(controls, view, hover)
        choices, more = told.choices(controls, view)
        return UiOverlay(
            pointer=self._pointer,
            tips=tips,
            prompt=self._notice if self._clock() < self._notice_until else "",
            typing=self._chat.typed,
            help=told.help(controls, view) if self._help else (),
            hints=(*hints, *self.companion.hints(controls, view)),
            keys=told.permanent_keys(controls, view),
            queued=self.controller.queue.labels,
            marks=tuple(m for m in (self._mark(view), self.companion.mark(view)) if m is not None),
            choices=choices,
            chosen=self.controller.chosen % MAX_CHOICES,
            more=more,
        )

    def _mark(self, view: View) -> ActionMark | None:
        if self.controller.choices:
            there = self.controller.choices[self.controller.chosen].destination
            return ActionMark(there, "asked") if there else None
        return None if view.me is None else self.controller.mark(view.state, view.me)


def _name(event: pygame.Event) -> str:
    return pygame.key.name(event.key).casefold()
