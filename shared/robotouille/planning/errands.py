"""A plan without its walks, as errands, and the ways on which a world's players walk."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from robotouille.planning.plan import Joint, Plan
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.world import State, World


@dataclass(frozen=True, slots=True)
class Errand:
    """An action of a plan other than a walk.

    `needs` are facts about its objects, and about objects in or on them, that time or repeated work
    made true before the action. A patty, for example, is picked up from the stove when it is
    cooked.
    """

    player: str
    action: GroundAction
    needs: int = 0

    @property
    def objects(self) -> frozenset[str]:
        """Objects and stations of the action."""
        return frozenset(self.action.arguments[1:])


@dataclass(frozen=True, slots=True)
class PlanTrace:
    """A plan's joint actions and its states, one more than steps."""

    joints: tuple[Joint, ...]
    states: tuple[State, ...]

    @staticmethod
    def of(plan: Plan, start: State) -> PlanTrace:
        """Return the trace of a plan from a state."""
        states = [start]
        for joint in plan:
            states.append(states[-1].step(joint).state)
        return PlanTrace(plan.steps, tuple(states))


@dataclass(frozen=True, slots=True)
class ErrandList:
    """The errands of each step of a plan, and the facts before each step and at the end."""

    steps: tuple[tuple[Errand, ...], ...]
    facts: tuple[int, ...]

    def nearest(self, facts: int) -> int:
        """Return the first step whose facts differ least from these."""
        # The first one, because repeated work changes no facts until it is done.
        steps = range(len(self.steps))
        return min(steps, key=lambda step: (facts ^ self.facts[step]).bit_count(), default=0)

    def since(self, step: int) -> Iterator[Errand]:
        """Yield the errands from a step on."""
        return (errand for row in self.steps[step:] for errand in row)


def errands(course: PlanTrace) -> ErrandList:
    """Return the errands of a plan."""
    by_time, found = 0, []
    for joint, before, state in zip(course.joints, course.states, course.states[1:], strict=False):
        row, touched = [], 0
        for action in joint:
            touched |= action.touched
            if action.player is None or action.destination is not None:
                continue
            if action.touched or action.effects:
                needs = _about(action, before, before.facts & by_time)
                row.append(Errand(action.player, action, needs))
        by_time |= state.facts & ~before.facts & ~touched
        found.append(tuple(row))
    return ErrandList(tuple(found), tuple(state.facts for state in course.states))


def _about(action: GroundAction, state: State, held: int) -> int:
    """Return those of some true facts that are about an action's objects or their contents."""
    table, about = state.world.table, 0
    for name in action.arguments[1:]:
        about |= table.mentions(name)
    for bit in bits_of(held & ~about):
        if not any(state.facts & table.mentions(name) & about for name in table.atoms[bit][1:]):
            held &= ~(1 << bit)
    return held


def _walks(world: World) -> Iterator[tuple[ActionSchema, tuple[str, str]]]:
    """Yield the actions that are walks, with their parameters for origin and destination."""
    for schema in world.schemas:
        travel = schema.definition.travel
        if travel is not None and schema.player:
            yield schema, travel


class TileMap:
    """The stations of a world and the walks between them. The world must have walks."""

    def __init__(self, world: World) -> None:
        self.world = world
        walk, (self._here, self._there) = next(_walks(world))
        self._walk = walk
        self._who = walk.parameters[0][0]
        self.stations = list(world.table.by_type[dict(walk.parameters)[self._there]])
        self._at = self._places()
        self._anywhere = {p: sum(self._at[p, s] for s in self.stations) for p in world.players}
        self._walks: dict[tuple[str, str, str], GroundAction] = {}
        self._variants: dict[GroundAction, tuple[int, tuple[GroundAction, ...]]] = {}
        self._aims: dict[GroundAction, int] = {}

    @staticmethod
    def is_walked(world: World) -> bool:
        """Return whether a world has walks with an origin and a destination."""
        return any(_walks(world))

    def _places(self) -> dict[tuple[str, str], int]:
        """Return the fact that a player is at a station, for each pair."""
        definition, table = self._walk.definition, self.world.table
        sets = {(c.predicate, c.params) for c in definition.immediate_fx if c.is_true}
        says = [c.predicate for c in definition.precons
                if c.params == (self._who, self._here)
                and (c.predicate, (self._who, self._there)) in sets]  # fmt: skip
        return {
            (player, station): table.mask((predicate, player, station) for predicate in says[:1])
            for player, station in product(self.world.players, self.stations)
        }

    def place(self, player: str, facts: int) -> str:
        """Return a player's station."""
        return next(s for s in self.stations if facts & self._at[player, s])

    def moved(self, player: str, facts: int, station: str) -> int:
        """Return facts in which a player is at another station."""
        return facts & ~self._anywhere[player] | self._at[player, station]

    def walk(self, player: str, here: str, there: str) -> GroundAction:
        """Return a player's walk between two stations."""
        known = self._walks.get((player, here, there))
        if known is None:
            binding = {self._who: player, self._here: here, self._there: there}
            names = [binding[name] for name, _ in self._walk.parameters]
            known = self._walks[player, here, there] = self.world.action(self._walk.name, *names)
        return known

    def station_of(self, action: GroundAction) -> str | None:
        """Return the station at which an action's player has to be."""
        required = action.required
        player = action.player
        return next((s for s in self.stations if required & self._at[player, s]), None)  # type: ignore[index]

    def lacks(self, action: GroundAction, facts: int) -> int:
        """Return an action's unmet conditions, apart from its player's place."""
        return (facts ^ action.required) & action.tested & ~self._anywhere[action.player or ""]

    def aims(self, action: GroundAction) -> int:
        """Return the facts about objects that an action makes true, at once or later."""
        known = self._aims.get(action)
        if known is None:
            known = action.touched & ~action.removed
            for effect in action.effects:
                for node in effect.counters():
                    known |= node.sets
            table, unmoved = self.world.table, {*self.stations, *self.world.players}
            for atom, bit in table.bit.items():
                if known & bit and unmoved.issuperset(atom[1:]):
                    known &= ~bit
            self._aims[action] = known
        return known

    def variants(self, action: GroundAction) -> tuple[GroundAction, ...]:
        """Return the action, then those that differ in the station or in created objects.

        Stations of the same kind come first.
        """
        # The table grows when objects are created, which adds variants.
        size = len(self.world.table.atoms)
        known = self._variants.get(action)
        if known is None or known[0] != size:
            known = self._variants[action] = (size, (action, *self._others(action)))
        return known[1]

    def _others(self, action: GroundAction) -> Iterator[GroundAction]:
        world, table = self.world, self.world.table
        pools: list[list[str]] = []
        for name, (_, kind) in zip(action.arguments, action.schema.parameters, strict=True):
            if name in self.stations:
                pools.append(self._alike_first(name))
            else:
                pools.append(list(table.by_type[kind]) if kind in table.transient else [name])
        for names in product(*pools):
            found = world.action(action.name, *names)
            if found is not action and not found.required & ~found.tested:
                yield found

    def _alike_first(self, station: str) -> list[str]:
        kind = self.world.thing(station).kind
        return sorted(self.stations, key=lambda s: (s != station, self.world.thing(s).kind != kind))
