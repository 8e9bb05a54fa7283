"""The heuristic of the beam search: the work left until the goal is met.

It adds up the distances of all objects of the goal in projections (`projection.py`), as if the
running timers had ended, and subtracts the performed part of repeated actions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from robotouille.planning.beam.domain_analysis import DomainAnalysis
from robotouille.planning.beam.projection import DEAD, Forecast, Forecaster, Projection
from robotouille.world.grounding.atoms import EXISTS, bits_of
from robotouille.world.grounding.effects import Effect
from robotouille.world.grounding.objects import Atom
from robotouille.world.timers import Timers
from robotouille.world.world import World

GoalBinding = dict[int | str, str]

Entry = tuple[float, int, "dict[int, float] | None"]

MAX_SUPPORTS = 4

HELD = 0.75
"""Cost, in errands, of putting down a useless object."""


REDOING = 2.0
"""Cost, in errands, of having done something before a part that has to come first."""


@dataclass
class GoalPart:
    """The work on one object: the largest of its distances in several projections.

    An entry of `known` is (steps, mask of places, held). If nobody holds the object, a player at
    one of the places saves a walk. Otherwise `held` contains the steps by the holder's place.
    """

    analysis: DomainAnalysis
    projections: list[Projection]
    owned: bool = True
    mask: int = 0
    known: dict[int, Entry] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for projection in self.projections:
            self.mask |= projection.mask

    @property
    def focus(self) -> tuple[str, ...]:
        """The object and its support."""
        return self.projections[0].focus.names

    @property
    def name(self) -> str:
        """The object of this part."""
        return next(iter(self.focus), "")

    @property
    def partners(self) -> tuple[str, ...]:
        """Objects to which this object has to be brought."""
        return self.projections[0].focus.partners if self.owned else ()

    @property
    def fixed(self) -> bool:
        """True if the goal determines the object's station."""
        return bool(self.projections[0].focus.stations)

    def entry(self, facts: int) -> Entry:
        """Return the entry for a state's facts."""
        facts &= self.mask
        found = self.known.get(facts)
        if found is None:
            found = self.known[facts] = self._look(facts)
        return found

    def distance(self, facts: int) -> float:
        """Return the distance for a player who comes from elsewhere."""
        return self.entry(facts)[0]

    def _look(self, facts: int) -> Entry:
        nodes = [(p, p.node(facts)) for p in self.projections]
        distances = [p.distance(node) for p, node in nodes]
        steps = max(distances)
        hardest = [pair for pair, d in zip(nodes, distances, strict=True) if d == steps]
        places = self.analysis.place_mask
        holder = self._holder(hardest[0][0], facts)
        if holder is None:
            near = set.intersection(*(set(p.near(node)) for p, node in hardest))
            mask = 0
            for station in near:
                mask |= places[station]
            return steps, mask, None
        own = self.analysis.places[holder]
        projection, node = hardest[0]
        return steps, own, {own & places[s]: d for s, d in projection.nearer(node).items()}

    def _holder(self, projection: Projection, facts: int) -> str | None:
        """Return the player in an atom about the focus, if any."""
        players = self.analysis.world.players
        atoms = self.analysis.world.table.atoms
        for position in bits_of(facts & projection.mask):
            for name in atoms[position][1:]:
                if name in players:
                    return name
        return None


class StoppedError(Exception):
    """The caller of a search asked it to stop."""


