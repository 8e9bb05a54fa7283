"""Schemas of domain, problem and input files.

Paper: section 2 "Domain and Problem JSONs" and appendix "Additional Robotouille JSONs". Two
dialects are read: the published one (`version` 1.x) and this project's (2.x), which adds the
fields `layout`, `travel`, `config`/`default` of effects, `player_types`, `station_types`,
`objects`, `seats`, `domain`, `provenance` and `extends`. See docs/file_formats.md.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z_][A-Za-z0-9_'-]*$")]
Steps = Annotated[int, Field(ge=0, le=100_000)]
Words = Annotated[str, Field(max_length=2000)]
Extends = Annotated[str | None, Field(default=None, min_length=1, max_length=200)]
"""Name of the file that a file extends; see `related_files.py`."""


class Schema(BaseModel):
    """Base of all file schemas. Instances are immutable; unknown fields are faults."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class PredicateDef(Schema):
    """A predicate, the types of its arguments, and a sentence about each argument."""

    name: Name
    param_types: tuple[Name, ...] = Field(max_length=4)
    language_descriptors: dict[str, Words] = {}


class Condition(Schema):
    """A predicate over parameters and its required truth, or its new truth in a result."""

    predicate: Name
    params: tuple[Name, ...]
    is_true: bool = True


class CreatedObject(Schema):
    name: Name
    type: Name
    param: Name


class SpecialEffect(Schema):
    """Base of the kinds of special effects (paper, section 2).

    A new kind is a subclass here, a member of `EffectDef`, and an update in
    `world/grounding/effects.py`. The class attributes describe it to all code that does not
    simulate it: texts, checks and planners.
    """

    counts: ClassVar[Literal["", "steps", "performances"]] = ""
    """Unit of the effect's counter; empty for effects without a counter."""
    instant: ClassVar[bool] = False
    """True if the effect completes in the step in which it starts.

    Effects nested in it then start as separate effects."""
    reverts: ClassVar[bool] = False
    """It may negate `fx` again later."""
    pauses: ClassVar[bool] = False
    """Its progress is `PAUSED` or `HOLDING`; nested effects run only while it is `HOLDING`."""


class Conditional(SpecialEffect):
    """Asserts `fx` while its conditions hold, and pauses nested effects while they do not."""

    reverts = True
    pauses = True

    type: Literal["conditional"]
    param: Name
    conditions: tuple[Condition, ...] = ()
    fx: tuple[Condition, ...] = ()
    sfx: tuple[EffectDef, ...] = ()


class Delayed(SpecialEffect):
    """Applies `fx` once, after a number of steps."""

    counts = "steps"

    type: Literal["delayed"]
    param: Name
    fx: tuple[Condition, ...] = ()
    sfx: tuple[EffectDef, ...] = ()
    config: Name | None = None
    default: Steps = 3


class Repetitive(SpecialEffect):
    """Applies `fx` once, after the action has been performed a number of times."""

    counts = "performances"

    type: Literal["repetitive"]
    param: Name
    fx: tuple[Condition, ...] = ()
    sfx: tuple[EffectDef, ...] = ()
    config: Name | None = None
    default: Annotated[int, Field(ge=1, le=100_000)] = 3


class Creation(SpecialEffect):
    """Creates an object and applies `fx` to it."""

    instant = True

    type: Literal["creation"]
    param: Name
    created_obj: CreatedObject
    fx: tuple[Condition, ...] = ()
    sfx: tuple[EffectDef, ...] = ()


class Deletion(SpecialEffect):
    """Deletes the object `param` and every fact about it."""

    instant = True

    type: Literal["deletion"]
    param: Name
    fx: tuple[Condition, ...] = ()
    sfx: tuple[EffectDef, ...] = ()


CountedEffect = Delayed | Repetitive
InstantEffect = Creation | Deletion
EffectDef = Annotated[Conditional | CountedEffect | InstantEffect, Field(discriminator="type")]
EFFECT_KINDS = frozenset(
    kind.__name__.lower() for kind in get_args(Conditional | CountedEffect | InstantEffect)
)
"""Values of `type` in the files."""


