"""What a window tells its owner of a game's keys, clicks and actions, in its kitchen's words."""

from __future__ import annotations

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.templates import capitalised
from robotouille.world.world import State
from robotouille_client.window.drawing.ui_overlay import KeyRows
from robotouille_client.window.hands.commands import Command, key_words
from robotouille_client.window.hands.controls import Controls, Meaning
from robotouille_client.window.hands.hands import MAX_CHOICES, Hands, hint_words
from robotouille_client.window.view import LobbyView, View

__all__ = ["PlayWords"]

_Asked = tuple[State, str | None, str | None, LobbyView | None, tuple[bool, bool, bool]]
_List = tuple[State, tuple[GroundAction, ...]]
_Advice = tuple[tuple[str, ...], KeyRows]


class PlayWords:
    """Words for what the owner's `hands` could do; where it takes long, they are kept.

    Where the window is not `alone`, a strip tells spectators keys; where one `may_leave`, the key
    for it is told.
    """

    def __init__(self, hands: Hands, *, alone: bool, may_leave: bool) -> None:
        self._hands = hands
        self._alone = alone
        self._may_leave = may_leave
        self._advice: tuple[_Asked, _Advice] | None = None
        self._listed: tuple[_List, tuple[str, ...]] | None = None

    def advice(self, controls: Controls, view: View, hover: str | None) -> _Advice:
        """Tips and hints: asked for once for each state."""
        interrupted = (view.pause is not None, view.offline is not None, view.frozen)
        key = (view.state, view.me, hover, view.lobby, interrupted)
        if self._advice is None or self._advice[0] != key:
            hints: KeyRows = ()
            if view.lobby is not None and view.asks_if_ready:
                use = self._hands.keys.words(Command.USE)
                hints = ((use, "not ready yet" if view.lobby.ready else "I am ready"),)
            elif view.me is not None and not view.frozen:
                hints = self._hands.hints(controls, view.state, view.me)
            self._advice = (key, (_tips(controls, view, hover), hints))
        return self._advice[1]

    def permanent_keys(self, controls: Controls, view: View) -> KeyRows:
        """What is always told below the kitchen."""
        keys = self._hands.keys
        if view.me is None and not self._alone:
            return ()
        rows = [("", "You are watching")] if view.me is None else []
        if view.me is not None and not view.frozen:
            rows = [(self._walk_keys(controls), "walk"), (keys.words(Command.LIST), "all actions")]
        if view.asks_if_ready:
            rows = []
        if (view.pause or view.lobby) is not None and view.offline is None and view.me is not None:
            chat = (keys.words(Command.CHAT), "say something")
            rows = [chat] if view.pause is not None else [*rows, chat]
        if self._may_leave:
            rows.append((key_words("escape"), "leave"))
        return (*rows, (keys.words(Command.HELP), "help"))

    def _walk_keys(self, controls: Controls) -> str:
        """The keys that walk here: a domain's own keys come before letters."""
        keys, bound = self._hands.keys, controls.keys
        order = (Command.UP, Command.LEFT, Command.DOWN, Command.RIGHT)
        letters = [keys.keys(c)[0] for c in order if keys.keys(c) and keys.keys(c)[0] not in bound]
        return "".join(letters).upper() if len(letters) == 4 else "Arrows"

    def choices(self, controls: Controls, view: View) -> tuple[tuple[str, ...] | None, str]:
        """The page of the open list, and whether it goes on; None while it is closed."""
        actions = self._hands.choices
        if actions is None:
            return None, ""
        start = self._hands.page * MAX_CHOICES
        pages = -(-len(actions) // MAX_CHOICES)
        more = f"{self._hands.page + 1} of {pages}: Left, Right" if pages > 1 else ""
        return self._said(controls, actions[start : start + MAX_CHOICES], view), more

    def _said(
        self, controls: Controls, actions: tuple[GroundAction, ...], view: View
    ) -> tuple[str, ...]:
        """Actions in words: made once for each state."""
        if self._listed is None or self._listed[0] != (view.state, actions):
            words, state = controls.wording(view.me), view.state
            meant = [Meaning(a, words.action(a, state), True) for a in actions]
            rows = tuple(capitalised(hint_words(each, state)) for each in meant)
            self._listed = (view.state, actions), rows
        return self._listed[1]

    def help(self, controls: Controls, view: View) -> KeyRows:
        """All keys."""
        keys = self._hands.keys
        bound = controls.bindings.keyboard_actions
        always = {b.input_instructions.key for b in bound if b.input_instructions.at is None}
        use = " or ".join(key_words(k) for k in keys.keys(Command.USE) if k not in always)
        walk = dict.fromkeys((self._walk_keys(controls), "Arrows"))
        own = (
            (", ".join(walk), "walk to the next station that way"),
            (f"{use}, right click", "what is most useful here"),
            (keys.words(Command.LIST), "all that can be done now, 1 to 9 picks"),
        )
        window = (
            (f"{keys.words(Command.CHAT)} or Enter", "say something (Enter sends, Esc cancels)"),
            (keys.words(Command.SOUND), "sound on or off"),
            (keys.words(Command.FULLSCREEN) + ", Alt+Enter", "fill the screen"),
            (keys.words(Command.SCREENSHOT), "save a picture of the window"),
            (keys.words(Command.HELP), "this help"),
            (key_words("escape"), self._escape_words(view)),
        )
        return (*own, *controls.help(), *window) if view.me else window

    def _escape_words(self, view: View) -> str:
        does = ["close what is open"]
        does += ["forget what waits to be done"] if view.me else []
        return ", ".join([*does, "leave"] if self._may_leave else does)


def _tips(controls: Controls, view: View, hover: str | None) -> tuple[str, ...]:
    if hover is None:
        return ()
    title = capitalised(controls.wording(view.me).thing(hover, view.state))
    if view.me is None or view.state.busy_steps(view.me):  # That is told where one is oneself.
        return (title,)
    meaning = controls.click(view.state, view.me, hover)
    if not meaning.valid:
        return (title, meaning.hint) if meaning.hint else (title,)
    return (hint_words(meaning, view.state),)
