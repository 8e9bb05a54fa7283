"""What the owner of a window does in a game, and what the window tells nobody else."""

from __future__ import annotations

from collections.abc import Callable

import pygame

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.world.scene import scene
from robotouille_client.window.drawing.ui_overlay import ActionMark, UiOverlay
from robotouille_client.window.hands.chat_line import ChatLine
from robotouille_client.window.hands.commands import DIRECTIONS, FIXED, Command, KeyMap
from robotouille_client.window.hands.controls import Button, Controls
from robotouille_client.window.hands.hands import MAX_CHOICES, Hands
from robotouille_client.window.hands.play_words import PlayWords
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.view import LobbySource, Source, View

__all__ = ["PlayInput"]

_NOTICE_SECONDS = 3.0
_BUTTONS: dict[int, Button] = {1: "left", 2: "middle", 3: "right"}


class PlayInput:
    """Keys, clicks and commands in a game, told in the words of its kitchen with `words` laid over
    them.

    `target` finds what is under a point of the window, and `key_at` the key that is drawn there.
    Where it is not `alone`, a strip tells spectators keys; where one `may_leave`, the key for it is
    told.
    """

    def __init__(
        self,
        *,
        keys: KeyMap,
        look: KitchenLook | None,
        words: Language = NO_WORDS,
        target: Callable[[tuple[int, int], View], str | None],
        key_at: Callable[[tuple[int, int]], str],
        alone: bool = True,
        may_leave: bool = False,
        clock: Callable[[], float],
    ) -> None:
        self.hands = Hands(keys, clock)
        self._told = PlayWords(self.hands, alone=alone, may_leave=may_leave)
        self._look = look
        self._words = words
        self._target = target
        self._key_at = key_at
        self._clock = clock
        self._chat = ChatLine()
        self._controls: Controls | None = None
        self._help = False
        self._pointer: tuple[int, int] | None = None
        self._notice = ""
        self._notice_until = 0.0

    @property
    def typing(self) -> bool:
        """Whether letters are those of a chat line."""
        return self._chat.typed is not None

    @property
    def helping(self) -> bool:
        """Whether the help is shown."""
        return self._help

    def tell(self, notice: str) -> None:
        """Show a line for a while; nothing where it is empty."""
        if notice:
            self._notice = notice
            self._notice_until = self._clock() + _NOTICE_SECONDS

    def hover(self, view: View) -> str | None:
        """What is under the mouse."""
        if view.frozen or self._pointer is None:
            return None
        return self._target(self._pointer, view)

    def tick(self, source: Source, view: View) -> None:
        """Do what waits."""
        self.tell(self.hands.tick(source, view))

    def close(self) -> None:
        """Close what is open, and do nothing more of what is held; a line of chat stays."""
        self._help, self.hands.choices = False, None
        self.hands.release()

    # Events

    def point(self, event: pygame.Event) -> None:
        """Follow where the mouse is, whoever an event is for."""
        if event.type in (pygame.MOUSEMOTION, pygame.MOUSEBUTTONDOWN):
            self._pointer = event.pos
        elif event.type == pygame.WINDOWLEAVE:
            self._pointer = None
        elif event.type == pygame.WINDOWFOCUSLOST:
            self.hands.release()

    def handle(self, event: pygame.Event, source: Source, view: View) -> Command | None:
        """What an event asks for that is not the game's: CANCEL where nothing was to cancel."""
        if event.type == pygame.MOUSEBUTTONDOWN:
            key = "" if self.typing else self._key_at(event.pos).casefold()
            if key and event.button == 1:
                return self._key(key, source, view)
            self._click(_BUTTONS.get(event.button), source, view)
        elif event.type == pygame.TEXTINPUT:
            self._chat.text(event.text)
        elif event.type == pygame.KEYUP:
            self.hands.release(self.hands.keys.command(_name(event)))
        elif event.type == pygame.KEYDOWN:
            return self._key(_name(event), source, view)
        return None

    def command(
        self, command: Command, source: Source, view: View, key: str = ""
    ) -> Command | None:
        """Do what a key of the window or a button of a gamepad asks for; it comes back where it is
        not for the game."""
        if command is Command.CANCEL:
            return None if self._cancel() else command
        if command is Command.MENU:
            self.close()
            return command
        if command in (Command.USE, Command.ENTER) and self._be_ready(source, view):
            return None
        if self.hands.choices is not None and self._in_list(command, source, view):
            return None
        if command is Command.HELP:
            self._help = not self._help
        elif command is Command.CHAT or (command is Command.ENTER and key):
            self._chat.open(key)
        elif view.me is None or command is Command.SOUND:
            return command
        elif command in DIRECTIONS:
            self.tell(self.hands.walk(self.controls(view), command, source, view))
        elif command in (Command.USE, Command.ENTER):
            self.tell(self.hands.use(self.controls(view), key, source, view))
        elif command is Command.LIST:
            self.hands.open_list(view)
        else:
            return command
        return None

    def _be_ready(self, source: Source, view: View) -> bool:
        """Say that one is ready, or not any more; whether that is asked."""
        if view.lobby is None or not view.asks_if_ready:
            return False
        if isinstance(source, LobbySource):
            source.be_ready(not view.lobby.ready)
        return True

    def _cancel(self) -> bool:
        """Close what is open, or forget what waits; whether there was anything."""
        if self._chat.typed is not None:
            self._chat.typed = None
            return True
        if self._help or self.hands.choices is not None:
            self._help, self.hands.choices = False, None
            return True
        return self.hands.queue.clear()

    def _in_list(self, command: Command, source: Source, view: View) -> bool:
        if command in (Command.UP, Command.DOWN):
            self.hands.choose(1 if command is Command.DOWN else -1)
        elif command in (Command.LEFT, Command.RIGHT):
            self.hands.choose(MAX_CHOICES if command is Command.RIGHT else -MAX_CHOICES)
        elif command in (Command.USE, Command.ENTER):
            self.tell(self.hands.pick(self.controls(view), None, source, view))
        else:
            return False
        return True

    def _click(self, button: Button | None, source: Source, view: View) -> None:
        target = self.hover(view)
        if self._help:
            self._help = False
        elif button == "left" and view.lobby is not None and view.lobby.ready is False:
            self._be_ready(source, view)
        elif target is None or view.me is None or button is None:
            return
        elif button == "right" and self._uses(target, view):
            self.tell(self.hands.use(self.controls(view), "", source, view))
        else:
            self.tell(self.hands.click(self.controls(view), target, button, source, view))

    def _uses(self, target: str, view: View) -> bool:
        """Whether a right click, which no input file gives a meaning, is on the station in use."""
        clicks = self.controls(view).bindings.mouse_click_actions
        bound = any(click.input_instructions.button == "right" for click in clicks)
        return not bound and view.me is not None and scene(view.state)[view.me].at == target

    def _key(self, name: str, source: Source, view: View) -> Command | None:
        if self._chat.typed is not None:
            said = self._chat.key(name)
            if said and (view.outcome or view.farewell):
                self.tell(f"The game is over, nobody hears: {said}")
            elif said:
                source.say(said)
            return None
        command = self.hands.keys.command(name)
        if self.hands.choices is not None:
            if name in tuple("123456789"):
                self.tell(self.hands.pick(self.controls(view), int(name), source, view))
                return None
        elif self._is_bound(name, command, view):
            self.tell(self.hands.key(self.controls(view), name, source, view))
            return None
        return self.command(command, source, view, name) if command else None

    def _is_bound(self, name: str, command: Command | None, view: View) -> bool:
        """Whether a key is the domain's: what its input file binds comes first, but for the key
        that means more than that where the file's meaning comes to nothing."""
        if view.me is None or name in FIXED or name not in self.controls(view).keys:
            return False
        return command is not Command.USE

    def controls(self, view: View) -> Controls:
        """What clicks and keys mean in a view's world."""
        if self._controls is None or self._controls.world is not view.world:
            look = self._look
            language = look.rendering.language if look else language_of(view.world.task)
            bindings = look.bindings if look else None
            self._controls = Controls(view.world, bindings, language.with_words(self._words))
        self._controls.names = {seat.player: seat.name for seat in view.seats}
        return self._controls

    # What is shown

    def overlay(self, view: View, hover: str | None) -> UiOverlay:
        """What the owner sees over the view."""
        told, controls = self._told, self.controls(view)
        tips, hints = told.advice(controls, view, hover)
        choices, more = told.choices(controls, view)
        return UiOverlay(
            pointer=self._pointer,
            tips=tips,
            prompt=self._notice if self._clock() < self._notice_until else "",
            typing=self._chat.typed,
            help=told.help(controls, view) if self._help else (),
            hints=hints,
            keys=told.permanent_keys(controls, view),
            queued=self.hands.queue.labels,
            mark=self._mark(view),
            choices=choices,
            chosen=self.hands.chosen % MAX_CHOICES,
            more=more,
        )

    def _mark(self, view: View) -> ActionMark | None:
        if self.hands.choices:
            there = self.hands.choices[self.hands.chosen].destination
            return ActionMark(there, "asked") if there else None
        sent = self.hands.queue.sent  # Once: it is over when its time is.
        if view.me is None or sent is None:
            return None
        station = self.hands.target(view.state, view.me)
        return ActionMark(station, sent.fate) if station else None


def _name(event: pygame.Event) -> str:
    return pygame.key.name(event.key).casefold()