MAX_CONDITIONS = 64
"""Maximum length of the lists of an action. Shipped actions have up to seven preconditions."""


class ActionDef(Schema):
    """An action schema over parameters whose types follow from the predicates they occur in."""

    name: Name
    precons: Annotated[tuple[Condition, ...], Field(max_length=MAX_CONDITIONS)] = ()
    immediate_fx: Annotated[tuple[Condition, ...], Field(max_length=MAX_CONDITIONS)] = ()
    sfx: Annotated[tuple[EffectDef, ...], Field(max_length=MAX_CONDITIONS)] = ()
    language_description: Words
    travel: tuple[Name, Name] | None = None


class LayoutRule(Schema):
    """Rule that derives the initial facts of one predicate from positions.

    `when` relates two objects on the grid. `unless` makes the fact hold for every object that
    occurs in no fact of the named predicates.
    """

    predicate: Name
    when: (
        Literal[
            "shares_tile", "bottom_of_stack", "next_in_stack", "top_of_stack", "faces", "reaches"
        ]
        | None
    ) = None
    unless: tuple[Name, ...] | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> LayoutRule:
        if (self.when is None) == (self.unless is None):
            raise ValueError("needs exactly one of 'when' and 'unless'")
        return self


def _needs_less_if_it_extends(schema: dict[str, Any]) -> None:
    """Require only the name in the JSON schema of a file that extends another."""
    required = schema["required"]
    schema["required"] = ["name"]
    schema["anyOf"] = [{"required": ["extends"]}, {"required": required}]


class DomainFile(Schema):
    """A domain: types, predicates and actions (paper, section 2).

    A domain read from a file has no `extends`, because reading merges the extended file.
    """

    model_config = ConfigDict(json_schema_extra=_needs_less_if_it_extends)

    schema_uri: str | None = Field(default=None, alias="$schema")
    extends: Extends = None
    version: str = "1.0.0"
    name: Name
    input_json: str | None = None
    rendering_json: str | None = None
    object_types: tuple[Name, ...] = Field(min_length=1, max_length=32)
    predicate_defs: tuple[PredicateDef, ...] = Field(min_length=1, max_length=500)
    action_defs: tuple[ActionDef, ...] = Field(min_length=1, max_length=200)
    layout: tuple[LayoutRule, ...] | None = None
    player_types: tuple[Name, ...] = ("player",)
    station_types: tuple[Name, ...] = ("station",)
    kinds: dict[Name, tuple[Name, ...]] = {}


class DelayKey(Schema):
    config: Name
    default: Steps


class PublishedDefaults(Schema):
    """Defaults for domains of the published dialect (1.x), which has no such fields."""

    layout: tuple[LayoutRule, ...]
    travel: dict[str, tuple[Name, Name]]
    delays: dict[str, DelayKey]
    kinds: dict[Name, tuple[Name, ...]]


_GENERATOR_MARKS = {"force_add", "frozen"}


class ObjectDef(Schema):
    """One object of a problem and where it is; (0, 0) is the bottom-left tile.

    Published problems can have `meal_id`, which has no meaning. Some also have marks of the
    published generator, `force_add` and `frozen`, which are dropped.
    """

    name: Name
    x: Annotated[int, Field(ge=0, le=99)]
    y: Annotated[int, Field(ge=0, le=99)]
    predicates: tuple[Name, ...] = ()
    id: str | int | None = None
    stack_level: int = Field(default=0, alias="stack-level", ge=0, le=1000)
    direction: tuple[int, int] | None = None
    meal_id: Any = None

    @model_validator(mode="before")
    @classmethod
    def _without_marks(cls, raw: Any) -> Any:
        if not isinstance(raw, dict) or not raw.keys() & _GENERATOR_MARKS:
            return raw
        return {key: value for key, value in raw.items() if key not in _GENERATOR_MARKS}

    @model_validator(mode="after")
    def _unit_direction(self) -> ObjectDef:
        if self.direction is not None and sorted(map(abs, self.direction)) != [0, 1]:
            raise ValueError("direction must be one of [0, 1], [0, -1], [1, 0], [-1, 0]")
        return self


