"""Work: what has to be done first, what is going on, and which actions still change something.

The work is read from a domain's special effects, which take time or repetitions. Actions with an
immediate result, such as putting an object down, need no mention.

Actions whose effects already hold are valid but do nothing, such as cutting what is cut. Work whose
result already holds never ends. People are offered and shown neither; the rules allow both.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

from robotouille.domain.schema import Condition, Conditional, CreatedObject, Creation, EffectDef
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.effects import HOLDING, Effect, EffectNode
from robotouille.world.scene import scene
from robotouille.world.timers import Progress
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World


@dataclass(frozen=True, slots=True)
class Work:
    """Action that makes a fact true, with the parameters the fact decides.

    `places` are the stations where the action can be done; empty if any station will do.
    """

    schema: ActionSchema
    binding: Mapping[str, str]
    places: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Maker:
    """Action that makes a fact true later, with that effect's conditions and created object."""

    schema: ActionSchema
    fact: Condition
    needs: tuple[Condition, ...]
    created: CreatedObject | None


class Preparation:
    """Index of the work in one world. `preparation_of` caches the index of each world."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._table = world.table

    def creates(self, type_name: str) -> bool:
        """Return whether some work creates objects of a type."""
        return type_name in self._created

    def can_become(self, predicate: str, objects: Sequence[str]) -> bool:
        """Return whether any action can make a fact true."""
        at_once = any(
            effect.predicate == predicate and effect.is_true
            for schema in self._world.schemas
            for effect in schema.definition.immediate_fx
        )
        return at_once or any(self._bindings(predicate, objects))

    def work_for(self, predicate: str, objects: Sequence[str | None]) -> Work | None:
        """Return the work that makes a fact true, or None.

        Args:
            objects: Objects of the fact. None stands for the object that the work creates.
        """
        for maker, binding in self._bindings(predicate, objects):
            return Work(maker.schema, binding, tuple(self._places(maker.schema, binding)))
        return None

    def is_under_way(self, state: State, work: Work) -> bool:
        """Return whether work has been started and continues without a player."""
        things = set(work.binding.values())
        return any(
            row.action == work.schema.name and row.running and row.timed
            and things <= {row.subject, *row.arguments}
            for row in state.progress()
        )  # fmt: skip

    @cached_property
    def _makers(self) -> tuple[_Maker, ...]:
        return tuple(maker for schema in self._world.schemas for maker in _makers_of(schema))

    @cached_property
    def _created(self) -> frozenset[str]:
        return frozenset(each.created.type for each in self._makers if each.created)

    def _bindings(
        self, predicate: str, objects: Sequence[str | None]
    ) -> Iterator[tuple[_Maker, dict[str, str]]]:
        """Yield the makers of a fact, with the parameters that the fact decides."""
        for maker in self._makers:
            fact, made = maker.fact, maker.created
            if fact.predicate != predicate or len(fact.params) != len(objects):
                continue
            binding: dict[str, str] = {}
            fits = True
            for parameter, name in zip(fact.params, objects, strict=True):
                if made is not None and parameter == made.param:
                    fits &= name is None or self._world.thing(name).kind == made.name
                elif name is None:
                    fits = False
                else:
                    binding[parameter] = name
            if fits and self._may_be_done(maker, binding):
                yield maker, binding

    def _may_be_done(self, maker: _Maker, binding: Mapping[str, str]) -> bool:
        """Return whether no static condition rules the work out."""
        for condition in (*maker.schema.definition.precons, *maker.needs):
            if condition.predicate not in self._table.static_predicates:
                continue
            if all(parameter in binding for parameter in condition.params):
                atom = (condition.predicate, *(binding[each] for each in condition.params))
                if (atom in self._table.static) != condition.is_true:
                    return False
        return True

    def _places(self, schema: ActionSchema, binding: Mapping[str, str]) -> Iterator[str]:
        """Yield the stations for an action that needs a particular kind of station."""
        stations = self._world.floor.stations
        needs = {
            each.predicate
            for each in schema.definition.precons
            if each.predicate in self._table.static_predicates
            and each.is_true and len(each.params) == 1 and each.params[0] not in binding
        }  # fmt: skip
        for name in stations:
            if any((predicate, name) in self._table.static for predicate in needs):
                yield name


@lru_cache(maxsize=8)
def preparation_of(world: World) -> Preparation:
    """Return the index of a world's work."""
    return Preparation(world)


