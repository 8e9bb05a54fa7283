"""The Markov decision process of a task: states, valid actions, steps (paper, section 2).

world = World(load_task("synchronous/01_cheese_sandwich"))
state = world.initial
state = state.step(state.actions("robot1")[0]).state
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

from robotouille.domain.catalogue import load_task
from robotouille.domain.checks import parameter_types
from robotouille.domain.schema import Creation, Deletion, EffectDef
from robotouille.domain.task import Task
from robotouille.errors import InapplicableError, did_you_mean
from robotouille.world.grounding.actions import (
    ActionSchema,
    GroundAction,
    bound,
    compile_schemas,
    walking_steps,
)
from robotouille.world.grounding.atoms import EXISTS, USED, AtomTable, bits_of
from robotouille.world.grounding.effects import Effect, EffectRun, compile_effect
from robotouille.world.grounding.floor import Floor
from robotouille.world.grounding.goal import Goal
from robotouille.world.grounding.objects import Atom, Object, initial_facts, place_objects
from robotouille.world.state import State
from robotouille.world.successors import SuccessorTree
from robotouille.world.text import describe
from robotouille.world.timers import Timers, TimerTable

__all__ = ["Attempt", "Step", "World", "shared_world"]


class Attempt(NamedTuple):
    """What became of one player's action: applied, or rejected with the unmet preconditions."""

    action: GroundAction
    applied: bool
    unmet: tuple[str, ...] = ()


class Step(NamedTuple):
    """The result of a step: the new state, its reward and what became of each action."""

    state: State
    attempts: tuple[Attempt, ...]
    goal_reached: bool

    @property
    def reward(self) -> float:
        """1 on a step that reaches the goal, else 0."""
        return 1.0 if self.goal_reached else 0.0


MAX_CREATED = 500

_worlds: weakref.WeakValueDictionary[str, World] = weakref.WeakValueDictionary()


