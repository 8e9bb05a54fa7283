"""An estimate of the work left until a goal is met: the search's compass.

The estimate adds up, for every object of the goal, its distance in a projection (`projection.py`)
as if the timers that run had run out, and takes off what is done of repeated actions.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from robotouille.planning.forecast import Forecast, Forecaster
from robotouille.planning.projection import DEAD, Projection
from robotouille.planning.vocabulary import Vocabulary
from robotouille.world.atoms import EXISTS, bits_of
from robotouille.world.effects import Effect
from robotouille.world.objects import Atom
from robotouille.world.timers import Timers
from robotouille.world.world import World

__all__ = ["Binding", "Estimate", "Workbench"]

Binding = dict[int | str, str]

HELD = 1.5
"""The price of having to put down something that is of no use."""


REDOING = 4.0
"""The price of having done something before what has to be done first."""


@dataclass
class Part:
    """The work on one object: the smallest distance over the ways to support it.

    An entry of `known` is (steps, mask of places, held). If nobody holds the object, being at one
    of the places saves a walk; if somebody does, `held` gives the steps by the place of the holder.
    """

    vocabulary: Vocabulary
    projections: list[Projection]
    names: tuple[str, ...]
    mask: int = 0
    known: dict[int, tuple[float, int, dict[int, float] | None]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for projection in self.projections:
            self.mask |= projection.mask

    def entry(self, facts: int) -> tuple[float, int, dict[int, float] | None]:
        """The entry for a state's facts."""
        facts &= self.mask
        found = self.known.get(facts)
        if found is None:
            found = self.known[facts] = self._look(facts)
        return found

    def distance(self, facts: int) -> float:
        """The distance for whoever is to come from elsewhere."""
        return self.entry(facts)[0]

    def _look(self, facts: int) -> tuple[float, int, dict[int, float] | None]:
        nodes = [(p.distance(p.node(facts)), i, p) for i, p in enumerate(self.projections)]
        steps, _, best = min(nodes)
        node = best.node(facts)
        places = self.vocabulary.place_mask
        holder = self._holder(best, facts)
        if holder is None:
            mask = 0
            for station in best.near(node):
                mask |= places[station]
            return steps, mask, None
        own = self.vocabulary.places[holder]
        held = {own & places[s]: best.distance(node, s) for s in best.near(node)}
        return steps, own, held

    def _holder(self, projection: Projection, facts: int) -> str | None:
        """The player that an atom about the focus mentions."""
        players = self.vocabulary.world.players
        atoms = self.vocabulary.world.table.atoms
        for position in bits_of(facts & projection.mask):
            for name in atoms[position][1:]:
                if name in players:
                    return name
        return None


class Workbench:
    """The projections of a world, made when first needed and kept."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.vocabulary = Vocabulary(world)
        self.forecast = Forecaster(world)
        self._parts: dict[tuple[str, frozenset[Atom], frozenset[str]], Part] = {}
        self._guards: dict[tuple[str, frozenset[Atom]], Part | None] = {}
        self._size = 0

    def refresh(self) -> None:
        """Have room for every object that the goal may want to be created.

        What was found before the world made more room is out of date, and forgotten.
        """
        goal = self.world.goal
        for variable, kind in ((v.id, v.kind) for v in goal.variables.values()):
            wanted = sum(v.kind == kind for v in goal.variables.values())
            while len(goal.candidates(variable)) < wanted and self._make_room():
                pass
        if self._size != len(self.world.table.atoms):
            self._size = len(self.world.table.atoms)
            self.vocabulary = Vocabulary(self.world)
            self.forecast = Forecaster(self.world)
            self._parts.clear()
            self._guards.clear()

    def _make_room(self) -> bool:
        """Have the world number one more object of each kind that can be created."""
        before = len(self.world.table.atoms)
        try:
            self.world.restore(1 << before, ())
        except ValueError:
            return False
        return len(self.world.table.atoms) > before

    def parts(self, atoms: list[Atom], facts: int) -> list[Part]:
        """The parts of a goal; each atom is the work of the first movable it mentions."""
        vocabulary = self.vocabulary
        owners: dict[str, list[Atom]] = {}
        guests: dict[str, list[Atom]] = {}
        for atom in atoms:
            first, *others = vocabulary.movables_in(atom) or [""]
            owners.setdefault(first, []).append(atom)
            for other in others:
                guests.setdefault(other, []).append(atom)
        taken = frozenset(owners) | frozenset(guests)
        parts = [self._part(name, frozenset(goal), taken) for name, goal in owners.items()]
        for name, goal in guests.items():
            for atom in goal:
                guard = self._guard(name, atom, facts)
                if guard is not None:
                    parts.append(guard)
        return parts

    def _part(self, name: str, goal: frozenset[Atom], taken: frozenset[str]) -> Part:
        key = (name, goal, taken if self._needs_support(name) else frozenset())
        part = self._parts.get(key)
        if part is None:
            part = self._parts[key] = self._new_part(name, goal, taken)
        return part

    def _needs_support(self, name: str) -> bool:
        return not name or (EXISTS, name) in self.world.table.bit

    def _new_part(self, name: str, goal: frozenset[Atom], taken: frozenset[str]) -> Part:
        focus = (name,) if name else ()
        plain = Projection(self.vocabulary, focus, goal)
        projections = [plain]
        if self._needs_support(name):
            supports = self._supports(plain, taken)
            projections = [
                Projection(self.vocabulary, (*focus, s), goal) for s in supports
            ] or projections
        return Part(self.vocabulary, projections, focus)

    def _supports(self, plain: Projection, taken: frozenset[str]) -> list[str]:
        """The objects, none of the goal's own, one of which the work cannot do without."""
        for stranger in sorted(plain.strangers):
            members = self.vocabulary.classes[stranger]
            if not any(member in taken for member in members):
                return members[:4]
        return []

    def _guard(self, name: str, atom: Atom, facts: int) -> Part | None:
        """A part that only tells whether an atom owned by another object is still possible."""
        key = (name, atom)
        if key not in self._guards:
            projection = Projection(self.vocabulary, (name,), frozenset([atom]))
            projection.distance(projection.node(facts))
            useful = projection.has_dead_ends
            self._guards[key] = Guard(self.vocabulary, [projection], ()) if useful else None
        return self._guards[key]


