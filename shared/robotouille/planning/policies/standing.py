"""Where players stand, and where they are in nobody's way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = [
    "is_out_of_the_way",
    "leads_to",
    "seat_out_of_the_way",
    "standing_at",
    "travel_ends",
    "walk_to",
    "walks_aside",
    "walks_out_of_the_way",
]


def standing_at(state: State, player: str) -> str | None:
    """The station at which a player stands, judged by where it could walk from; None if it cannot
    walk at all."""
    walks = _walks(state, player)
    return travel_ends(walks[0])[0] if walks else None


def walk_to(state: State, player: str, station: str | None) -> GroundAction | None:
    """A player's walk to a station; None if there is none now."""
    return next((w for w in _walks(state, player) if travel_ends(w)[1] == station), None)


def walks_aside(state: State, player: str) -> list[GroundAction]:
    """A player's walks to stations that are plain and empty, or else at least plain; none if it
    stands at one that is plain and empty.

    Plain are those of the kind of which there are most.
    """
    walks = _walks(state, player)
    if not walks:
        return []
    plain, quiet = _plain(state, walks)
    if travel_ends(walks[0])[0] in quiet:
        return []
    aside = [walk for walk in walks if travel_ends(walk)[1] in quiet]
    return aside or [walk for walk in walks if travel_ends(walk)[1] in plain]


def walks_out_of_the_way(state: State, player: str) -> list[GroundAction]:
    """Those of `walks_aside` that lead to where nobody wants to be."""
    walks = walks_aside(state, player)
    quiet = _plain(state, walks)[1] if walks else set()
    return [walk for walk in walks if travel_ends(walk)[1] in quiet]


def _plain(state: State, walks: list[GroundAction]) -> tuple[set[str], set[str]]:
    """The stations that are plain, and those of them that are empty besides."""
    here = travel_ends(walks[0])[0]
    stations = [t for t in state.objects if t.type == state.world.thing(here).type]
    kind = Counter(t.kind for t in stations).most_common(1)[0][0]
    used = {
        name
        for _, *arguments in state.atoms()
        if len(arguments) > 1 and arguments[0] not in state.world.players
        for name in arguments[1:]
    }
    plain = {t.name for t in stations if t.kind == kind}
    return plain, plain - used


def _walks(state: State, player: str) -> list[GroundAction]:
    return [a for a in state.actions(player) if a.schema.definition.travel]


def is_out_of_the_way(state: State, player: str) -> bool:
    """Whether a player stands where nobody wants to be: at a station that is plain and empty."""
    return standing_at(state, player) is not None and not walks_aside(state, player)


def seat_out_of_the_way(state: State) -> str:
    """The first player who stands in nobody's way: the seat for whoever may stand still for long.
    The first of all, where each of them does."""
    players = state.world.players
    return next((p for p in players if is_out_of_the_way(state, p)), players[0])


def travel_ends(walk: GroundAction) -> tuple[str, str]:
    """Where a walk begins, and where it ends."""
    names = [name for name, _ in walk.schema.parameters]
    here, there = walk.schema.definition.travel or ("", "")
    return walk.arguments[names.index(here)], walk.arguments[names.index(there)]


def leads_to(action: GroundAction, stations: Collection[str | None]) -> bool:
    """Whether an action is a walk to one of some stations."""
    return bool(action.schema.definition.travel) and travel_ends(action)[1] in stations