class HeuristicContext:
    """The projections of a world, created on demand and cached.

    Attributes:
        stop: Function of the current search that returns whether to stop.
        analysed: Number of parts of goals that were analysed so far.
    """

    stop: Callable[[], bool] | None = None
    analysed = 0

    def __init__(self, world: World) -> None:
        self.world = world
        self.analysis = DomainAnalysis(world)
        self.forecast = Forecaster(world)
        self._parts: dict[tuple[tuple[str, ...], frozenset[Atom], frozenset[Atom]], GoalPart] = {}
        self._supporters: dict[tuple[str, frozenset[Atom], frozenset[str]], list[str]] = {}
        self._size = 0

    def refresh(self) -> None:
        """Make room for every object that the goal may require to be created."""
        goal = self.world.goal
        for variable, kind in ((v.id, v.kind) for v in goal.variables.values()):
            wanted = sum(v.kind == kind for v in goal.variables.values())
            known = -1
            while known < len(goal.candidates(variable)) < wanted:
                known = len(goal.candidates(variable))
                self.world.make_room_for_another()
        # Earlier results miss the new atoms, so they are dropped.
        if self._size != len(self.world.table.atoms):
            self._size = len(self.world.table.atoms)
            self.analysis = DomainAnalysis(self.world)
            self.forecast = Forecaster(self.world)
            self._parts.clear()
            self._supporters.clear()

    def check_stop(self) -> None:
        """Raise StoppedError if the search has to stop. Everything cached stays valid."""
        if self.stop is not None and self.stop():
            raise StoppedError

    def parts(self, atoms: list[Atom], facts: int) -> list[GoalPart]:
        """Return the parts of a goal. Each atom belongs to the first movable object it mentions."""
        owned: dict[str, list[Atom]] = {}
        guests: dict[str, list[Atom]] = {}
        for atom in atoms:
            first, *others = self.analysis.movables_in(atom) or [""]
            owned.setdefault(first, []).append(atom)
            for other in others:
                guests.setdefault(other, []).append(atom)
        names = list(dict.fromkeys([*owned, *guests]))
        taken = frozenset(names)
        parts: list[GoalPart] = []
        made: list[list[GoalPart]] = []
        for name in names:
            goal, hosted = frozenset(owned.get(name, ())), frozenset(guests.get(name, ()))
            options = [
                self._part((name, s) if s else (name,), goal, hosted)
                for s in self._supports(name, goal, taken)
            ]
            if len(options) > 1:
                made.append(options)
            elif name in owned or self._can_fail(options[0], facts):
                parts.append(options[0])
        return parts + _share(made, facts)

    def _part(
        self, names: tuple[str, ...], goal: frozenset[Atom], hosted: frozenset[Atom]
    ) -> GoalPart:
        key = (names, goal, hosted)
        part = self._parts.get(key)
        if part is None:
            # In a kitchen with a hundred equal objects, a part takes a hundredth of a second.
            self.check_stop()
            focus = tuple(name for name in names if name)
            guests: list[Atom | None] = [*sorted(hosted)] or [None]
            projections = [Projection(self.analysis, focus, goal, guest) for guest in guests]
            part = self._parts[key] = GoalPart(self.analysis, projections, bool(goal))
            self.analysed += 1
        return part

    def _can_fail(self, part: GoalPart, facts: int) -> bool:
        part.distance(facts)
        return any(projection.has_dead_ends for projection in part.projections)

    def _supports(self, name: str, goal: frozenset[Atom], taken: frozenset[str]) -> list[str]:
        """Return objects outside the goal that the work needs (any one suffices), or [""].

        The search applies only to objects that do not exist yet. Objects from which the object can
        be made come first.
        """
        if name and (EXISTS, name) not in self.world.table.bit:
            return [""]
        key = (name, goal, taken)
        found = self._supporters.get(key)
        if found is None:
            plain = Projection(self.analysis, (name,) if name else (), goal)
            found = [""]
            for placeholder in sorted(
                plain.placeholders, key=lambda s: (s not in plain.sources, s)
            ):
                members = self.analysis.classes[placeholder]
                if not any(member in taken for member in members):
                    found = members[:MAX_SUPPORTS]
                    break
            self._supporters[key] = found
        return found


def _share(made: list[list[GoalPart]], facts: int) -> list[GoalPart]:
    """Return one option of each list, with different supports while that is possible."""
    chosen: list[GoalPart] = []
    used: set[str] = set()
    for options in sorted(made, key=lambda options: min(p.distance(facts) for p in options)):
        # Two objects share a support if one of them no longer needs it: soup that is in its bowl
        # needs no pot.
        unused = [p for p in options if p.focus[-1] not in used]
        free = [p for p in unused if p.distance(facts) < DEAD] or options
        best = min(free, key=lambda p: p.distance(facts))
        used.add(best.focus[-1])
        chosen.append(best)
    return chosen