class World:
    """A grounded task. Ground actions are made when first needed and live as long as it does."""

    def __init__(self, task: Task | str) -> None:
        self.task = load_task(task) if isinstance(task, str) else task
        domain = self.task.domain
        self.placed = place_objects(self.task)
        self._things: dict[str, Object] = {thing.name: thing for thing in self.placed}
        self.players = tuple(o.name for o in self.placed if o.type in domain.player_types)
        self._creations = sorted(set(_creations(self.task)))
        deleted = set(_deletions(self.task))
        transient = frozenset({kind for _, kind in self._creations} | deleted)
        facts = initial_facts(self.task, self.placed)
        self.table = AtomTable(domain, transient, facts)
        self.schemas = compile_schemas(self.task)
        self._schema = {schema.name: schema for schema in self.schemas}
        self._named: dict[tuple[str, tuple[str, ...]], GroundAction] = {}
        self._nested_labels = {
            id(effect.definition): (schema.name, i, effect.variables)
            for schema in self.schemas
            for i, effect in enumerate(schema.all_effects)
        }
        self._descriptors = {p.name: p.language_descriptors for p in domain.predicate_defs}
        self._ground: dict[tuple[int, tuple[str, ...]], GroundAction] = {}
        self._effects: dict[tuple[str, int, tuple[str, ...]], Effect] = {}
        self._generation = 0
        self.table.add(self.placed)
        self._sizes = [len(self.table.atoms)]
        existing = [o.name for o in self.placed if o.type in transient]
        born = [(flag, name) for name in existing for flag in (EXISTS, USED)]
        self._initial_facts = self.table.mask([*facts, *born])
        self.timers = TimerTable(self)
        self._trees: dict[str, SuccessorTree] = {}
        if self._creations:
            self._add_generation()
        self.goal = Goal(self.task, self.table, self.all_objects)

    def __reduce__(self) -> tuple[Any, ...]:
        return shared_world, (self.task,)

    def __deepcopy__(self, memo: dict[int, Any]) -> World:
        return self

    @cached_property
    def initial(self) -> State:
        """The state in which every episode of the task begins."""
        return State(self, self._initial_facts, self.timers.none)

    @cached_property
    def floor(self) -> Floor:
        """The kitchen's floor, for walking."""
        problem, stations = self.task.problem, set(self.task.domain.station_types)
        return Floor(problem.width, problem.height, self.placed, stations)

    @property
    def table_sizes(self) -> tuple[int, ...]:
        """The sizes that the table of atoms had: at first, and after each generation."""
        return tuple(self._sizes)

    @property
    def thing_names(self) -> frozenset[str]:
        """The names of all objects there is room for."""
        return frozenset(self._things)

    def table_size(self, facts: int) -> int:
        """How many atoms of the table one must know to read these facts.

        It depends on the facts alone, not on what other courses of play have created.
        """
        length = facts.bit_length()
        return next(size for size in self._sizes if length <= size)

    # Objects

    def thing(self, name: str) -> Object:
        """The object of a name; KeyError if there is none."""
        return self._things[name]

    def all_objects(self) -> tuple[Object, ...]:
        """The objects of the problem, and those that play may create and has room for so far."""
        return tuple(self._things.values())

    def objects_in(self, facts: int) -> tuple[Object, ...]:
        """The objects that exist in a state, by type, then as numbered."""
        there = [o for o in self._things.values() if self._exists(o, facts)]
        order = {kind: i for i, kind in enumerate(self.task.domain.object_types)}
        return tuple(sorted(there, key=lambda o: order[o.type]))

    def used_objects(self, facts: int) -> list[str]:
        """The created objects that exist or did: their names are never given again."""
        return [
            name
            for name, thing in self._things.items()
            if thing.tile is None and facts & self.table.bit[(USED, name)]
        ]

    def _exists(self, thing: Object, facts: int) -> bool:
        return thing.type not in self.table.transient or bool(
            facts & self.table.bit[(EXISTS, thing.name)]
        )

    def _add_generation(self) -> None:
        """Make room for one more created object of every kind that can be created."""
        self._generation += 1
        new = []
        for kind, type_ in self._creations:
            number = 1 + sum(thing.kind == kind for thing in self._things.values())
            thing = Object(f"{kind}{number}", kind, type_)
            self._things[thing.name] = thing
            new.append(thing)
        self.table.add(new)
        self._sizes.append(len(self.table.atoms))
        self._trees.clear()

    def make_room(self, wanted: Mapping[str, int]) -> None:
        """Give bits to as many objects of each creatable kind as are wanted."""
        for kind, _ in self._creations:
            while sum(o.kind == kind for o in self._things.values()) < wanted.get(kind, 0):
                self._add_generation()
        self.goal.refresh()

    def admit(self, names: Iterable[str]) -> None:
        """Make room for the created objects among these names, as somebody else's course of play
        may have; ValueError above `MAX_CREATED` of a kind."""
        creatable = {kind for kind, _ in self._creations}
        wanted: dict[str, int] = {}
        for name in names:
            kind = name.rstrip("0123456789")
            digits = name[len(kind) :]
            if name in self._things or kind not in creatable or not digits:
                continue
            if len(digits) > 6 or int(digits) > MAX_CREATED:
                raise ValueError(f"{name} would be more than {MAX_CREATED} of a kind")
            wanted[kind] = max(wanted.get(kind, 0), int(digits))
        if wanted:
            self.make_room(wanted)

    def _create(self, kind: str, type_: str, facts: int) -> str:
        """The name of the next object of a kind; its number was never used in this course."""
        while True:
            for thing in self._things.values():
                made = thing.tile is None and (thing.kind, thing.type) == (kind, type_)
                if made and not facts & self.table.bit[(USED, thing.name)]:
                    return thing.name
            self._add_generation()
            self.goal.refresh()

    # Actions

    def actions(self, state: State, player: str) -> tuple[GroundAction, ...]:
        """The valid actions of a player in a stable order."""
        tree = self._trees.get(player)
        if tree is None:
            tree = self._new_tree(player)
        if state.timers.busy and state.timers.busy_steps(player):
            return ()
        return tree.actions(state.facts)

    def _new_tree(self, player: str) -> SuccessorTree:
        if player not in self.players:
            raise KeyError(f"no player {player!r}{did_you_mean(player, self.players)}")
        kind = self._things[player].type
        tree = SuccessorTree(player, kind, self.schemas, self.table, self._ground_action)
        self._trees[player] = tree
        return tree

    def action(self, name: str, *arguments: str) -> GroundAction:
        """A ground action by name and arguments, applicable anywhere or not; KeyError names what
        is unknown or of the wrong type."""
        known = self._named.get((name, arguments))
        if known is not None:
            return known
        schema = self._schema.get(name)
        if schema is None:
            raise KeyError(f"no action {name!r}{did_you_mean(name, self._schema)}")
        if len(arguments) != len(schema.parameters):
            names = ", ".join(f"{n}: {kind}" for n, kind in schema.parameters)
            raise KeyError(f"{name!r} takes ({names}), found {len(arguments)} arguments")
        for argument, (_, kind) in zip(arguments, schema.parameters, strict=True):
            if argument not in self._things:
                raise KeyError(f"no object {argument!r}{did_you_mean(argument, self._things)}")
            if self._things[argument].type != kind:
                found = self._things[argument].type
                raise KeyError(f"{argument!r} is a {found}; {name!r} takes a {kind} there")
        action = self._named[name, arguments] = self._ground_action(schema, arguments)
        return action

    def parse(self, state: State, player: str, sentence: str) -> GroundAction:
        """The valid action of a player that a sentence says; KeyError gives the nearest one."""
        wanted = " ".join(sentence.split()).casefold()
        sentences = {" ".join(a.sentence.split()).casefold(): a for a in state.actions(player)}
        if wanted not in sentences:
            raise KeyError(f"no valid action {sentence!r}{did_you_mean(wanted, sentences)}")
        return sentences[wanted]

    def _ground_action(self, schema: ActionSchema, arguments: tuple[str, ...]) -> GroundAction:
        key = (schema.index, arguments)
        action = self._ground.get(key)
        if action is None:
            action = self._ground[key] = self._make_action(schema, arguments)
        return action

    def _make_action(self, schema: ActionSchema, arguments: tuple[str, ...]) -> GroundAction:
        binding = schema.bind(arguments)
        definition = schema.definition
        order = [
            self.table.by_type[kind].index(argument)
            for argument, (_, kind) in zip(arguments, schema.parameters, strict=True)
        ]
        sentence = definition.language_description.format(**binding)
        action = GroundAction(schema, arguments, (schema.index, *order), sentence)
        conditions = [(bound(c, binding), c.is_true) for c in definition.precons]
        conditions += [((EXISTS, a), True) for a in arguments if (EXISTS, a) in self.table.bit]
        action.tested, action.required, possible = self.table.test(conditions)
        if not possible:
            action.tested, action.required = 0, 1
        sets = self.table.mask(bound(c, binding) for c in definition.immediate_fx if c.is_true)
        clears = self.table.mask(
            bound(c, binding) for c in definition.immediate_fx if not c.is_true
        )
        action.touched = sets | clears
        action.removed = clears & ~sets
        action.duration = self._duration(schema, binding)
        action.effects = tuple(
            self._effect(effect.definition, (schema.name, i, effect.variables), binding)
            for i, effect in enumerate(schema.effects)
        )
        self.timers.reads[action] = _union(effect.reads for effect in action.effects)
        return action

    def _duration(self, schema: ActionSchema, binding: dict[str, str]) -> int:
        profile = self.task.profile
        steps = 1
        if schema.definition.travel is not None and profile.steps_per_tile:
            here, there = (binding[name] for name in schema.definition.travel)
            steps = walking_steps(self.floor.distance(here, there), profile.steps_per_tile)
        if any(effect.repeats for effect in schema.effects):
            steps = max(steps, profile.repeat_steps)
        return steps

    @property
    def known_actions(self) -> tuple[GroundAction, ...]:
        """The ground actions that have been needed so far."""
        return tuple(self._ground.values())

    # Effects

    def _effect(
        self,
        definition: EffectDef,
        label: tuple[str, int, tuple[str, ...]],
        binding: dict[str, str],
    ) -> Effect:
        action, index, variables = label
        label = (action, index, tuple(binding[name] for name in variables))
        effect = self._effects.get(label)
        if effect is None:
            effect = compile_effect(definition, label, binding, self.table, self._count)
            self._effects[label] = effect
        return effect

    def _count(self, definition: EffectDef, subject: str) -> int:
        """The updates after which a delayed or repetitive effect takes place (world.md, "Delays").

        A delay of n ends with the n-th step after the one that starts it: n + 1 passive updates.
        """
        steps: int = definition.default  # type: ignore[union-attr]
        config: str | None = definition.config  # type: ignore[union-attr]
        if config is not None:
            table = self.task.problem.config.get(config, {})
            kind = self._things[subject].kind if subject in self._things else subject
            steps = table.get(subject, table.get(kind, table.get("default", steps)))
        if definition.type == "repetitive":
            return max(1, steps)
        return steps * self.task.profile.delay_factor + 1

    def effect_run(self, facts: int) -> EffectRun:
        """A fresh run of effect updates on `facts`."""
        return EffectRun(facts, self.table, self._create, self._born)

    def _born(self, definition: EffectDef, binding: dict[str, str]) -> Effect:
        return self._effect(definition, self._nested_labels[id(definition)], binding)

    # Steps

    def applicable(self, state: State, action: GroundAction) -> bool:
        """Whether an action applies in a state."""
        met = state.facts & action.tested == action.required
        return met and not state.timers.busy_steps(action.player)

    def successor(self, state: State, action: GroundAction) -> State:
        """The state after one player's valid action: the fast path for search.

        Raises InapplicableError where the action does not apply.
        """
        facts = state.facts
        if facts & action.tested != action.required or (
            state.timers.busy and state.timers.busy_steps(action.player)
        ):
            raise InapplicableError(action.sentence, self.unmet(state, action))
        facts = (facts | action.touched) ^ action.removed
        timers = state.timers
        if action.effects or action.duration > 1:
            touched, removed, timers = timers.begin(action, facts)
            facts = (facts | touched) ^ removed
        if timers.entries or timers.busy:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        return State(self, facts, timers)

    def step(
        self,
        state: State,
        actions: GroundAction | Sequence[GroundAction | None] | Mapping[str, GroundAction],
    ) -> Step:
        """Apply a joint action, one player's after the other's, then let a step of time pass.

        `actions` are in the order in which they apply; an action whose preconditions do not hold
        then is rejected and changes nothing.
        """
        facts, timers = state.facts, state.timers
        attempts = []
        acted: set[str] = set()
        for player, action in _in_order(actions):
            actor = action.player or player
            unmet: tuple[str, ...] = ()
            if actor is not None and actor in acted:
                unmet = (f"{actor} has acted in this step already",)
            elif facts & action.tested != action.required or timers.busy:
                unmet = self._unmet(facts, timers, action, actor)
            if unmet:
                attempts.append(Attempt(action, False, unmet))
                continue
            if actor is not None:
                acted.add(actor)
            facts = (facts | action.touched) ^ action.removed
            if action.effects or action.duration > 1:
                touched, removed, timers = timers.begin(action, facts)
                facts = (facts | touched) ^ removed
            attempts.append(Attempt(action, True))
        if timers:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        after = State(self, facts, timers)
        return Step(after, tuple(attempts), after.goal_reached)

    def unmet(self, state: State, action: GroundAction) -> tuple[str, ...]:
        """The preconditions of an action that do not hold in a state, in words."""
        return self._unmet(state.facts, state.timers, action, action.player)

    def _unmet(
        self, facts: int, timers: Timers, action: GroundAction, actor: str | None
    ) -> tuple[str, ...]:
        unmet = []
        steps = timers.busy_steps(actor)
        if steps:
            unmet.append(f"{actor} is busy for {steps} more step{'s' * (steps > 1)}")
        binding = action.schema.bind(action.arguments)
        for name in action.arguments:
            if not self._exists(self._things[name], facts):
                unmet.append(f"{name} does not exist")
        for condition in action.schema.definition.precons:
            atom = bound(condition, binding)
            if self.table.holds(atom, facts) != condition.is_true:
                unmet.append(describe(self.task.domain, atom, condition.is_true))
        return tuple(unmet)

    # Facts and text

    def descriptor(self, predicate: str, argument: int) -> str:
        """How to say a predicate of its n-th argument; empty where nothing is said."""
        return self._descriptors[predicate].get(str(argument), "")

    def changes(self, before: State, after: State) -> tuple[list[Atom], list[Atom]]:
        """The facts added and removed between two states, by bit."""
        internal = ~self.table.internal
        added = after.facts & ~before.facts & internal
        removed = before.facts & ~after.facts & internal
        atoms = self.table.atoms
        return [atoms[i] for i in bits_of(added)], [atoms[i] for i in bits_of(removed)]

    def restore(
        self,
        facts: int,
        rows: Sequence[tuple[str, int, tuple[str, ...], tuple[int, ...]]],
        busy: Sequence[tuple[str, int]] = (),
    ) -> State:
        """A state from its facts, `State.timer_rows()` and busy players.

        Raises KeyError or ValueError where they do not belong to this world.
        """
        # Each generation in use has a name that was given: no facts need more room than that.
        most = facts.bit_count() if self._creations else 0
        while facts.bit_length() > len(self.table.atoms) and self._generation < most:
            self._add_generation()
            self.goal.refresh()
        if facts < 0 or facts.bit_length() > len(self.table.atoms):
            raise ValueError("facts of another world")
        entries = []
        for action, index, arguments, counters in rows:
            effect = self._effect_by_label(action, index, tuple(arguments))
            if len(counters) != effect.size:
                raise ValueError(f"{effect} has {effect.size} counters, found {len(counters)}")
            entries.append((effect, tuple(counters)))
        return State(self, facts, self.timers.get(tuple(entries), tuple(map(tuple, busy))))  # type: ignore[arg-type]

    def _effect_by_label(self, action: str, index: int, arguments: tuple[str, ...]) -> Effect:
        known = self._effects.get((action, index, arguments))
        if known is not None:
            return known
        effects = self._schema[action].all_effects
        if not 0 <= index < len(effects):
            raise ValueError(f"{action!r} has {len(effects)} effects, found number {index}")
        effect = effects[index]
        binding = dict(zip(effect.variables, arguments, strict=True))
        for name in arguments:
            if name not in self._things:
                raise KeyError(f"no object {name!r}")
        return self._effect(effect.definition, (action, index, effect.variables), binding)