class GoalTerm(Schema):
    """One predicate of the goal over variables; equal ids are the same object."""

    predicate: Name
    args: tuple[Name, ...]
    ids: tuple[int | str, ...]

    @model_validator(mode="after")
    def _an_id_each(self) -> GoalTerm:
        if len(self.args) != len(self.ids):
            raise ValueError(f"{len(self.args)} args but {len(self.ids)} ids")
        return self


DishName = Annotated[str, Field(min_length=1, max_length=100)]


MAX_POINTS = 10_000
"""Largest number of points of a dish, and largest tip and penalty."""
Points = Annotated[int, Field(ge=0, le=MAX_POINTS)]


class Dish(Schema):
    """Dish on the menu of a shift. Times are in steps of the timing profile `benchmark`.

    `goal` describes the dish as the goal of a problem does. A dish that is served with `n` of
    `patience` steps left earns `points`, and `n / patience` of `tip`. An order that expires costs
    `penalty`.
    """

    goal: tuple[GoalTerm, ...] = Field(min_length=1, max_length=32)
    points: Points
    tip: Points = 0
    penalty: Points = 0
    patience: Annotated[int, Field(ge=1, le=10_000)]


class Arrivals(Schema):
    """Random arrivals of orders: the first one, and the least and greatest interval after it."""

    first: Annotated[int, Field(ge=0, le=10_000)] = 0
    every: tuple[Annotated[int, Field(ge=1, le=10_000)], Annotated[int, Field(ge=1, le=10_000)]]

    @model_validator(mode="after")
    def _in_order(self) -> Arrivals:
        if self.every[0] > self.every[1]:
            raise ValueError(f"the interval {self.every[0]} to {self.every[1]} is empty")
        return self


class Arrival(Schema):
    """Arrival of one order."""

    at: Annotated[int, Field(ge=0, le=10_000)]
    dish: DishName


class Serving(Schema):
    """Stations where dishes are served, and the predicates that put a dish there.

    Served objects return to where they were at the beginning, without the facts of `soils`.
    """

    station: Name
    predicates: tuple[Name, ...] = Field(min_length=1, max_length=8)
    soils: tuple[Name, ...] = Field(default=(), max_length=8)


MAX_ORDERS = 1000
SeatCount = Annotated[int, Field(ge=1, le=16)]


