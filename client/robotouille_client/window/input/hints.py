"""Hints, tips and help texts of a game, in the words of its kitchen."""

from __future__ import annotations

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.unserved import unserved
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.drawing.window_layout import KeyRows
from robotouille_client.window.input.commands import Command, key_words
from robotouille_client.window.input.controls import Controls, ResolvedInput
from robotouille_client.window.input.input_controller import (
    MAX_CHOICES,
    InputController,
    hint_words,
)
from robotouille_client.window.sources.texts import unserved_words
from robotouille_client.window.view import LobbyView, View

_Asked = tuple[
    State,
    str | None,
    str | None,
    LobbyView | None,
    tuple[bool, bool, bool, bool],
    frozenset[str],
    str | None,
]
_List = tuple[State, tuple[GroundAction, ...]]
_Advice = tuple[tuple[str, ...], KeyRows]


SIGNAL_WORDS = {
    Command.NEED: "tell others: I need this (under the mouse)",
    Command.YOURS: "you take this",
    Command.LOOK: "look at this (also a middle click)",
    Command.WAIT: "wait",
    Command.THANKS: "thank you",
}


DISCARDED = ", which goes back to where it came from"
"""End of the words for putting a thing into a bin."""


SHIFT_ROWS = (
    ("Orders", "on the right, with the layers of each dish: serve it before its bar runs out"),
    ("Points", "more for an early dish, fewer if a guest leaves"),
)


