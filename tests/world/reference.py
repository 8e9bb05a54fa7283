"""Slow, obvious implementation of docs/episodes.md; the reference for the fast one.

Facts are tuples of strings in a set, timers are nested objects, grounding tries every choice of
objects and the goal every assignment. Nothing here comes from `robotouille.world` but the names
of the objects of a problem and the facts that their positions imply.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from string import Formatter
from typing import Any

from robotouille import Task
from robotouille.domain.derived import parameter_types
from robotouille.domain.schema import ActionDef, Condition, EffectDef
from robotouille.world.grounding.objects import initial_facts, place_objects
from tests.world.reference_floor import distance

Fact = tuple[str, ...]
Binding = dict[str, str]
Literal = tuple[Fact, bool]
Call = tuple[str, tuple[str, ...]]
"""An action's name and its arguments."""


@dataclass
class Progress:
    """Progress of one node of an effect; -1 when it has completed."""

    definition: EffectDef
    count: int = 0
    nested: list[Progress] = field(default_factory=list)

    def copy(self) -> Progress:
        return Progress(self.definition, self.count, [child.copy() for child in self.nested])

    def row(self) -> list[int]:
        return [self.count, *(number for child in self.nested for number in child.row())]


@dataclass
class Timer:
    """An active effect with its arguments."""

    action: str
    index: int
    arguments: tuple[str, ...]
    binding: Binding
    root: Progress


@dataclass
class ReferenceState:
    facts: set[Fact]
    objects: dict[str, tuple[str, str]]
    created: Counter[str]
    timers: list[Timer] = field(default_factory=list)
    busy: dict[str, int] = field(default_factory=dict)

    def copy(self) -> ReferenceState:
        timers = [replace(t, root=t.root.copy()) for t in self.timers]
        return ReferenceState(
            set(self.facts), dict(self.objects), Counter(self.created), timers, dict(self.busy)
        )

    def timer_rows(self) -> list[tuple[str, int, tuple[str, ...], tuple[int, ...]]]:
        return [(t.action, t.index, t.arguments, tuple(t.root.row())) for t in self.timers]


