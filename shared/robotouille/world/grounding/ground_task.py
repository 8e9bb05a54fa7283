"""A grounded task: its objects and atoms, ground actions and effects, and its goal.

It is compiled from the task alone, without states or timers. Ground actions and effects are made
when first needed, because most combinations of arguments never occur.
"""

from __future__ import annotations

from weakref import WeakValueDictionary

from robotouille.domain.schema import EffectDef
from robotouille.domain.task import Task
from robotouille.errors import UnknownNameError, WrongWorldError, did_you_mean, with_article
from robotouille.world.grounding.actions import (
    ActionSchema,
    GroundAction,
    compile_schemas,
    walking_steps,
)
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.effects import Effect, EffectRun, compile_effect
from robotouille.world.grounding.goal import Goal
from robotouille.world.grounding.ground_objects import GroundObjects
from robotouille.world.grounding.objects import bound

MAX_EFFECTS = 20_000
"""Effects that a world keeps at least. States from a hostile server name any number of them."""


class GroundTask(GroundObjects):
    """The actions, effects and goal of a task over its objects."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.schemas = compile_schemas(task)
        self._schema = {schema.name: schema for schema in self.schemas}
        self._named: dict[tuple[str, tuple[str, ...]], GroundAction] = {}
        self._ground: dict[tuple[int, tuple[str, ...]], GroundAction] = {}
        self._effects: dict[tuple[str, int, tuple[str, ...]], Effect] = {}
        self._most_effects = MAX_EFFECTS
        self._nested_labels = {
            id(effect.definition): (schema.name, i, effect.variables)
            for schema in self.schemas
            for i, effect in enumerate(schema.all_effects)
        }
        predicates = task.domain.predicate_defs
        self._descriptors = {p.name: p.language_descriptors for p in predicates}
        self.goal = Goal(task, self.table, self.all_objects)

    def _grown(self) -> None:
        super()._grown()
        self.goal.refresh()

    def descriptor(self, predicate: str, argument: int) -> str:
        """Return a predicate's sentence about its n-th argument, or an empty text."""
        return self._descriptors[predicate].get(str(argument), "")

    # Actions

    def action(self, name: str, *arguments: str) -> GroundAction:
        """Return a ground action by name and arguments, whether or not it can ever be valid.

        Args:
            name: Name of the action in the domain, e.g. `move`.
            *arguments: Objects: the acting player first, then in the order of the sentence.

        Raises:
            UnknownNameError: There is no such action or object, or the number or a type of the
                arguments is wrong.
        """
        try:
            return self._named[name, arguments]
        except (KeyError, TypeError):
            pass  # The action is new, or an argument is not hashable and so not a name.
        schema = self._schema.get(name) if isinstance(name, str) else None
        if schema is None:
            raise UnknownNameError(f"no action {name!r}{did_you_mean(name, self._schema)}")
        if len(arguments) != len(schema.parameters):
            names = ", ".join(f"{n}: {kind}" for n, kind in schema.parameters)
            raise UnknownNameError(f"{name!r} takes ({names}), found {len(arguments)} arguments")
        for argument, (_, kind) in zip(arguments, schema.parameters, strict=True):
            self._check_type(argument, kind, name)
        action = self._named[name, arguments] = self.ground_action(schema, arguments)
        return action

    def _check_type(self, argument: str, kind: str, taker: str) -> None:
        found = self.thing(argument).type
        if found != kind:
            is_one, needed = with_article(found), with_article(kind)
            raise UnknownNameError(f"{argument!r} is {is_one}; {taker!r} takes {needed} there")

    def ground_action(self, schema: ActionSchema, arguments: tuple[str, ...]) -> GroundAction:
        """Return the ground action of a schema and arguments of the right types."""
        key = (schema.index, arguments)
        action = self._ground.get(key)
        if action is None:
            action = self._ground[key] = self._make_action(schema, arguments)
        return action

    @property
    def known_actions(self) -> tuple[GroundAction, ...]:
        """The ground actions that have been made so far."""
        return tuple(self._ground.values())

    def _make_action(self, schema: ActionSchema, arguments: tuple[str, ...]) -> GroundAction:
        binding = schema.bind(arguments)
        definition = schema.definition
        order = [
            self.table.by_type[kind].index(argument)
            for argument, (_, kind) in zip(arguments, schema.parameters, strict=True)
        ]
        sentence = definition.language_description.format(**binding)
        key, serial = (schema.index, *order), len(self._ground)
        action = GroundAction(self, schema, arguments, key, sentence, serial)
        conditions = [(bound(c, binding), c.is_true) for c in definition.precons]
        conditions += [((EXISTS, a), True) for a in arguments if (EXISTS, a) in self.table.bit]
        action.tested, action.required, possible = self.table.test(conditions)
        if not possible:
            # No facts have a bit under the mask 0, so this test always fails.
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
        for effect in action.effects:
            action.reads |= effect.reads
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

    # Effects

    def effect(self, action: str, index: int, arguments: tuple[str, ...]) -> Effect:
        """Return a special effect by its label.

        Raises:
            UnknownNameError: There is no such action or object, or a type of the arguments is
                wrong.
            WrongWorldError: The action has no such effect, or it takes more or fewer arguments.
        """
        known = self._effects.get((action, index, arguments))
        if known is not None:
            return known
        if action not in self._schema:
            raise UnknownNameError(f"no action {action!r}{did_you_mean(action, self._schema)}")
        effects = self._schema[action].all_effects
        if not 0 <= index < len(effects):
            raise WrongWorldError(f"{action!r} has {len(effects)} effects, found number {index}")
        effect = effects[index]
        if len(arguments) != len(effect.variables):
            raise WrongWorldError(f"{action}.{index} takes {effect.variables}, found {arguments}")
        for argument, kind in zip(arguments, effect.types, strict=True):
            self._check_type(argument, kind, f"{action}.{index}")
        binding = dict(zip(effect.variables, arguments, strict=True))
        return self._effect(effect.definition, (action, index, effect.variables), binding)

    def effect_run(self, facts: int) -> EffectRun:
        """Return a new run of effect updates on `facts`."""
        return EffectRun(facts, self.table, self._next_created, self.born_effect)

    def born_effect(self, definition: EffectDef, binding: dict[str, str]) -> Effect:
        """Return the effect that starts when the effect around it creates or deletes an object."""
        return self._effect(definition, self._nested_labels[id(definition)], binding)

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
            if len(self._effects) >= self._most_effects:
                self._forget_unused_effects()
            effect = compile_effect(definition, label, binding, self.table, self._count)
            self._effects[label] = effect
        return effect

    def _forget_unused_effects(self) -> None:
        """Drop the effects that neither actions nor timers use."""
        used = WeakValueDictionary(self._effects)
        self._effects.clear()
        self._effects.update(used)
        self._most_effects = max(MAX_EFFECTS, 2 * len(self._effects))

    def _count(self, definition: EffectDef, subject: str) -> int:
        """Return the number of updates after which a counting effect takes place.

        A delay of n ends with the n-th step after the step that starts it. That step also has a
        passive update, so there are n + 1 (docs/episodes.md, "Delays").
        """
        steps: int = definition.default  # type: ignore[union-attr]
        config: str | None = definition.config  # type: ignore[union-attr]
        if config is not None:
            table = self.task.problem.config.get(config, {})
            kind = self._things[subject].kind if subject in self._things else subject
            steps = table.get(subject, table.get(kind, table.get("default", steps)))
        if definition.counts == "performances":
            return max(1, steps)
        return steps * self.task.profile.delay_factor + 1