class PlayHints:
    """Texts about what the player can do now. Slow ones are cached for the current state.

    Args:
        alone: True if the window has no strip. A strip shows spectators its own keys.
        may_leave: True to show the key for leaving.
    """

    def __init__(self, controller: InputController, *, alone: bool, may_leave: bool) -> None:
        self._controller = controller
        self._alone = alone
        self._may_leave = may_leave
        self._advice: tuple[_Asked, _Advice] | None = None
        self._listed: tuple[_List, tuple[str, ...]] | None = None

    def advice(self, controls: Controls, view: View, hover: str | None) -> _Advice:
        # Searching near misses is slow, so the result is kept while this key stays the same.
        counting = view.starts_in is not None
        interrupted = (view.pause is not None, view.offline is not None, view.frozen, counting)
        guarded, awaited = self._controller.guarded, self._controller.queue.awaited
        key = (view.state, view.me, hover, view.lobby, interrupted, guarded, awaited)
        if self._advice is None or self._advice[0] != key:
            hints: KeyRows = ()
            if view.lobby is not None and view.asks_if_ready:
                use = self._controller.keys.words(Command.USE)
                if counting:
                    use = key_words("enter")
                hints = ((use, "not ready after all" if view.lobby.ready else "I'm ready!"),)
            elif view.me is not None and not view.frozen:
                hints = self._hands(controls, view, view.me)
            self._advice = (key, (tips_about(controls, view, hover), hints))
        return self._advice[1]

    def _hands(self, controls: Controls, view: View, me: str) -> KeyRows:
        """Return what the keys for work do now, or else what the station is for."""
        use = self._controller.keys.words(Command.USE)
        rows = self._controller.hints(controls, view.state, me)
        if self._controller.use_rests(controls, view):
            return tuple(row for row in rows if row[0] != use)
        here = scene(view.state)[me].at
        if here is not None and _discards(view.state, here):
            rows = tuple(
                (key, f"{words}{DISCARDED}" if key == use else words) for key, words in rows
            )
        busy = view.state.busy_steps(me)
        # A table is for what the player holds, which has its own rows.
        if rows or busy or here is None or here in controls.world.floor.plain:
            return rows
        purpose = controls.wording(me).purpose(controls.world.thing(here).kind)
        return (("", capitalised(purpose)),) if purpose else ()

    def permanent_keys(self, controls: Controls, view: View) -> KeyRows:
        """Return the keys that are always shown below the kitchen."""
        keys = self._controller.keys
        if view.me is None and not self._alone:
            return ()
        rows = [("", "You're watching")] if view.me is None else []
        if view.me is not None and not view.frozen:
            rows = [(self._walk_keys(controls), "walk"), (keys.words(Command.LIST), "all actions")]
        if view.asks_if_ready:
            rows = []
        if (view.pause or view.lobby) is not None and view.offline is None and view.me is not None:
            chat = (keys.words(Command.CHAT), "chat")
            rows = [chat] if view.pause is not None else [*rows, chat]
        if self._may_leave:
            rows.append((key_words("escape"), "leave"))
        return (*rows, (keys.words(Command.HELP), "help"))

    def _walk_keys(self, controls: Controls) -> str:
        """Return the keys for walking. Letters that the domain binds itself do not walk."""
        keys, bound = self._controller.keys, controls.keys
        order = (Command.UP, Command.LEFT, Command.DOWN, Command.RIGHT)
        letters = [keys.keys(c)[0] for c in order if keys.keys(c) and keys.keys(c)[0] not in bound]
        return "".join(letters).upper() if len(letters) == 4 else "Arrows"

    def choices(self, controls: Controls, view: View) -> tuple[tuple[str, ...] | None, str]:
        """Return the page of the open action list and a page number; None while it is closed."""
        actions = self._controller.choices
        if actions is None:
            return None, ""
        start = self._controller.page * MAX_CHOICES
        pages = -(-len(actions) // MAX_CHOICES)
        more = f"Page {self._controller.page + 1} of {pages} (Left, Right)" if pages > 1 else ""
        return self._rows(controls, actions[start : start + MAX_CHOICES], view), more

    def _rows(
        self, controls: Controls, actions: tuple[GroundAction, ...], view: View
    ) -> tuple[str, ...]:
        # The list is drawn in every frame, but its words change only with the state.
        if self._listed is None or self._listed[0] != (view.state, actions):
            words, state = controls.wording(view.me), view.state
            inputs = [ResolvedInput(a, words.action(a, state), True) for a in actions]
            rows = tuple(capitalised(hint_words(each, state)) for each in inputs)
            self._listed = (view.state, actions), rows
        return self._listed[1]

    def help(self, controls: Controls, view: View) -> KeyRows:
        """Return rows of all keys."""
        keys = self._controller.keys
        bound = controls.bindings.keyboard_actions
        always = {b.input_instructions.key for b in bound if b.input_instructions.at is None}
        use = " or ".join(key_words(k) for k in keys.keys(Command.USE) if k not in always)
        arrows = () if view.companion else ("Arrows",)
        walk = dict.fromkeys((self._walk_keys(controls), *arrows))
        companion = (("Arrows, Right Shift", "the second person: walk, do the most useful thing"),)
        own = (
            (", ".join(walk), "walk to the next station that way"),
            (f"{use}, right click", "do the most useful thing here"),
            (keys.words(Command.LIST), "list all actions, 1 to 9 picks one"),
        )
        signals = ((keys.words(c), words) for c, words in SIGNAL_WORDS.items())
        team = tuple(signals) if len(view.world.players) > 1 else ()
        window = (
            (f"{keys.words(Command.CHAT)} or Enter", "chat (Enter sends, Esc cancels)"),
            (keys.words(Command.SOUND), "sound on or off"),
            (keys.words(Command.FULLSCREEN) + ", Alt+Enter", "full screen"),
            (keys.words(Command.SCREENSHOT), "take a screenshot"),
            (keys.words(Command.HELP), "this help"),
            (key_words("escape"), self._escape_words(view)),
        )
        if not view.me:
            return window
        paused = (("", "The game is paused where it is."),) if view.pause is not None else ()
        shift = SHIFT_ROWS if view.world.shift is not None else ()
        return (
            *paused,
            *shift,
            *own,
            *(companion if view.companion else ()),
            *controls.help(),
            *team,
            *window,
        )

    def _escape_words(self, view: View) -> str:
        does = ["close this"]
        does += ["cancel queued actions"] if view.me else []
        return ", ".join([*does, "leave"] if self._may_leave else does)


def tips_about(controls: Controls, view: View, hover: str | None) -> tuple[str, ...]:
    """Return what a click on an object does, and why a dish there is not served."""
    if hover is None:
        return ()
    waiting = unserved(view.state, controls.wording(view.me))
    why = (unserved_words(dish) for dish in waiting if dish.station == hover)
    return (*_click_tips(controls, view, hover), *why)


def _click_tips(controls: Controls, view: View, hover: str) -> tuple[str, ...]:
    """Return what a click on an object does, or what the object is and why it does nothing."""
    title = capitalised(controls.wording(view.me).thing(hover, view.state))
    if view.me is None or view.state.busy_steps(view.me):  # The player's own card says "busy".
        return (title,)
    resolved = controls.click(view.state, view.me, hover)
    if not resolved.valid:
        told = resolved.hint
        if resolved.action is None and not resolved.advice:
            kind = controls.world.thing(hover).kind
            told = capitalised(controls.wording(view.me).purpose(kind)) or told
        return (title, told) if told else (title,)
    at_a_bin = hover == scene(view.state)[view.me].at and _discards(view.state, hover)
    end = DISCARDED if at_a_bin else ""
    return (f"{hint_words(resolved, view.state)}{end}",)


def _discards(state: State, station: str) -> bool:
    """Return whether what is put on a station vanishes from it."""
    return state.world.shift is not None and station in state.world.shift.discarding
