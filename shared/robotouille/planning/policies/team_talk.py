"""Chat messages that planner bots send and understand (docs/planners.md)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from robotouille.planning.policies.policy import Speech
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.presentation.wording import Wording
from robotouille.world.scene import scene
from robotouille.world.world import State

# Bots of another version make or follow plans differently, so a team cannot count on them.
VERSION = 2

MAX_SAID = 500
"""Maximum number of characters of a chat message."""

# A request that had no effect is repeated after half a minute at five steps a second, then after a
# minute, and so on: whoever does not answer has read it.
ASK_AGAIN, INSIST = 20, 150
"""Steps between two requests, and before the first repetition of one."""

TELL_AGAIN, TELL_AGAIN_HURRIED = 6, 25
"""Steps between two announcements of the next actions; more if steps pass by themselves."""

ANNOUNCED_ACTIONS = 3
"""Number of actions in an announcement."""

_ANNOUNCED = re.compile(r"planner (\d{1,6})")
INTENDS = "Next: "
_APPEAL = re.compile(r"can you\b.*\?\s*$", re.IGNORECASE)
_REQUEST = re.compile(r"\b(need|make way|please)\b", re.IGNORECASE)


def announcement() -> Speech:
    """Return the text that tells other bots that this one plans for all bots of its version."""
    return Speech(f"planner {VERSION}", to_bots=True)


def announced_version(text: str) -> int | None:
    """Return the version that a text for bots announces, or None."""
    found = _ANNOUNCED.fullmatch(text)
    return int(found[1]) if found else None


def intention(actions: Sequence[GroundAction], state: State, wording: Wording) -> str:
    """Return the announcement of a bot's next actions."""
    return f"{INTENDS}{'; '.join(wording.action(action, state) for action in actions)}"[:MAX_SAID]


def next_intention(text: str) -> str:
    """Return the first action of an announcement by `intention`; empty for other texts."""
    first, _, _ = text.partition(";")
    return first.removeprefix(INTENDS) if text.startswith(INTENDS) else ""


# Requests and appeals are plain sentences in the words of the window, so that people and models
# understand them. Bots recognise them with the patterns above.
def request(target: str) -> Speech:
    """Return the request to leave a station or to hand over an object."""
    return Speech(signal=Signal(Intent.NEED, target))


def appeal(action: GroundAction, state: State, wording: Wording) -> str:
    """Return the request to take an action."""
    words = wording.action(action, state)
    return f"Can you {words[0].lower()}{words[1:]}?"


def promise(action: GroundAction, state: State, wording: Wording) -> str:
    """Return the answer of a bot that takes over a thing: its first action with it."""
    words = wording.action(action, state)
    return f"I will {words[0].lower()}{words[1:]}"


def refusal(target: str, state: State, wording: Wording) -> str:
    """Return the answer of a bot that has no work for a thing."""
    is_place = target in state.world.floor.stations
    words = wording.place(target, state) if is_place else wording.thing(target, state)
    return f"I have no work for {words} now"


def appealed(text: str, player: str, state: State, wording: Wording) -> str | None:
    """Return the player whom a text asks to act, or None if that is unclear.

    This is the only other player, the only one who can take exactly this action, or the one who
    holds the named object.
    """
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
    # A sentence that a player can act on at once is the clearest sign. Otherwise the holder of a
    # named object is meant.
    found = able or [other for other in others if other in held]
    return found[0] if len(found) == 1 else None


def requested(text: str, station: str, state: State, wording: Wording) -> bool:
    """Return whether a text asks for a station.

    The text may name the station's place, its name, or its kind without another station's number.
    """
    if not _REQUEST.search(text):
        return False
    places = wording.places(state).items()
    named = [(len(words), name) for name, words in places if _has(text, words)]
    # Place names can contain each other, so the longest match wins.
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


def no_plan_text() -> str:
    """Return the message that a bot has no plan, whoever makes way."""
    return "I found no way to the goal from here"


NOTHING = Speech()
"""Request that has not been made."""


class _Asked(NamedTuple):
    """The step of the last request for one need, and the number of such requests."""

    step: int = -INSIST
    times: int = 0


class Talk:
    """Chat messages of one seat, or none if `silent`."""

    def __init__(self, *, silent: bool) -> None:
        self._silent = silent
        self._said: list[Speech] = []
        self._announces = not silent
        self._asked = self._told = -INSIST
        self._last_asked = NOTHING
        self._asked_at: dict[str, _Asked] = {}
        self._last_told = ""
        self._helpless = self._allowed = False

    def speak(self, *, among_bots: bool) -> list[Speech]:
        """Return what to say since the last call; `among_bots` if another bot hears it."""
        said, self._said = self._said, []
        if self._announces and among_bots:
            self._announces = False
            return [announcement(), *said]
        return said

    def say(self, text: str) -> None:
        """Send a chat message."""
        if not self._silent:
            self._said.append(Speech(text))

    def announce(self) -> None:
        """Announce the seat's version to other planner bots."""
        self._announces = not self._silent

    def may_announce_actions(self, step: int, *, hurried: bool) -> bool:
        """Return whether the last announcement of actions was long enough ago."""
        pause = TELL_AGAIN_HURRIED if hurried else TELL_AGAIN
        return not self._silent and step - self._told >= pause

    def announce_actions(self, text: str, step: int) -> None:
        """Announce the next actions unless the last announcement was the same."""
        if text != self._last_told:
            self._told, self._last_told = step, text
            self._said.append(Speech(text))

    def may_ask(self, step: int) -> bool:
        """Return whether the last request was long enough ago."""
        return not self._silent and step - self._asked >= ASK_AGAIN

    def ask(self, wish: Speech, need: str, step: int, *, moved: bool = True) -> None:
        """Send a request.

        A request for the same need is repeated only after a pause, which doubles each time. It is
        shorter after the others have moved, which matters unless `moved` is false.

        Args:
            need: Words for what is needed. Requests for two objects of one kind have the same need.
        """
        last, times = self._asked_at.get(need, _Asked())
        first = 2 * ASK_AGAIN if moved and self._allowed else INSIST
        if self.may_ask(step) and (not times or step - last >= first << (times - 1)):
            self._asked, self._asked_at[need] = step, _Asked(step, times + 1)
            self._last_asked, self._allowed = wish, False
            self._said.append(wish)

    def allow_repetition(self) -> None:
        """Allow the last request again, because other participants have done something."""
        self._allowed = True

    def give_thanks(self) -> None:
        """Thank for a place if that was the last request. No need is left."""
        self._asked_at.clear()
        if self._last_asked.signal is not None:
            self._said.append(Speech(signal=Signal(Intent.THANKS)))

    def clear_requests(self) -> None:
        """Forget the last request, because nothing is in the way any more.

        The pause before an equal request goes on: the way may be closed again soon.
        """
        self._last_asked = NOTHING
        self._helpless = False

    def report_no_plan(self) -> None:
        """Report once that there is no plan at all."""
        if not (self._silent or self._helpless):
            self._helpless = True
            self._said.append(Speech(no_plan_text()))