class Guard(Part):
    """A part without work of its own: DEAD, or nothing."""

    def _look(self, facts: int) -> tuple[float, int, dict[int, float] | None]:
        steps, _, _ = super()._look(facts)
        return (DEAD if steps >= DEAD else 0.0), 0, None


class Estimate:
    """The work left until one choice of objects meets the goal.

    `atoms` are the goal's under that choice, or some of them; `kept` is a mask of facts without
    which a state is worthless; `rules` come from `ordering.py`.
    """

    def __init__(
        self,
        bench: Workbench,
        binding: Binding,
        facts: int,
        atoms: list[Atom] | None = None,
        kept: int = 0,
    ) -> None:
        world = bench.world
        self.binding = binding
        atoms = world.goal.atoms(binding) if atoms is None else atoms
        self.rules: list[tuple[int, int]] = []
        self.parts = bench.parts(atoms, facts)
        self.goal = world.table.mask(atoms)
        self._kept = kept
        self._forecast = bench.forecast
        self._travel = bench.vocabulary.mean_travel
        self._wanted: dict[Effect, int] = {}
        self._rows = [(p.mask, p.known, p) for p in self.parts]
        self._idle_hands = _useless(bench.vocabulary, self.parts)

    def __call__(self, facts: int, timers: Timers) -> float:
        """Steps of work left; 0 only where the goal is met, DEAD or more where it cannot be."""
        if facts & self._kept != self._kept:
            return DEAD
        total = 0.0
        places = facts
        if timers.entries:
            forecast = self._forecast(facts, timers)
            facts = (facts | forecast.touched) ^ forecast.removed
            total = forecast.waiting
            if forecast.repeated:
                total -= self._repeated(forecast, facts)
        useful = 0
        for mask, known, part in self._rows:
            facts_about = facts & mask
            entry = known.get(facts_about) or part.entry(facts_about)
            steps, where, held = entry
            if held is None:
                useful |= where
                total += steps
            else:
                total += held.get(places & where, steps)
        total -= (places & useful).bit_count() * self._travel
        for late, early in self.rules:
            if facts & late == late and facts & early != early:
                total += REDOING
        held_mask = places & self._idle_hands
        if held_mask:
            total += HELD * held_mask.bit_count()
        return total

    def _repeated(self, forecast: Forecast, facts: int) -> float:
        """What is done already of repeated actions whose effect is wanted and not there yet."""
        credit = 0.0
        for effect, done in forecast.repeated:
            wanted = self._wanted.get(effect)
            if wanted is None:
                wanted = self._wanted[effect] = self._sets(effect, facts)
            if wanted & ~facts:
                credit += done
        return credit

    def _sets(self, effect: Effect, facts: int) -> int:
        """What an effect makes true, if that brings the goal nearer; else 0."""
        sets = 0
        for node in effect.counters():
            sets |= node.sets
        nearer = (part.distance(facts | sets) < part.distance(facts) for part in self.parts)
        return sets if any(nearer) else 0


def _useless(vocabulary: Vocabulary, parts: list[Part]) -> int:
    """The atoms between a player and a movable on which no work is left to do."""
    wanted = 0
    for part in parts:
        wanted |= part.mask
    table = vocabulary.world.table
    mask = 0
    for player in vocabulary.world.players:
        mask |= table.mentions(player)
    movable = 0
    for kind, names in table.by_type.items():
        if vocabulary.is_movable(kind):
            for name in names:
                movable |= table.mentions(name)
    return mask & movable & ~wanted
