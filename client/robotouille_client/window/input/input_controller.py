"""Turns input into a queue of actions for the local player."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.input.action_queue import ActionQueue, Intent
from robotouille_client.window.input.commands import DIRECTIONS, Command, KeyMap, key_words
from robotouille_client.window.input.controls import (
    EARLY,
    WAIT,
    Button,
    Controls,
    ResolvedInput,
    ends_work,
    possible,
    use,
    walk,
)
from robotouille_client.window.view import GameSource, View

REPEAT_SECONDS = 0.35
"""Time for which a direction must be held to walk again."""
MAX_CHOICES = 9


class InputController:
    """Commands, clicks and domain keys of the local player.

    `choices` are the actions in the open list; None while the list is closed.
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

    # Input. Each method returns a notice for the player, or "".

    def click(
        self, controls: Controls, target: str, button: Button, source: GameSource, view: View
    ) -> str:
        """Handle a click on an object."""
        self.choices = None
        resolve = partial(_resolve_click, controls, target, button)
        label = controls.wording(view.me).place(target, view.state)
        return self.queue.ask(Intent(label, resolve), source, view)

    def key(self, controls: Controls, key: str, source: GameSource, view: View) -> str:
        """Handle a key of the domain's input file."""
        resolve, there = partial(_resolve_key, controls, key), controls.is_for_places(key)
        return self.queue.ask(Intent(key_words(key), resolve, follows=there), source, view)

    def use(self, controls: Controls, key: str, source: GameSource, view: View) -> str:
        """Handle the use key, which does the most useful action here."""
        label = key_words(key) if key else "use"
        there = key not in controls.keys or controls.is_for_places(key)
        # The action is chosen when its turn comes, because the state may change until then.
        intent = Intent(label, partial(_resolve_use, controls, key), follows=there)
        return self.queue.ask(intent, source, view)

    def walk(self, controls: Controls, command: Command, source: GameSource, view: View) -> str:
        """Handle a direction key, which counts as held until `release`."""
        self._held, self._held_since = command, self._clock()
        self._walker = controls
        return self._walk(controls, command, source, view)

    def release(self, command: Command | None = None) -> None:
        """Release the direction of a command, or any direction."""
        if command is None or command == self._held:
            self._held = None

    def tick(self, source: GameSource, view: View) -> str:
        """Send what is due: the next queued action, or another walk in the held direction."""
        if self.choices is not None:
            self.refresh(view)
        notice = self.queue.tick(source, view)
        if self._held is not None and self._walker and self._may_repeat(view):
            self._walk(self._walker, self._held, source, view)
        return notice

    def _may_repeat(self, view: View) -> bool:
        """Return whether the held direction means another walk that can be sent now."""
        long = self._clock() - self._held_since >= REPEAT_SECONDS
        # A held key never fills the queue, so the player stops where they let go.
        free = view.me is not None and not view.state.busy_steps(view.me)
        return long and free and self.queue.idle and not view.frozen

    def _walk(self, controls: Controls, command: Command, source: GameSource, view: View) -> str:
        intent = Intent(
            key_words(command.value), partial(_resolve_walk, controls, DIRECTIONS[command])
        )
        return self.queue.ask(intent, source, view)

    # List of possible actions

    def open_list(self, view: View) -> None:
        """Open the list of possible actions, or close it."""
        self.chosen = 0
        self.choices = () if self.choices is None else None
        if self.choices is not None:
            self.refresh(view)

    def refresh(self, view: View) -> None:
        """Update the list to the current state."""
        if view.me is None or view.over:
            self.choices = None
            return
        self.choices = possible(view.state, view.me)
        self.chosen = min(self.chosen, max(0, len(self.choices) - 1))

    def choose(self, steps: int) -> None:
        """Move the mark in the list."""
        if self.choices:
            self.chosen = (self.chosen + steps) % len(self.choices)

    def pick(self, controls: Controls, number: int | None, source: GameSource, view: View) -> str:
        """Do the marked action of the list, or the one with a number on the page."""
        choices = self.choices or ()
        index = self.chosen if number is None else self.page * MAX_CHOICES + number - 1
        if not 0 <= index < len(choices):
            return ""
        self.choices = None
        action = choices[index]
        label = controls.wording(view.me).action(action, view.state)
        return self.queue.ask(Intent(label, partial(_repeat, label, action)), source, view)

    @property
    def page(self) -> int:
        """Index of the page shown; a page has nine actions."""
        return self.chosen // MAX_CHOICES

    # Hints

    def target(self, state: State, me: str) -> str | None:
        """Return the station of the last action, while its result is marked."""
        sent = self.queue.sent
        if sent is None:
            return None
        return sent.action.destination or scene(state)[me].at

    def hints(self, controls: Controls, state: State, me: str) -> tuple[tuple[str, str], ...]:
        """Return rows of (key, what it does now), the most useful first.

        If nothing can be done here, the row says what must happen first. Its key is empty if no key
        would submit an action.
        """
        if state.busy_steps(me):
            return ()
        rows = {option.action: option.key for option in controls.options(state, me)}
        found = [(key_words(key), controls.key(state, me, key).hint) for key in rows.values()]
        resolved = use(controls, state, me)
        if resolved.valid and resolved.action not in rows:
            found.append((self.keys.words(Command.USE), resolved.hint))
        if not found and resolved.hint == WAIT:
            found.append((self.keys.words(Command.USE), "Wait until it is done"))
        here = scene(state)[me].at
        clicked = controls.click(state, me, here) if here else resolved
        if clicked.valid and clicked.action != resolved.action:
            found.append(("Click", hint_words(clicked, state)))
        if not found and (resolved.action is not None or resolved.advice):
            key = self.keys.words(Command.USE) if resolved.action is not None else ""
            found.append((key, resolved.hint))
        return tuple(found)


def hint_words(resolved: ResolvedInput, state: State) -> str:
    """Return an input's hint, with a warning if the action would interrupt work."""
    early = resolved.valid and resolved.action is not None and ends_work(state, resolved.action)
    return f"{resolved.hint} {EARLY}" if early else resolved.hint


def _resolve_click(controls: Controls, target: str, button: Button, view: View) -> ResolvedInput:
    return controls.click(view.state, view.me or "", target, button)


def _resolve_key(controls: Controls, key: str, view: View) -> ResolvedInput:
    return controls.key(view.state, view.me or "", key)


def _resolve_use(controls: Controls, key: str, view: View) -> ResolvedInput:
    """Resolve the use key. In games that wait for decisions, waiting is one of them."""
    state, me = view.state, view.me or ""
    resolved = use(controls, state, me, key)
    if resolved.hint != WAIT or view.step_seconds is not None:
        return resolved
    idle = (action for action in possible(state, me) if not (action.touched or action.effects))
    waits = next(idle, None)
    return ResolvedInput(waits, WAIT, waits is not None)


def _resolve_walk(controls: Controls, direction: tuple[int, int], view: View) -> ResolvedInput:
    return walk(controls, view.state, view.me or "", direction)


def _repeat(words: str, action: GroundAction, view: View) -> ResolvedInput:
    return ResolvedInput(action, words, action in view.state.actions(view.me or ""))
