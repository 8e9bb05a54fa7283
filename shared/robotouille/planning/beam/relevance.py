"""Which stations, objects and actions a search has to consider."""

from __future__ import annotations

from robotouille.planning.beam.remaining_work_heuristic import HeuristicContext, RemainingWork
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.world import State

__all__ = ["Relevance"]


class Relevance:
    """Decides about actions, given where a search starts and what it is for.

    Stations are relevant if the goal names them, if some action can only be done at their like, if
    something relevant lies there, or as one of a few spare places; of stations that are alike and
    free, no more are needed than there are players. Objects are relevant if the goal or its
    support is about them, or if they lie in the way.
    """

    def __init__(
        self, context: HeuristicContext, state: State, heuristic: RemainingWork, players: int
    ) -> None:
        self._analysis = context.analysis
        self._world = context.world
        self._facts = state.facts
        wanted = set(heuristic.binding.values())
        for part in heuristic.parts:
            for projection in part.projections:
                wanted.update(projection.focus.names)
        self._around = self._neighbourhoods()
        self.stations = {n for n in wanted if n in self._analysis.stations}
        self.stations |= self._special()
        self.movables = {n for n in wanted if n not in self._analysis.stations}
        for name in sorted(self.movables):
            self.stations |= self._around.get(name, set()) & set(self._analysis.stations)
        self.stations |= self._spare(players + 1)
        for station in sorted(self.stations) + list(self._world.players):
            self.movables |= self._around.get(station, set())
        self._allowed: dict[GroundAction, bool] = {}

    def __call__(self, action: GroundAction) -> bool:
        """Whether a search should try an action."""
        found = self._allowed.get(action)
        if found is None:
            found = self._allowed[action] = self._judge(action)
        return found

    def _judge(self, action: GroundAction) -> bool:
        if self._analysis.is_idle(action):
            return False
        for name in action.arguments:
            thing = self._world.thing(name)
            if thing.type in self._analysis.station_types:
                start = action.name in self._analysis.walking
                if name not in self.stations and not (start and name == self._leaving(action)):
                    return False
                continue
            movable = self._analysis.is_movable(thing.type) and thing.tile is not None
            if movable and name not in self.movables:
                return False
        return True

    def _leaving(self, action: GroundAction) -> str:
        """The station that a walk starts at: the first it names."""
        return next(n for n in action.arguments if n in self._analysis.stations)

    def _neighbourhoods(self) -> dict[str, set[str]]:
        """For each object, the others that a true fact connects it with."""
        around: dict[str, set[str]] = {}
        for position in bits_of(self._facts & ~self._world.table.internal):
            names = self._world.table.atoms[position][1:]
            for name in names:
                around.setdefault(name, set()).update(n for n in names if n != name)
        return around

    def _roles(self, station: str) -> tuple[str, ...]:
        """The static predicates of a station that some action asks for."""
        asked = {c.predicate for s in self._world.schemas for c in s.definition.precons}
        static = self._world.table.static
        return tuple(sorted(p for p in asked if (p, station) in static))

    def _special(self) -> set[str]:
        return {s for s in self._analysis.stations if self._roles(s)}

    def _spare(self, number: int) -> set[str]:
        """Stations without anything on them, those near the others first."""
        players = set(self._world.players)
        free = [
            s
            for s in self._analysis.stations
            if s not in self.stations and not self._around.get(s, set()) - players
        ]
        floor = self._world.floor
        chosen = sorted(self.stations)
        free.sort(key=lambda s: sum(floor.distance(s, other) for other in chosen))
        return set(free[:number])