class RemainingWork:
    """The work left until one choice of objects meets the goal.

    `atoms` are the goal's atoms under that choice, or some of them. `rules` come from
    `goal_ordering.py`. `kept` is a mask of facts without which a state is worthless.
    """

    def __init__(
        self,
        context: HeuristicContext,
        binding: GoalBinding,
        facts: int,
        rules: Mapping[str, tuple[int, int]] | None = None,
        atoms: list[Atom] | None = None,
        kept: int = 0,
    ) -> None:
        world = context.world
        self.binding = binding
        atoms = world.goal.atoms(binding) if atoms is None else atoms
        rules = rules or {}
        self.parts = context.parts(atoms, facts)
        self.check_stop = context.check_stop
        self.goal = world.table.mask(atoms)
        self._kept = kept
        self._rules = list(rules.values())
        self._forecast = context.forecast
        self._travel = context.analysis.mean_travel
        self._errand = context.analysis.errand
        self._wanted: dict[Effect, int] = {}
        self._rows = [
            (p.mask, p.known, p, rules.get(p.name, (0, 0))[1], _meetings(p, self.parts, context))
            for p in self.parts
        ]
        self._hands = _hands(context.analysis)
        self._idle_hands = _useless(context.analysis, self.parts)

    def __call__(self, facts: int, timers: Timers, chain: float = 0.0) -> float:
        """Return the steps of work left, or DEAD or more if the goal cannot be met any more.

        `chain` is the additional weight of the object with most work left. That work cannot be
        shared, so a positive weight accounts for the time a team needs.
        """
        if facts & self._kept != self._kept:
            return DEAD
        now = facts
        total = 0.0
        if timers.entries:
            forecast = self._forecast(facts, timers)
            facts = (facts | forecast.touched) ^ forecast.removed
            total = forecast.waiting
            if forecast.repeated:
                total -= self._repeated(forecast, facts)
        for _, steps_busy in timers.busy:
            total += steps_busy
        useful = 0
        longest = 0.0
        for mask, known, part, early, meetings in self._rows:
            about = facts & mask
            steps, where, held = known.get(about) or part.entry(about)
            total += steps
            longest = max(longest, steps)
            if held is None:
                useful |= where
            elif facts & early == early:
                place = now & where
                total += held.get(place, steps) - steps
                if meetings and not any(now & at and place & there for at, there in meetings):
                    total += self._travel
        total += chain * longest
        if useful:
            for places, hold in self._hands:
                if now & hold:
                    useful &= ~places
            total -= (now & useful).bit_count() * self._travel
        for late, early in self._rules:
            if facts & late == late and facts & early != early:
                total += REDOING * self._errand
        useless = now & self._idle_hands
        if useless:
            total += HELD * self._errand * useless.bit_count()
        return total

    def _repeated(self, forecast: Forecast, facts: int) -> float:
        """Return the performances of repeated actions whose effect is wanted and still missing."""
        credit = 0.0
        for effect, done in forecast.repeated:
            wanted = self._wanted.get(effect)
            if wanted is None:
                wanted = self._wanted[effect] = self._sets(effect, facts)
            if wanted & ~facts:
                credit += done
        return credit

    def _sets(self, effect: Effect, facts: int) -> int:
        """Return the facts that an effect makes true if they bring the goal nearer, else 0."""
        sets = 0
        for node in effect.counters():
            sets |= node.sets
        nearer = (part.distance(facts | sets) < part.distance(facts) for part in self.parts)
        return sets if any(nearer) else 0


def _hands(analysis: DomainAnalysis) -> list[tuple[int, int]]:
    """Return for each player the masks of its places and of the objects it can hold."""
    movable = _about_movables(analysis)
    mentions = analysis.world.table.mentions
    return [(analysis.places[p], mentions(p) & movable) for p in analysis.world.players]


def _about_movables(analysis: DomainAnalysis) -> int:
    table = analysis.world.table
    mask = 0
    for kind, names in table.by_type.items():
        if analysis.is_movable(kind):
            for name in names:
                mask |= table.mentions(name)
    return mask


def _useless(analysis: DomainAnalysis, parts: list[GoalPart]) -> int:
    """Return the atoms in which a player holds an object without work left."""
    mask = 0
    for _, hold in _hands(analysis):
        mask |= hold
    for part in parts:
        mask &= ~part.mask
    return mask


def _meetings(
    part: GoalPart, parts: list[GoalPart], context: HeuristicContext
) -> list[tuple[int, int]]:
    """Return the places of an object's partner, if the object has to be brought to it.

    Each pair of masks contains the partner at a station and a player at that station.
    """
    analysis = context.analysis
    if part.fixed or not part.partners:
        return []
    others = {n for p in parts if p.name in part.partners for n in p.focus} | set(part.partners)
    table = context.world.table
    pairs = []
    for station in analysis.stations:
        about = 0
        for name in sorted(others):
            about |= table.mentions(name) & table.mentions(station)
        pairs.append((about, analysis.place_mask[station]))
    return pairs