class Reference:
    """The Markov decision process of a task."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.domain = task.domain
        self.placed = place_objects(task)
        self.players = [o.name for o in self.placed if o.type in self.domain.player_types]
        self.numbers = Counter(o.kind for o in self.placed)
        self.order = {o.name: (0, i, "") for i, o in enumerate(self.placed)}
        self.kinds = {o.name: o.kind for o in self.placed}
        self.predicates = {p.name: p for p in self.domain.predicate_defs}
        self.actions = {a.name: a for a in self.domain.action_defs}
        self.grounded: dict[tuple[str, ...], list[tuple[Call, str | None, list[Literal]]]] = {}
        self.initial = ReferenceState(
            facts=set(initial_facts(task, self.placed)),
            objects={o.name: (o.kind, o.type) for o in self.placed},
            created=Counter(),
        )

    # Actions

    def parameters(self, action: ActionDef) -> list[tuple[str, str]]:
        """Its player first, then as its sentence says them, then as its conditions do."""
        types = parameter_types(action, self.predicates)
        actors = [n for n, kind in types.items() if kind in self.domain.player_types][:1]
        said = [n for _, n, _, _ in Formatter().parse(action.language_description) if n in types]
        return [(n, types[n]) for n in dict.fromkeys([*actors, *said, *types])]

    def actor(self, call: Call) -> str | None:
        parameters = self.parameters(self.actions[call[0]])
        has_one = parameters and parameters[0][1] in self.domain.player_types
        return call[1][0] if has_one else None

    def binding(self, call: Call) -> Binding:
        names = [name for name, _ in self.parameters(self.actions[call[0]])]
        return dict(zip(names, call[1], strict=True))

    def applies(self, state: ReferenceState, call: Call, player: str) -> bool:
        """Return whether the player may take the action now."""
        return (
            (self.actor(call) or player) not in state.busy
            and all(name in state.objects for name in call[1])
            and all((fact in state.facts) == true for fact, true in self.preconditions(call))
        )

    def ground(self, state: ReferenceState) -> list[tuple[Call, str | None, list[Literal]]]:
        """Every action with every choice of objects that exist: its actor and preconditions."""
        names = tuple(sorted(state.objects, key=self.order.__getitem__))
        if names not in self.grounded:
            self.grounded[names] = [
                (call, self.actor(call), self.preconditions(call))
                for action in self.domain.action_defs
                for call in product(
                    [action.name],
                    product(
                        *(
                            [n for n in names if state.objects[n][1] == kind]
                            for _, kind in self.parameters(action)
                        )
                    ),
                )
            ]
        return self.grounded[names]

    def preconditions(self, call: Call) -> list[Literal]:
        binding = self.binding(call)
        return [(bind(c, binding), c.is_true) for c in self.actions[call[0]].precons]

    def valid(self, state: ReferenceState, player: str) -> list[Call]:
        if player in state.busy:
            return []
        return [
            call
            for call, actor, preconditions in self.ground(state)
            if actor in (None, player)
            and all((fact in state.facts) == is_true for fact, is_true in preconditions)
        ]

    # Steps

    def step(
        self, state: ReferenceState, joint: Sequence[tuple[str, Call]]
    ) -> tuple[ReferenceState, list[bool]]:
        """Return the state after a joint action, and whether each action was applied."""
        state = state.copy()
        acted: set[str] = set()
        applied = []
        for player, call in joint:
            actor = self.actor(call) or player
            applied.append(actor not in acted and self.applies(state, call, player))
            if applied[-1]:
                acted.add(actor)
                self.apply(state, call)
        for timer in list(state.timers):
            if any(timer is other for other in state.timers):
                self.update(state, timer.root, timer.binding, active=False)
        state.timers = [t for t in state.timers if t.root.count != -1]
        state.busy = {player: steps - 1 for player, steps in state.busy.items() if steps > 1}
        return state, applied

    def apply(self, state: ReferenceState, call: Call) -> None:
        action, binding = self.actions[call[0]], self.binding(call)
        self.make(state, action.immediate_fx, binding)
        actor, duration = self.actor(call), self.duration(action, binding)
        if actor is not None and duration > 1:
            state.busy[actor] = duration
        for index, effect in enumerate(action.sfx):
            if any(binding[n] not in state.objects for n in variables(effect) if n in binding):
                continue
            timer = self.start(state, action.name, index, effect, binding)
            self.update(state, timer.root, timer.binding, active=True)

    def duration(self, action: ActionDef, binding: Binding) -> int:
        steps = 1
        if self.task.timing == "people":
            if action.travel is not None:
                here, there = (binding[name] for name in action.travel)
                steps = max(1, distance(self.task, self.players, self.placed, here, there))
            if any(e.type == "repetitive" for e in walk(action.sfx)):
                steps = max(steps, 2)
        return steps

    # Effects

    def start(
        self, state: ReferenceState, name: str, index: int, effect: EffectDef, binding: Binding
    ) -> Timer:
        """Return the active timer of an effect with these arguments, or a new one."""
        arguments = tuple(binding[n] for n in dict.fromkeys(variables(effect)) if n in binding)
        for timer in state.timers:
            if (timer.action, timer.index, timer.arguments) == (name, index, arguments):
                return timer
        timer = Timer(name, index, arguments, dict(binding), progress(effect))
        state.timers.append(timer)
        return timer

    def update(
        self, state: ReferenceState, node: Progress, binding: Binding, *, active: bool
    ) -> bool:
        """One update of one node; whether it has completed."""
        if node.count == -1:
            return True
        update = getattr(self, f"update_{node.definition.type}")
        if update(state, node, binding, active):
            node.count = -1
        return node.count == -1

    def update_nested(
        self, state: ReferenceState, node: Progress, binding: Binding, active: bool
    ) -> bool:
        finished = [self.update(state, child, binding, active=active) for child in node.nested]
        return all(finished)

    def update_conditional(
        self, state: ReferenceState, node: Progress, binding: Binding, active: bool
    ) -> bool:
        effect: Any = node.definition
        if all((bind(c, binding) in state.facts) == c.is_true for c in effect.conditions):
            node.count = 1
            self.make(state, effect.fx, binding)
            return self.update_nested(state, node, binding, active)
        if node.count == 1:
            node.count = 0
            self.make(state, effect.fx, binding, negated=True)
        return False

    def update_delayed(
        self, state: ReferenceState, node: Progress, binding: Binding, active: bool
    ) -> bool:
        factor = 5 if self.task.timing == "people" else 1
        needed = self.configured(state, node.definition, binding) * factor + 1
        return self.count_up(state, node, binding, active, needed, counts=not active)

    def update_repetitive(
        self, state: ReferenceState, node: Progress, binding: Binding, active: bool
    ) -> bool:
        needed = max(1, self.configured(state, node.definition, binding))
        return self.count_up(state, node, binding, active, needed, counts=active)

    def count_up(
        self,
        state: ReferenceState,
        node: Progress,
        binding: Binding,
        active: bool,
        needed: int,
        counts: bool,
    ) -> bool:
        if node.count < needed:
            if not counts:
                return False
            node.count += 1
            if node.count < needed:
                return False
            self.make(state, node.definition.fx, binding)
        return self.update_nested(state, node, binding, active)

    def configured(self, state: ReferenceState, effect: Any, binding: Binding) -> int:
        """Return a problem's number for an object, for its kind, or by default."""
        subject = binding[effect.param]
        table = self.task.problem.config.get(effect.config, {})
        for key in (subject, self.kinds[subject], "default"):
            if key in table:
                return int(table[key])
        return int(effect.default)

    def update_creation(
        self, state: ReferenceState, node: Progress, binding: Binding, active: bool
    ) -> bool:
        effect: Any = node.definition
        kind, type_ = effect.created_obj.name, effect.created_obj.type
        state.created[kind] += 1
        name = f"{kind}{self.numbers[kind] + state.created[kind]}"
        self.order.setdefault(name, (1, state.created[kind], kind))
        self.kinds[name] = kind
        state.objects[name] = (kind, type_)
        binding = {**binding, effect.created_obj.param: name}
        self.make(state, effect.fx, binding)
        self.start_nested(state, effect, binding)
        return True

    def update_deletion(
        self, state: ReferenceState, node: Progress, binding: Binding, active: bool
    ) -> bool:
        effect: Any = node.definition
        gone = binding[effect.param]
        self.make(state, effect.fx, binding)
        state.objects.pop(gone, None)
        state.facts = {fact for fact in state.facts if gone not in fact[1:]}
        state.timers = [t for t in state.timers if gone not in t.arguments]
        self.start_nested(state, effect, binding)
        return True

    def start_nested(self, state: ReferenceState, effect: EffectDef, binding: Binding) -> None:
        """Complete a creation or deletion at once; effects nested in it continue alone."""
        for nested in effect.sfx:
            action, index = self.origin(nested)
            if all(binding[n] in state.objects for n in variables(nested) if n in binding):
                self.start(state, action, index, nested, binding)

    def origin(self, effect: EffectDef) -> tuple[str, int]:
        for action in self.domain.action_defs:
            born = [n for e in walk(action.sfx) if is_instant(e) for n in e.sfx]
            for index, other in enumerate([*action.sfx, *born]):
                if other is effect:
                    return action.name, index
        raise AssertionError("an effect of no action")

    def make(
        self,
        state: ReferenceState,
        fx: Sequence[Condition],
        binding: Binding,
        *,
        negated: bool = False,
    ) -> None:
        """Make facts true or false; true wins. Of what does not exist nothing becomes true."""
        wanted: dict[Fact, bool] = {}
        for condition in fx:
            fact = bind(condition, binding)
            wanted[fact] = wanted.get(fact, False) or condition.is_true
        for fact, true in wanted.items():
            state.facts.discard(fact)
            if true != negated and all(name in state.objects for name in fact[1:]):
                state.facts.add(fact)

    # Goal

    def goal_reached(self, state: ReferenceState) -> bool:
        """Return whether some assignment of objects makes every predicate of the goal true."""
        goal = self.task.problem.goal
        kinds: dict[int | str, str] = {}
        for term in goal:
            for identifier, kind in zip(term.ids, term.args, strict=True):
                kinds.setdefault(identifier, kind)
        labelled = {o.label: o.name for o in self.placed if isinstance(o.label, str)}
        pools = {
            i: [
                name
                for name, (own, type_) in state.objects.items()
                if (labelled[i] == name if i in labelled else kind in (own, type_))
            ]
            for i, kind in kinds.items()
        }

        def met(chosen: dict[int | str, str]) -> bool:
            """Return whether these objects, with some for the other ids, satisfy the goal."""
            for term in goal:
                decided = all(i in chosen for i in term.ids)
                if decided and (term.predicate, *(chosen[i] for i in term.ids)) not in state.facts:
                    return False
            left = [i for i in kinds if i not in chosen]
            if not left:
                return True
            taken = [name for i, name in chosen.items() if kinds[i] == kinds[left[0]]]
            return any(met({**chosen, left[0]: n}) for n in pools[left[0]] if n not in taken)

        return met({})


def is_instant(effect: EffectDef) -> bool:
    return effect.type in ("creation", "deletion")


def progress(effect: EffectDef) -> Progress:
    nested = [] if is_instant(effect) else [progress(child) for child in effect.sfx]
    return Progress(effect, nested=nested)


def bind(condition: Condition, binding: Binding) -> Fact:
    return (condition.predicate, *(binding[name] for name in condition.params))


def walk(effects: Sequence[EffectDef]) -> Iterator[EffectDef]:
    for effect in effects:
        yield effect
        yield from walk(effect.sfx)


def variables(effect: EffectDef) -> Iterator[str]:
    yield effect.param
    for condition in (*getattr(effect, "conditions", ()), *effect.fx):
        yield from condition.params
    for nested in effect.sfx:
        yield from variables(nested)