def shared_world(task: Task) -> World:
    """One world per task and process: worlds have no course of play in them, so may be shared."""
    world = _worlds.get(task.digest)
    if world is None:
        world = _worlds[task.digest] = World(task)
    return world


def _in_order(
    actions: GroundAction | Sequence[GroundAction | None] | Mapping[str, GroundAction],
) -> Iterator[tuple[str | None, GroundAction]]:
    if isinstance(actions, list):
        for action in actions:
            if action is not None:
                yield None, action
    elif isinstance(actions, GroundAction):
        yield None, actions
    elif isinstance(actions, Mapping):
        yield from actions.items()
    else:
        yield from ((None, action) for action in actions if action is not None)


def _nested(effects: tuple[EffectDef, ...]) -> Iterator[EffectDef]:
    for effect in effects:
        yield effect
        yield from _nested(effect.sfx)


def _creations(task: Task) -> Iterator[tuple[str, str]]:
    for action in task.domain.action_defs:
        for effect in _nested(action.sfx):
            if isinstance(effect, Creation):
                yield effect.created_obj.name, effect.created_obj.type


def _deletions(task: Task) -> Iterator[str]:
    predicates = {p.name: p for p in task.domain.predicate_defs}
    for action in task.domain.action_defs:
        types = parameter_types(action, predicates)
        for effect in _nested(action.sfx):
            if isinstance(effect, Deletion) and effect.param in types:
                yield types[effect.param]


def _union(masks: Iterator[int]) -> int:
    total = 0
    for mask in masks:
        total |= mask
    return total