def _makers_of(schema: ActionSchema) -> Iterator[_Maker]:
    def within(
        effects: Iterable[EffectDef], needs: tuple[Condition, ...], made: CreatedObject | None
    ) -> Iterator[_Maker]:
        for effect in effects:
            more = needs + (effect.conditions if isinstance(effect, Conditional) else ())
            new = effect.created_obj if isinstance(effect, Creation) else made
            for fact in effect.fx:
                if fact.is_true:
                    yield _Maker(schema, fact, more, new)
            yield from within(effect.sfx, more, new)

    yield from within(schema.definition.sfx, (), None)


class Occupancy:
    """Rules of a domain about standing at stations."""

    def __init__(self, world: World) -> None:
        self._world = world

    def is_about_standing(self, predicate: str) -> bool:
        """Return whether a predicate says that a player, or no player, stands somewhere."""
        return predicate in self._standing or predicate in self._free

    def needed_free(self, unmet: Unmet) -> str | None:
        """Return the station that must be free, if that is what the condition asks for."""
        if unmet.kind is not UnmetKind.CONDITION or len(unmet.objects) != 1:
            return None
        return unmet.objects[0] if self._free.get(unmet.predicate) == unmet.expected else None

    def players_at(self, state: State, station: str) -> list[str]:
        """Return the players that stand at a station."""
        return [name for name, each in scene(state).items() if each.at == station]

    @cached_property
    def _standing(self) -> frozenset[str]:
        layout = self._world.task.domain.layout or ()
        return frozenset(rule.predicate for rule in layout if rule.when == "faces")

    @cached_property
    def _free(self) -> dict[str, bool]:
        """Return the station predicates that a walk changes, with their values before the walk."""
        found: dict[str, bool] = {}
        for schema in self._world.schemas:
            travel = schema.definition.travel
            for effect in schema.definition.immediate_fx if travel else ():
                if travel and effect.params == (travel[1],):
                    found[effect.predicate] = not effect.is_true
        return found


def changes_something(state: State, action: GroundAction) -> bool:
    """Return whether an action changes the state, now or later.

    Actions without any effects, such as waiting, count as useful: they are meant to do nothing.
    """
    facts = state.facts
    if (facts | action.touched) ^ action.removed != facts:
        return True
    if not action.effects:
        return not action.schema.definition.immediate_fx
    # Starting an effect again that is already running does nothing, unless it counts repetitions.
    running = {effect for effect, counters in state.timers.entries if _runs(effect, counters)}
    return any(
        _leads_on(effect.root, facts)
        for effect in action.effects
        if effect not in running or _repeats(effect.root)
    )


def useful_actions(state: State, player: str) -> tuple[GroundAction, ...]:
    """Return the useful actions of a player, in the order of `State.actions`."""
    return tuple(a for a in state.actions(player) if changes_something(state, a))


def work_in_progress(state: State) -> tuple[Progress, ...]:
    """Return the progress of all work that still changes something."""
    going_on = {
        (effect.label[0], effect.label[2])
        for effect, _ in state.timers.entries
        if any(_leads_on(node, state.facts) for node in effect.counters())
    }
    return tuple(row for row in state.progress() if (row.action, row.arguments) in going_on)


def work_towards(state: State) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield the facts that current work will make true, each with the share that is done."""
    far = {(row.action, row.arguments): row.done / max(1, row.total) for row in state.progress()}
    for effect, _ in state.timers.entries:
        share = far.get((effect.label[0], effect.label[2]))
        if share is not None:
            news = _sets(effect.root) & ~state.facts
            yield from ((state.world.table.atoms[bit], share) for bit in bits_of(news))


def _sets(node: EffectNode) -> int:
    facts = node.sets
    for nested in node.nested:
        facts |= _sets(nested)
    return facts


def _runs(effect: Effect, counters: tuple[int, ...]) -> bool:
    """Return whether an effect is active; a conditional one is not while its condition fails."""
    return not effect.root.pauses or counters[effect.root.slot] == HOLDING


def _repeats(node: EffectNode) -> bool:
    return node.counts == "performances" or any(map(_repeats, node.nested))


def _leads_on(node: EffectNode, facts: int) -> bool:
    """Return whether an effect tree still has something to change.

    Facts that a conditional effect asserts are not its purpose if other effects are nested in it.
    """
    if not node.possible:
        return False
    # Creating or deleting an object always changes something.
    if node.instant:
        return True
    if node.nested and node.pauses:
        return any(_leads_on(child, facts) for child in node.nested)
    news = node.sets & ~facts or node.clears & facts
    return bool(news) or any(_leads_on(child, facts) for child in node.nested)
