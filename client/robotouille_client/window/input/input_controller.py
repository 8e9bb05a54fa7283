"""Commands, clicks and keys of the local player, which become a queue of actions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.drawing.window_layout import ActionMark
from robotouille_client.window.input.action_queue import QUICK_SECONDS, ActionQueue, Intent
from robotouille_client.window.input.commands import DIRECTIONS, Command, KeyMap, key_words
from robotouille_client.window.input.controls import (
    EARLY,
    WAIT,
    Button,
    Controls,
    ResolvedInput,
    ends_work,
    handled,
    possible,
    takes_apart,
    use,
    walk,
)
from robotouille_client.window.view import GameSource, View

REPEAT_SECONDS = 0.35
"""Time for which a direction must be held to walk again."""
MAX_CHOICES = 9
MAX_DIRECTIONS = 6
"""Largest number of directions that become one walk."""
GUARDED = "done; to move it again, wait a second or click"
CONFIRM_SECONDS = 3.0
"""Time between two presses of the use key that take a dish apart together."""
PART_OF_DISH = "this is part of a dish; press again to take it off"


class _Presses(NamedTuple):
    """Events before a press of the use key.

    Attributes:
        repeats: True if another press came a moment before.
        confirmed: Action that was declined for the last press and awaits this one.
    """

    repeats: bool
    confirmed: GroundAction | None


class InputController:
    """Commands, clicks and domain keys of the local player.

    `choices` are the actions in the open list; None while the list is closed.

    Args:
        foresees: Drop keys that mean something else when their turn comes. The browser client
            does not, because it cannot simulate steps.
    """

    def __init__(self, keys: KeyMap, clock: Callable[[], float], *, foresees: bool = True) -> None:
        self.keys = keys
        self.queue = ActionQueue(clock, foresees=foresees)
        self.choices: tuple[GroundAction, ...] | None = None
        self.chosen = 0
        self._clock = clock
        self._held: Command | None = None
        self._held_since = 0.0
        self._walker: Controls | None = None
        self._used_at: float | None = None
        self._apart: tuple[GroundAction, float] | None = None
        """Action that takes a dish apart and awaits a second press, and when it was declined."""

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
        """Handle the use key, which does the most useful action here.

        One press too many undoes no work: an action that takes a dish apart needs two presses.
        """
        label = key_words(key) if key else "use"
        there = key not in controls.keys or controls.is_for_places(key)
        presses = _Presses(self._repeats_use, self._confirmed)
        self._apart, self._used_at = None, self._clock()
        # The action is chosen when its turn comes, because the state may change until then.
        resolve = partial(_resolve_use, controls, key)
        declined = partial(self._why_declined, presses)
        return self.queue.ask(Intent(label, resolve, there, declined=declined), source, view)

    @property
    def _confirmed(self) -> GroundAction | None:
        """Action that takes a dish apart and was declined a moment ago."""
        action, time = self._apart or (None, 0.0)
        return action if self._clock() - time < CONFIRM_SECONDS else None

    @property
    def _repeats_use(self) -> bool:
        """True shortly after the use key, when another press may be one too many."""
        return self._used_at is not None and self._clock() - self._used_at < QUICK_SECONDS

    @property
    def guarded(self) -> frozenset[str]:
        """Objects that the use key does not take up or put down at the moment."""
        return self.queue.just_used(self._repeats_use)

    def _why_declined(self, presses: _Presses, resolved: ResolvedInput, view: View) -> str:
        """Return why the use key does not do its action now, or ""."""
        if resolved.action is None or not resolved.valid:
            return ""
        used = self.queue.just_used(presses.repeats)
        if handled(view.state, view.me or "", resolved.action) & used:
            return GUARDED
        if resolved.action == presses.confirmed or not takes_apart(view.state, resolved.action):
            return ""
        self._apart = resolved.action, self._clock()
        return PART_OF_DISH

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
        return self.queue.ask(_walk_intent(controls, (command,)), source, view)

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
        intent = Intent(label, partial(_repeat, label, action), action=action)
        return self.queue.ask(intent, source, view)

    @property
    def page(self) -> int:
        """Index of the page shown; a page has nine actions."""
        return self.chosen // MAX_CHOICES

    # Hints

    def mark(self, state: State, me: str) -> ActionMark | None:
        """Return the mark of the last action, or of the station that the player waits for."""
        sent = self.queue.sent  # Read once: it becomes None as time passes.
        if sent is not None:
            station = sent.action.destination or scene(state)[me].at
            return ActionMark(station, sent.fate) if station else None
        awaited = self.queue.awaited
        return ActionMark(awaited, "asked") if awaited else None

    def use_rests(self, controls: Controls, view: View) -> bool:
        """Return whether the use key does nothing at this station at the moment.

        It waits for a walk, or it would undo what the player has just done.
        """
        if self.queue.awaited is not None:
            return True
        if not (guarded := self.guarded):
            return False
        resolved = _resolve_use(controls, "", view)
        if resolved.action is None or not resolved.valid:
            return False
        return bool(handled(view.state, view.me or "", resolved.action) & guarded)

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
        if not found and (resolved.action is not None or resolved.advice):
            key = self.keys.words(Command.USE) if resolved.action is not None else ""
            found.append((key, resolved.hint))
        here = scene(state)[me].at
        clicked = controls.click(state, me, here) if here else resolved
        if clicked.valid and clicked.action != resolved.action:
            found.append(("Click", hint_words(clicked, state)))
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


def _walk_intent(controls: Controls, commands: tuple[Command, ...]) -> Intent:
    """Return a walk in some directions, to which the queue can add further ones."""
    label = " ".join(key_words(command.value) for command in commands)

    def resolve(view: View) -> ResolvedInput:
        directions = [DIRECTIONS[command] for command in commands]
        return walk(controls, view.state, view.me or "", directions)

    def extend(further: Intent) -> Intent | None:
        longer = (*commands, *further.commands)
        return _walk_intent(controls, longer) if len(longer) <= MAX_DIRECTIONS else None

    return Intent(label, resolve, commands=commands, extend=extend)


def _repeat(words: str, action: GroundAction, view: View) -> ResolvedInput:
    return ResolvedInput(action, words, action in view.state.actions(view.me or ""))
