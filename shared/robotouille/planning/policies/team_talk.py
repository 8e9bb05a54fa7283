"""What planner bots say in the chat, and what they understand (planners.md, "In a team")."""

from __future__ import annotations

import re
from collections.abc import Sequence

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.wording import Wording
from robotouille.world.world import State

__all__ = [
    "TOLD",
    "VERSION",
    "Talk",
    "announced_version",
    "announcement",
    "intention",
    "request",
    "requested",
]

VERSION = 1
"""Of how planner bots make and follow the plan of a team: those of another one plan differently."""

MAX_SAID = 500
"""Characters of a chat message."""

ASK_AGAIN, TELL_AGAIN = 20, 6
"""Steps between two requests to make way, and between two intentions that are told."""

TOLD = 3
"""Actions of an intention."""

_ANNOUNCED = re.compile(r"\(team planner (\d{1,6})\)\s*$")
_REQUEST = re.compile(r"\b(need|make way|please)\b", re.IGNORECASE)


def announcement() -> str:
    """Says that a bot plans for all that say the same."""
    return f"I plan together with all who say this (team planner {VERSION})"


def announced_version(text: str) -> int | None:
    """The version that an announcement names; None if a text is none."""
    found = _ANNOUNCED.search(text)
    return int(found[1]) if found else None


def intention(actions: Sequence[GroundAction], state: State, wording: Wording) -> str:
    """What a bot is about to do."""
    return f"Next: {'; '.join(wording.action(action, state) for action in actions)}"[:MAX_SAID]


def request(station: str, state: State, wording: Wording) -> str:
    """Asks whoever stands at a station to make way."""
    return f"I need {wording.place(station, state)}, please"


def requested(text: str, station: str, state: State, wording: Wording) -> bool:
    """Whether a text asks for a station: by its place as one says it now, by its name, or by what
    it is called, which may have the number of another."""
    if not _REQUEST.search(text):
        return False
    places = wording.places(state).items()
    named = [(len(words), name) for name, words in places if _has(text, words)]
    if named and re.search(r"\d", text) is None:
        return max(named)[1] == station
    kind, number = wording.world.thing(station).kind, re.search(r"\d+$", station)
    for noun in {kind, kind.replace("_", " "), wording.kind(kind)}:
        for found in re.finditer(rf"\b{re.escape(noun)}(?: (\d+))?\b", text, re.IGNORECASE):
            if not found[1] or (number is not None and found[1] == number[0]):
                return True
    return _has(text, station)


def _has(text: str, words: str) -> bool:
    return re.search(rf"\b{re.escape(words)}\b", text, re.IGNORECASE) is not None


class Talk:
    """The words of one seat; nothing, if it is `silent`. `request` is what it asks of others."""

    def __init__(self, *, silent: bool) -> None:
        self.request = ""
        self._silent = silent
        self._said = [] if silent else [announcement()]
        self._asked = self._told = -ASK_AGAIN

    def speak(self) -> list[str]:
        """What there is to be said since this was last asked."""
        said, self._said = self._said, []
        return said

    def announce(self) -> None:
        """Say that this seat plans like others that say so."""
        if not self._silent and announcement() not in self._said:
            self._said.append(announcement())

    def may_tell(self, step: int) -> bool:
        """Whether what comes next was not told a moment ago."""
        return not self._silent and step - self._told >= TELL_AGAIN

    def tell(self, text: str, step: int) -> None:
        """Say what comes next."""
        self._told = step
        self._said.append(text)

    def may_ask(self, step: int) -> bool:
        """Whether enough time has passed since the last request."""
        return not self._silent and step - self._asked >= ASK_AGAIN

    def ask(self, text: str, step: int) -> None:
        """Ask somebody to make way."""
        self._asked, self.request = step, text
        self._said.append(text)

    def ask_again(self, step: int) -> None:
        """Repeat the last request, if it still stands."""
        if self.request and self.may_ask(step):
            self.ask(self.request, step)
