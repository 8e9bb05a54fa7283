"""Inputs of a window's owner become actions, one after the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.hands.commands import DIRECTIONS, Command, KeyMap, key_words
from robotouille_client.window.hands.controls import Button, Controls, Meaning
from robotouille_client.window.hands.possible import EARLY, WAIT, ends_work, possible, use, walk
from robotouille_client.window.hands.queue import ActionQueue, Intent
from robotouille_client.window.view import Source, View

__all__ = ["Hands", "hint_words"]

REPEAT_SECONDS = 0.35
"""For how long a direction is held until it means another walk."""
MAX_CHOICES = 9


class Hands:
    """Reads commands, clicks and a domain's keys for the player of one window.

    `choices` are the actions of the list while it is open, else None.
    """

    def __init__(self, keys: KeyMap, clock: Callable[[], float]) -> None:
        self.keys = keys
        self.queue = ActionQueue(clock)
        self.choices: tuple[GroundAction, ...] | None = None
        self.chosen = 0
        self._clock = clock
        self._held: Command | None = None
        self._held_since = 0.0
        self._walker: Controls | None = None

    # What comes in; a notice comes back, or nothing

    def click(
        self, controls: Controls, target: str, button: Button, source: Source, view: View
    ) -> str:
        """A click on an object."""
        self.choices = None
        read = partial(_clicked, controls, target, button)
        label = controls.wording(view.me).place(target, view.state)
        return self.queue.ask(Intent(label, read), source, view)

    def key(self, controls: Controls, key: str, source: Source, view: View) -> str:
        """A key of the domain's input file."""
        read, there = partial(_pressed, controls, key), controls.is_for_places(key)
        return self.queue.ask(Intent(key_words(key), read, follows=there), source, view)

    def use(self, controls: Controls, key: str, source: Source, view: View) -> str:
        """The one key that does what is the most useful here."""
        label = key_words(key) if key else "use"
        there = key not in controls.keys or controls.is_for_places(key)
        intent = Intent(label, partial(_used, controls, key), follows=there)
        return self.queue.ask(intent, source, view)

    def walk(self, controls: Controls, command: Command, source: Source, view: View) -> str:
        """A direction was pressed, and is held until `release`."""
        self._held, self._held_since = command, self._clock()
        self._walker = controls
        return self._walk(controls, command, source, view)

    def release(self, command: Command | None = None) -> None:
        """A direction is no longer held; without one, none is."""
        if command is None or command == self._held:
            self._held = None

    def tick(self, source: Source, view: View) -> str:
        """What waits, and what is held."""
        if self.choices is not None:
            self.refresh(view)
        notice = self.queue.tick(source, view)
        if self._held is not None and self._walker and self._may_repeat(view):
            self._walk(self._walker, self._held, source, view)
        return notice

    def _may_repeat(self, view: View) -> bool:
        """Whether what is held means another walk, and that can be sent now."""
        long = self._clock() - self._held_since >= REPEAT_SECONDS
        free = view.me is not None and not view.state.busy_steps(view.me)
        return long and free and self.queue.idle and not view.frozen

    def _walk(self, controls: Controls, command: Command, source: Source, view: View) -> str:
        intent = Intent(key_words(command.value), partial(_walked, controls, DIRECTIONS[command]))
        return self.queue.ask(intent, source, view)

    # The list of what is possible

    def open_list(self, view: View) -> None:
        """Show what is possible, or hide it again."""
        self.chosen = 0
        self.choices = () if self.choices is None else None
        if self.choices is not None:
            self.refresh(view)

    def refresh(self, view: View) -> None:
        """Keep the list as the state has it."""
        if view.me is None or view.over:
            self.choices = None
            return
        self.choices = possible(view.state, view.me)
        self.chosen = min(self.chosen, max(0, len(self.choices) - 1))

    def choose(self, steps: int) -> None:
        """Move the mark in the list up or down."""
        if self.choices:
            self.chosen = (self.chosen + steps) % len(self.choices)

    def pick(self, controls: Controls, number: int | None, source: Source, view: View) -> str:
        """Do the marked action of the list, or the one with a number on the page shown."""
        choices = self.choices or ()
        index = self.chosen if number is None else self.page * MAX_CHOICES + number - 1
        if not 0 <= index < len(choices):
            return ""
        self.choices = None
        action = choices[index]
        label = controls.wording(view.me).action(action, view.state)
        return self.queue.ask(Intent(label, partial(_again, label, action)), source, view)

    @property
    def page(self) -> int:
        """Which nine of the list are shown."""
        return self.chosen // MAX_CHOICES

    # What is seen

    def target(self, state: State, me: str) -> str | None:
        """The station that the newest action is about, while that is shown."""
        sent = self.queue.sent
        if sent is None:
            return None
        return sent.action.destination or scene(state)[me].at

    def hints(self, controls: Controls, state: State, me: str) -> tuple[tuple[str, str], ...]:
        """Rows of (key, what it does now), the most useful first; where nothing can be done here
        with what is at hand, what would have to be done for it: without a key, where no key
        would even try."""
        if state.busy_steps(me):
            return ()
        rows = {option.action: option.key for option in controls.options(state, me)}
        found = [(key_words(key), controls.key(state, me, key).hint) for key in rows.values()]
        meaning = use(controls, state, me)
        if meaning.valid and meaning.action not in rows:
            found.append((self.keys.words(Command.USE), meaning.hint))
        if not found and meaning.hint == WAIT:
            found.append((self.keys.words(Command.USE), "Wait until it is done"))
        here = scene(state)[me].at
        clicked = controls.click(state, me, here) if here else meaning
        if clicked.valid and clicked.action != meaning.action:
            found.append(("Click", hint_words(clicked, state)))
        if not found and (meaning.action is not None or meaning.advice):
            key = self.keys.words(Command.USE) if meaning.action is not None else ""
            found.append((key, meaning.hint))
        return tuple(found)


def hint_words(meaning: Meaning, state: State) -> str:
    """What an input means, and whether that comes too early."""
    early = meaning.valid and meaning.action is not None and ends_work(state, meaning.action)
    return f"{meaning.hint} {EARLY}" if early else meaning.hint


def _clicked(controls: Controls, target: str, button: Button, view: View) -> Meaning:
    return controls.click(view.state, view.me or "", target, button)


def _pressed(controls: Controls, key: str, view: View) -> Meaning:
    return controls.key(view.state, view.me or "", key)


def _used(controls: Controls, key: str, view: View) -> Meaning:
    """What the one key means; where a step waits for decisions, to wait is one."""
    state, me = view.state, view.me or ""
    meaning = use(controls, state, me, key)
    if meaning.hint != WAIT or view.step_seconds is not None:
        return meaning
    idle = (action for action in possible(state, me) if not (action.touched or action.effects))
    waits = next(idle, None)
    return Meaning(waits, WAIT, waits is not None)


def _walked(controls: Controls, direction: tuple[int, int], view: View) -> Meaning:
    return walk(controls, view.state, view.me or "", direction)


def _again(words: str, action: GroundAction, view: View) -> Meaning:
    return Meaning(action, words, action in view.state.actions(view.me or ""))