class Shift(Schema):
    """Orders that keep coming (docs/shifts.md). Times are in steps of the profile `benchmark`.

    Attributes:
        steps: The length of the shift.
        menu: The dishes by their names for people.
        arrivals: The orders, or how the seed draws them. A task has drawn them already.
        most_open: Number of open orders above which further ones wait.
        serve: Where a dish counts.
        discard: Kind of the stations where things are thrown away.
        stars: Points for one, two and three stars in a window, by the number of seats.
        planner: Points of planner bots by the number of seats, for the orders of seed 0 and the
            profile `benchmark`. `robotouille plan` computes them.
        planner_people: The same for the profile `people`, which the window shows.
    """

    steps: Annotated[int, Field(ge=1, le=10_000)]
    menu: dict[DishName, Dish] = Field(min_length=1, max_length=32)
    arrivals: Arrivals | Annotated[tuple[Arrival, ...], Field(min_length=1, max_length=MAX_ORDERS)]
    most_open: Annotated[int, Field(ge=1, le=16)] = 3
    serve: Serving
    discard: Name | None = None
    stars: dict[SeatCount, tuple[Points, Points, Points]] = {}
    planner: dict[SeatCount, int] = {}
    planner_people: dict[SeatCount, int] = {}

    def bound(self, delay_factor: int) -> int | None:
        """Return the points that nobody can exceed; None if no orders have been drawn.

        Every order is served in the step after its arrival.
        """
        if isinstance(self.arrivals, Arrivals):
            return None
        dishes = [self.menu[each.dish] for each in self.arrivals if each.at < self.steps]
        patience = [dish.patience * delay_factor for dish in dishes]
        pairs = zip(dishes, patience, strict=True)
        return sum(dish.points + dish.tip * (steps - 1) // steps for dish, steps in pairs)

    @model_validator(mode="after")
    def _stars_ascend(self) -> Shift:
        for seats, (one, two, three) in self.stars.items():
            if not one <= two <= three:
                raise ValueError(f"the points for stars with {seats} seats must not decrease")
        return self


_PUBLISHED_LISTS = {
    "stations": "station",
    "items": "item",
    "containers": "container",
    "meals": "meal",
    "players": "player",
}


class Provenance(Schema):
    """Origin of a generated problem, with everything needed to generate it again."""

    source: Words
    seed: int
    kind: Name
    attempt: Annotated[int, Field(ge=1)]
    parameters: dict[Name, bool | int] = {}
    generator: Words


class ProblemFile(Schema):
    """A problem: the grid, its objects and the goal (paper, section 2 and appendix)."""

    schema_uri: str | None = Field(default=None, alias="$schema")
    version: str = "1.0.0"
    domain: str | None = None
    width: Annotated[int, Field(ge=1, le=100)]
    height: Annotated[int, Field(ge=1, le=100)]
    config: dict[str, dict[str, Steps]] = {}
    ground: tuple[str, ...] | None = None
    flooring: Any = None
    furniture: Any = None
    objects: dict[str, tuple[ObjectDef, ...]] = {}
    seats: tuple[SeatCount, ...] | None = None
    goal_description: Words = ""
    goal: tuple[GoalTerm, ...] = Field(default=(), max_length=1000)
    shift: Shift | None = None
    provenance: Provenance | None = None

    @property
    def published(self) -> bool:
        """True for the published dialect (1.x), which numbers objects differently."""
        return self.version.startswith("1.")

    @model_validator(mode="before")
    @classmethod
    def _gather_objects(cls, raw: Any) -> Any:
        if not isinstance(raw, dict):
            return raw
        lists = {kind: raw[key] for key, kind in _PUBLISHED_LISTS.items() if key in raw}
        if not lists:
            return raw
        rest = {key: value for key, value in raw.items() if key not in _PUBLISHED_LISTS}
        objects = raw.get("objects", {})
        if not isinstance(objects, dict):
            return raw
        return {**rest, "objects": {**lists, **objects}}

    @model_validator(mode="after")
    def _goal_or_shift(self) -> ProblemFile:
        if self.shift is not None and self.goal:
            raise ValueError("a shift has no goal; describe its dishes in 'shift.menu'")
        if self.shift is None and "goal" not in self.model_fields_set:
            raise ValueError("needs a 'goal', or a 'shift' with orders")
        return self

    @model_validator(mode="after")
    def _within_limits(self) -> ProblemFile:
        count = sum(map(len, self.objects.values()))
        if count > 1000:
            raise ValueError(f"{count} objects; at most 1000 are allowed")
        return self


class ClickInstruction(Schema):
    button: Literal["left", "middle", "right"]
    click_on: Name


class KeyInstruction(Schema):
    key: Annotated[str, Field(min_length=1, max_length=20)]
    at: Name | None = None


class ClickAction(Schema):
    name: Name
    input_instructions: ClickInstruction


class KeyAction(Schema):
    name: Name
    input_instructions: KeyInstruction


class InputFile(Schema):
    """The clicks and keys of actions (paper, appendix)."""

    schema_uri: str | None = Field(default=None, alias="$schema")
    extends: Extends = None
    mouse_click_actions: tuple[ClickAction, ...] = ()
    keyboard_actions: tuple[KeyAction, ...] = ()
