"""What planner bots say in the chat, and what they understand (planners.md, "In a team")."""

from __future__ import annotations

import re
from collections.abc import Sequence

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World

__all__ = ["VERSION", "announced_version", "announcement", "intention", "request", "requested"]

VERSION = 1
"""Of how planner bots make and follow the plan of a team: those of another one plan differently."""

MAX_SAID = 500
"""Characters of a chat message."""

_ANNOUNCED = re.compile(r"\(team planner (\d{1,6})\)\s*$")
_REQUEST = re.compile(r"\b(need|make way|please)\b", re.IGNORECASE)


def announcement() -> str:
    """Says that a bot plans for all that say the same."""
    return f"I plan together with all who say this (team planner {VERSION})"


def announced_version(text: str) -> int | None:
    """The version that an announcement names; None if a text is none."""
    found = _ANNOUNCED.search(text)
    return int(found[1]) if found else None


def intention(actions: Sequence[GroundAction]) -> str:
    """What a bot is about to do, as sentences."""
    return f"Next: {'; '.join(action.sentence for action in actions)}"[:MAX_SAID]


def request(station: str, player: str) -> str:
    """Asks somebody to make way."""
    return f"I need {station}: please make way, {player}"


def requested(text: str, station: str, world: World) -> bool:
    """Whether a text asks for a station, by its name or by what it is."""
    kind = world.thing(station).kind
    words = re.findall(r"\w+", text.lower())
    return bool(_REQUEST.search(text)) and bool({station.lower(), kind.lower()} & set(words))
