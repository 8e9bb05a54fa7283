"""Operators of a projection: actions from the point of view of one object.

A projection keeps the atoms about its *focus* (one object, perhaps with its support) and whether
stations of its goal are free. Every other movable object is replaced by a placeholder for its
class, and every player by one for its crew. Delayed and repeated effects count as part of their
action, at a cost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import product

from robotouille.domain.schema import Condition, Creation, Deletion, EffectDef
from robotouille.planning.beam.domain_analysis import DomainAnalysis, creates
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.objects import Atom

WAITING = 0.4
"""Cost of one step of a delay. Players do other work in the meantime, so it is below 1."""

DISTURBING = 1.5
"""Cost, in errands, of moving another object out of the way: it needs a new place."""

Binding = dict[str, str]


@dataclass(frozen=True, slots=True)
class OperatorOutcome:
    """Facts that change if those in `holds` are true and those in `lacks` are false.

    All facts about the object `deleted` are cleared.
    """

    holds: int
    lacks: int
    clears: int
    sets: int
    deleted: str = ""


@dataclass(frozen=True, slots=True)
class Operator:
    """An action of a projection: its condition, its outcomes and its cost in steps.

    `place` is the station of its player. `placeholders` are the placeholders it needs.
    """

    place: str | None
    cost: float
    condition: OperatorOutcome
    outcomes: tuple[OperatorOutcome, ...]
    placeholders: tuple[str, ...]

    def apply(self, node: int) -> int:
        """Return the facts after the operator."""
        node = (node & ~self.condition.clears) | self.condition.sets
        for outcome in self.outcomes:
            if node & outcome.holds == outcome.holds and not node & outcome.lacks:
                node = (node & ~outcome.clears) | outcome.sets
        return node


@dataclass
class Focus:
    """The subject of a projection and the numbering of its atoms.

    `names` are distinguished and tracked. `partners` are distinguished from other movables because
    the goal names them. The facts of `stations` are tracked too. `guests` are atoms of the goal
    that are a partner's work and cost nothing here.
    """

    analysis: DomainAnalysis
    names: tuple[str, ...]
    partners: tuple[str, ...]
    stations: frozenset[str]
    guests: tuple[Atom, ...] = ()
    bits: dict[Atom, int] = field(default_factory=dict)
    _looked_at: dict[Atom, int] = field(default_factory=dict, repr=False, compare=False)

    def abstract(self, atom: Atom) -> Atom:
        """Return an atom with placeholders for objects that are not distinguished."""
        return (atom[0], *(self.placeholder_for(name) for name in atom[1:]))

    def placeholder_for(self, name: str) -> str:
        analysis = self.analysis
        if name in self.names or name in self.partners:
            return name
        kind = analysis.type_of(name)
        if kind in analysis.player_types:
            return analysis.crew_of(name)
        return analysis.class_of(name) if analysis.is_movable(kind) else name

    def tracks(self, atom: Atom) -> bool:
        """Return whether an abstract atom is part of the projection. Static atoms never are."""
        if atom[0] in self.analysis.world.table.static_predicates:
            return False
        if any(name in self.names for name in atom[1:]):
            return True
        return atom[0] not in self.analysis.walked and all(n in self.stations for n in atom[1:])

    def mask(self, atoms: Iterable[Atom]) -> int:
        """Return the bits of the tracked atoms. New atoms get the next number."""
        total = 0
        for atom in atoms:
            bit = self._looked_at.get(atom)
            if bit is None:
                bit = self.bits.setdefault(atom, 1 << len(self.bits)) if self.tracks(atom) else 0
                self._looked_at[atom] = bit
            total |= bit
        return total


def operators(focus: Focus, goal: int) -> list[Operator]:
    """Return every action that matters to a projection and its goal, a mask of its facts."""
    found: dict[Operator, None] = {}
    for schema in focus.analysis.world.schemas:
        if schema.name in focus.analysis.walking:
            continue
        for binding in _bindings(schema, focus):
            operator = _operator(schema, binding, focus)
            if operator is not None:
                found[operator] = None
    return _useful([_with_deletions(operator, focus) for operator in found], goal)


def _useful(found: list[Operator], goal: int) -> list[Operator]:
    """Return the operators that can help towards a goal, reduced to the facts that matter."""
    wanted, before = goal, 0
    while wanted != before:
        before = wanted
        for operator in found:
            changes = (operator.condition, *operator.outcomes)
            if any((o.sets | o.clears) & wanted for o in changes):
                for o in changes:
                    wanted |= o.holds | o.lacks
    reduced: dict[Operator, None] = {}
    for operator in found:
        condition = _reduce(operator.condition, wanted)
        outcomes = tuple(_reduce(o, wanted) for o in operator.outcomes)
        if any(o.sets or o.clears for o in (condition, *outcomes)):
            reduced[replace(operator, condition=condition, outcomes=outcomes)] = None
    return list(reduced)


def _reduce(outcome: OperatorOutcome, wanted: int) -> OperatorOutcome:
    return replace(outcome, clears=outcome.clears & wanted, sets=outcome.sets & wanted)


def _with_deletions(operator: Operator, focus: Focus) -> Operator:
    """Return the operator with the facts of deleted objects cleared."""
    # This comes last, when all atoms have numbers.
    if not any(outcome.deleted for outcome in operator.outcomes):
        return operator
    outcomes = []
    for outcome in operator.outcomes:
        about = sum(bit for atom, bit in focus.bits.items() if outcome.deleted in atom[1:])
        outcomes.append(replace(outcome, clears=outcome.clears | about, deleted=""))
    return replace(operator, outcomes=tuple(outcomes))


def _bindings(schema: ActionSchema, focus: Focus) -> Iterator[Binding]:
    analysis = focus.analysis
    pools = []
    for _, kind in schema.parameters:
        if kind in analysis.player_types:
            of_kind = analysis.world.table.by_type[kind]
            pools.append([c for c, crew in analysis.crews.items() if set(of_kind) & set(crew)])
        elif kind in analysis.station_types:
            pools.append([s for s in analysis.stations if analysis.type_of(s) == kind])
        else:
            known = [n for n in focus.names + focus.partners if analysis.type_of(n) == kind]
            own = {analysis.class_of(n) for n in focus.names[1:]}
            others = (c for c in analysis.classes_of(kind) if c not in own)
            pools.append(known + [c for c in others if set(analysis.classes[c]) - set(known)])
    names = [name for name, _ in schema.parameters]
    creating = creates(schema)
    for values in product(*pools):
        exact = [v for v in values if v in focus.names or v in focus.partners]
        near = creating or any(v in focus.names or v in focus.stations for v in values)
        if near and len(set(exact)) == len(exact):
            binding = dict(zip(names, values, strict=True))
            possible = analysis.can_stand(schema.definition.precons, binding)
            if possible and all(
                analysis.static_holds(c, binding) for c in _static(schema, analysis)
            ):
                yield binding


def _static(schema: ActionSchema, analysis: DomainAnalysis) -> list[Condition]:
    static = analysis.world.table.static_predicates
    return [c for c in schema.definition.precons if c.predicate in static]


def _operator(schema: ActionSchema, binding: Binding, focus: Focus) -> Operator | None:
    definition = schema.definition
    placeholders = tuple(v for v in binding.values() if v.startswith("*"))
    exist = [(EXISTS, n) for n in binding.values() if n in focus.names and _transient(focus, n)]
    condition = OperatorOutcome(
        focus.mask([*exist, *_atoms(definition.precons, binding, True)]),
        focus.mask(a for a in _atoms(definition.precons, binding, False) if not _vague(a)),
        focus.mask(_atoms(definition.immediate_fx, binding, False)),
        focus.mask(_atoms(definition.immediate_fx, binding, True)),
    )
    outcomes: list[OperatorOutcome] = []
    cost = 1.0
    if definition.sfx:
        action = _example(schema, binding, focus)
        cost = float(action.duration)
        for i, effect in enumerate(definition.sfx):
            found = _outcomes(effect, binding, focus, OperatorOutcome(0, 0, 0, 0))
            outcomes += found
            cost += (
                _price(action, i) if any(o.sets or o.clears or o.deleted for o in found) else 0.0
            )
    place = _place(schema, binding, focus)
    if not _handles(definition.precons + definition.immediate_fx, binding, focus):
        if condition.sets & focus.mask(focus.guests):
            place, cost = None, 0.0
        elif placeholders:
            cost += DISTURBING * focus.analysis.errand
    touched = condition.sets | condition.clears
    if not touched and not any(o.sets or o.clears or o.deleted for o in outcomes):
        return None
    return Operator(place, cost, condition, tuple(outcomes), placeholders)


def _handles(conditions: tuple[Condition, ...], binding: Binding, focus: Focus) -> bool:
    """Return whether a player handles the focus itself, not an object next to it."""
    atoms = ({binding[name] for name in c.params} for c in conditions)
    crews = focus.analysis.crews.keys()
    return any(names & crews and names & set(focus.names) for names in atoms)


def _vague(atom: Atom) -> bool:
    """Return whether an atom is about any one of several objects. Its absence says little."""
    return any(name.startswith("*") for name in atom[1:])


def _transient(focus: Focus, name: str) -> bool:
    return (EXISTS, name) in focus.analysis.world.table.bit


def _atoms(conditions: Iterable[Condition], binding: Binding, is_true: bool) -> list[Atom]:
    return [
        (c.predicate, *(binding[name] for name in c.params))
        for c in conditions
        if c.is_true == is_true
    ]


def _place(schema: ActionSchema, binding: Binding, focus: Focus) -> str | None:
    for c in schema.definition.precons:
        if c.is_true and c.predicate in focus.analysis.place_predicates:
            for name in c.params:
                if binding[name] in focus.analysis.stations:
                    return binding[name]
    return None


def _outcomes(
    effect: EffectDef, binding: Binding, focus: Focus, given: OperatorOutcome
) -> list[OperatorOutcome]:
    """Return the final changes of a special effect."""
    if isinstance(effect, Creation):
        born = [n for n in focus.names if _can_be(n, effect, focus)]
        if not born:
            return []
        binding = {**binding, effect.created_obj.param: born[0]}
        sets = focus.mask([(EXISTS, born[0]), *_atoms(effect.fx, binding, True)])
        lacks = given.lacks | focus.mask([(EXISTS, born[0])])
        clears = focus.mask(_atoms(effect.fx, binding, False))
        return [OperatorOutcome(given.holds, lacks, clears, sets)]
    conditions = getattr(effect, "conditions", ())
    static = focus.analysis.world.table.static_predicates
    for c in conditions:
        if c.predicate in static and not focus.analysis.static_holds(c, binding):
            return []
    given = OperatorOutcome(
        given.holds | focus.mask(_atoms(conditions, binding, True)),
        given.lacks | focus.mask(a for a in _atoms(conditions, binding, False) if not _vague(a)),
        0,
        0,
    )
    clears = focus.mask(_atoms(effect.fx, binding, False))
    sets = focus.mask(_atoms(effect.fx, binding, True))
    gone = binding[effect.param] if isinstance(effect, Deletion) else ""
    gone = gone if gone in focus.names else ""
    found = [OperatorOutcome(given.holds, given.lacks, clears, sets, gone)]
    for nested in effect.sfx:
        found += _outcomes(nested, binding, focus, given)
    return found


def _can_be(name: str, effect: Creation, focus: Focus) -> bool:
    thing = focus.analysis.world.thing(name)
    created = effect.created_obj
    return (thing.kind, thing.type, thing.tile) == (created.name, created.type, None)


def _price(action: GroundAction, effect: int) -> float:
    """Return the additional cost of one special effect of an action."""
    price = 0.0
    for node in action.effects[effect].counters():
        if node.counts == "steps":
            price += WAITING * (node.total - 1)
        else:
            price += float((node.total - 1) * action.duration)
    return price


def _example(schema: ActionSchema, binding: Binding, focus: Focus) -> GroundAction:
    """Return one of the ground actions that an operator stands for."""
    analysis = focus.analysis
    arguments = []
    for name, kind in schema.parameters:
        value = binding[name]
        if value in analysis.crews:
            table = analysis.world.table
            value = next(p for p in analysis.crews[value] if p in table.by_type[kind])
        arguments.append(analysis.classes.get(value, [value])[0])
    return analysis.world.action(schema.name, *arguments)
