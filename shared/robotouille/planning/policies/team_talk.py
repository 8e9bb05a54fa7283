"""What planner bots say in the chat, and what they understand (planners.md, "In a team")."""

from __future__ import annotations

import re
from collections.abc import Sequence

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.wording import Wording
from robotouille.world.scene import scene
from robotouille.world.world import State

__all__ = [
    "TOLD",
    "VERSION",
    "Talk",
    "announced_version",
    "announcement",
    "appeal",
    "appealed",
    "helpless",
    "intention",
    "request",
    "requested",
]

VERSION = 2
"""Of how planner bots make and follow the plan of a team: those of another one plan differently."""

MAX_SAID = 500
"""Characters of a chat message."""

ASK_AGAIN, INSIST = 20, 150
"""Steps between two requests to make way, and until the same one is repeated that was in vain,
as long as it is so: half a minute at five steps a second."""

TELL_AGAIN, TELL_AGAIN_HURRIED = 6, 25
"""Steps between two intentions that are told: more where steps pass by themselves."""

TOLD = 3
"""Actions of an intention."""

_ANNOUNCED = re.compile(r"\(team planner (\d{1,6})\)\s*$")
_APPEAL = re.compile(r"can you\b.*\?\s*$", re.IGNORECASE)
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


def appeal(action: GroundAction, state: State, wording: Wording) -> str:
    """Asks somebody to do something."""
    words = wording.action(action, state)
    return f"Can you {words[0].lower()}{words[1:]}?"


def appealed(text: str, player: str, state: State, wording: Wording) -> str | None:
    """Whom the text of a player asks to do something: the only other one, the one who can do just
    that, or who holds what is named. None if it asks nobody, or may be meant for several."""
    if _APPEAL.match(text) is None:
        return None
    others = [other for other in state.world.players if other != player]
    if len(others) == 1:
        return others[0]
    asked = text.strip().casefold()
    able = [
        other
        for other in others
        if any(appeal(a, state, wording).casefold() == asked for a in state.actions(other))
    ]
    held = {
        each.host for each in scene(state).values() if _has(text, wording.kind(each.thing.kind))
    }
    found = able or [other for other in others if other in held]
    return found[0] if len(found) == 1 else None


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


def helpless() -> str:
    """Says that a bot has no plan, whoever makes way."""
    return "I see no way to the goal from here"


class Talk:
    """The words of one seat; nothing, if it is `silent`."""

    def __init__(self, *, silent: bool) -> None:
        self._silent = silent
        self._said = [] if silent else [announcement()]
        self._asked = self._told = -INSIST
        self._last_asked = self._last_told = ""
        self._helpless = False

    def speak(self) -> list[str]:
        """What there is to be said since this was last asked."""
        said, self._said = self._said, []
        return said

    def announce(self) -> None:
        """Say that this seat plans like others that say so."""
        if not self._silent and announcement() not in self._said:
            self._said.append(announcement())

    def may_tell(self, step: int, *, hurried: bool) -> bool:
        """Whether what comes next was not told a moment ago."""
        pause = TELL_AGAIN_HURRIED if hurried else TELL_AGAIN
        return not self._silent and step - self._told >= pause

    def tell(self, text: str, step: int) -> None:
        """Say what comes next, unless those were the last words."""
        if text != self._last_told:
            self._told, self._last_told = step, text
            self._said.append(text)

    def may_ask(self, step: int) -> bool:
        """Whether nothing was asked for a moment ago."""
        return not self._silent and step - self._asked >= ASK_AGAIN

    def ask(self, text: str, step: int) -> None:
        """Ask somebody for something; for the same thing again only after a while."""
        if self.may_ask(step) and (text != self._last_asked or step - self._asked >= INSIST):
            self._asked, self._last_asked = step, text
            self._said.append(text)

    def met(self) -> None:
        """There is a way: nothing is asked for any more."""
        self._last_asked = ""
        self._helpless = False

    def despair(self) -> None:
        """Say once that there is no plan at all."""
        if not (self._silent or self._helpless):
            self._helpless = True
            self._said.append(helpless())
