"""Signals: short messages with a fixed meaning, which usually point at an object.

People send them by a key, a click or a gamepad button; bots and models send and read them, too.
"""

from __future__ import annotations

import re
from enum import StrEnum
from typing import NamedTuple

from robotouille.world.presentation.places import capitalised, filled
from robotouille.world.presentation.wording import Wording
from robotouille.world.scene import scene
from robotouille.world.world import State

MAX_TEXT = 500


class Intent(StrEnum):
    """Meaning of a signal."""

    NEED = "need"
    """I need this: leave the station, or hand over the item."""
    YOURS = "yours"
    """You take care of this."""
    LOOK = "look"
    """Look at this."""
    WAIT = "wait"
    """Wait a moment."""
    THANKS = "thanks"


POINTING = frozenset({Intent.NEED, Intent.YOURS, Intent.LOOK})
"""Intents that need a target."""


class Signal(NamedTuple):
    """An intent, and the name of the station, item or player that it points at."""

    intent: Intent
    target: str = ""


def signal_from(intent: str, target: str) -> Signal | None:
    """Return a signal from its parts; None for a chat message, and for intents of a later version.

    `intent` is empty in a chat message.
    """
    known = intent in Intent.__members__.values()
    return Signal(Intent(intent), target) if known else None


def signal_fault(signal: Signal, player: str, state: State) -> str:
    """Return why a player cannot send a signal in a state; empty if the player can."""
    intent, target = signal
    if not target:
        return f"{intent.value!r} needs a target" if intent in POINTING else ""
    if target in state.world.players:
        if target == player:
            return "a signal cannot point at its sender"
        return f"{intent.value!r} cannot point at a player" if intent is Intent.NEED else ""
    if target in state.world.floor.stations or target in scene(state):
        return ""
    return f"there is no {target!r} in the kitchen"


def is_outdated(signal: Signal, player: str, state: State) -> bool:
    """Return whether a player needs something that no other player occupies or holds."""
    intent, target = signal
    if intent is not Intent.NEED:
        return False
    placed = scene(state)
    others = {name for name in state.world.players if name != player}
    if target in state.world.floor.stations:
        return all(placed[name].at != target for name in others)
    return target not in placed or placed[target].host not in others


def signal_text(signal: Signal, state: State, wording: Wording) -> str:
    """Return a signal as a sentence."""
    intent, target = signal
    words, thing = wording.language.signals, ""
    if target:
        is_place = target in state.world.floor.stations
        thing = wording.place(target, state) if is_place else wording.thing(target, state)
    template: str = getattr(words, intent.value)
    return capitalised(filled(template, thing=thing))[:MAX_TEXT]


# Patterns of English only: without a signal, a sentence in another language is only chat.
_SAID = {
    Intent.WAIT: r"^\W*(please\W+)?(wait|stop|hold on|hang on|one moment)\b",
    Intent.YOURS: r"\b((can|could|would) you|you (take|get|do|bring|make))\b",
    Intent.NEED: r"\b(i need|give me|i want)\b",
    Intent.THANKS: r"\b(thanks?|thank you|thx|cheers)\b",
}


def understood(text: str, state: State, wording: Wording) -> Signal | None:
    """Return what a chat message says, if it is one of the intents.

    The target is the station or item named by the longest words in the text, if there is one.
    """
    for intent, pattern in _SAID.items():
        if re.search(pattern, text, re.IGNORECASE):
            target = _named(text, state, wording)
            return Signal(intent, target) if target or intent not in POINTING else None
    return None


def _named(text: str, state: State, wording: Wording) -> str:
    return next(iter(named(text, state, wording)), "")


def named(text: str, state: State, wording: Wording) -> tuple[str, ...]:
    """Return a station and an item that a text names, each by its longest words, if there are any.

    Of several items with one name, the first is returned.
    """
    kinds = {name: wording.kind(wording.world.thing(name).kind) for name in scene(state)}
    stations = wording.places(state)
    items = {n: noun for n, noun in kinds.items() if n not in {*stations, *state.world.players}}
    found = []
    for names in (stations, items):
        said = [name for name, words in names.items() if _has(text, words)]
        found += [max(said, key=lambda name: len(names[name]))] if said else []
    return tuple(found)


def _has(text: str, words: str) -> bool:
    return re.search(rf"\b{re.escape(words)}\b", text, re.IGNORECASE) is not None
