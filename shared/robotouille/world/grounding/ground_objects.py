"""The objects of a task and their atoms: those of the problem, and those that play may create.

This is the only thing about a world that grows by need and changes what others compute from it
(`GroundObjects._grown`). It grows by generations: each has one more object of every kind that can
be created, and a block of atoms about them behind all others, so that no bit ever moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

from robotouille.domain.checks.derived import parameter_types
from robotouille.domain.schema import Creation, Deletion, EffectDef
from robotouille.domain.task import Task
from robotouille.errors import UnknownNameError, WrongWorldError, did_you_mean
from robotouille.world.grounding.atoms import EXISTS, USED, AtomTable
from robotouille.world.grounding.floor import Floor
from robotouille.world.grounding.objects import Object, initial_facts, place_objects

__all__ = ["MAX_CREATED", "GroundObjects"]

MAX_CREATED = 500
"""Objects of one kind for which a course of play from elsewhere is given room."""


class GroundObjects:
    """The objects and atoms of a task, and which objects there are in some facts."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.placed = place_objects(task)
        self.players = tuple(o.name for o in self.placed if o.type in task.domain.player_types)
        self._things: dict[str, Object] = {thing.name: thing for thing in self.placed}
        self._creations = sorted(set(_creations(task)))
        transient = frozenset({kind for _, kind in self._creations} | set(_deletions(task)))
        facts = initial_facts(task, self.placed)
        self.table = AtomTable(task.domain, transient, facts)
        self.table.add(self.placed)
        self._sizes = [len(self.table.atoms)]
        existing = [o.name for o in self.placed if o.type in transient]
        born = [(flag, name) for name in existing for flag in (EXISTS, USED)]
        self.initial_facts = self.table.mask([*facts, *born])
        if self._creations:
            self._add_generation()

    @cached_property
    def floor(self) -> Floor:
        """The kitchen's floor, for walking."""
        problem, stations = self.task.problem, set(self.task.domain.station_types)
        return Floor(problem.width, problem.height, self.placed, stations)

    def thing(self, name: str) -> Object:
        """The object of a name.

        Raises:
            UnknownNameError: There is none.
        """
        thing = self._things.get(name) if isinstance(name, str) else None
        if thing is None:
            raise UnknownNameError(f"no object {name!r}{did_you_mean(name, self._things)}")
        return thing

    @property
    def thing_names(self) -> frozenset[str]:
        """The names of all objects there is room for."""
        return frozenset(self._things)

    def all_objects(self) -> tuple[Object, ...]:
        """The objects of the problem, and those that play may create and has room for so far."""
        return tuple(self._things.values())

    def objects_in(self, facts: int) -> tuple[Object, ...]:
        """The objects that exist in a state, by type, then as numbered."""
        there = [o for o in self._things.values() if self.exists(o, facts)]
        order = {kind: i for i, kind in enumerate(self.task.domain.object_types)}
        return tuple(sorted(there, key=lambda o: order[o.type]))

    def used_objects(self, facts: int) -> list[str]:
        """The created objects that exist or did: their names are never given again."""
        return [
            name
            for name, thing in self._things.items()
            if thing.tile is None and facts & self.table.bit[(USED, name)]
        ]

    def _check_existence(self, facts: int) -> None:
        """Raises WrongWorldError for facts about an object that does not exist in them."""
        for name, there, about in self._said_of_transients:
            if facts & about and not facts & there:
                raise WrongWorldError(f"facts about {name}, which does not exist in them")

    @cached_property
    def _said_of_transients(self) -> tuple[tuple[str, int, int], ...]:
        """Of each object that may come or go: that it exists, and all else there is to say."""
        table = self.table
        return tuple(
            (name, table.bit[(EXISTS, name)], table.mentions(name) & ~table.internal)
            for name, thing in self._things.items()
            if thing.type in table.transient
        )

    def exists(self, thing: Object, facts: int) -> bool:
        """Whether an object is there."""
        return thing.type not in self.table.transient or bool(
            facts & self.table.bit[(EXISTS, thing.name)]
        )

    # Growth

    @property
    def table_sizes(self) -> tuple[int, ...]:
        """The sizes that the table of atoms had: at first, and after each generation."""
        return tuple(self._sizes)

    def table_size(self, facts: int) -> int:
        """How many atoms of the table one must know to read these facts.

        It depends on the facts alone, not on what other courses of play have created.
        """
        length = facts.bit_length()
        return next(size for size in self._sizes if length <= size)

    def make_room(self, wanted: Mapping[str, int]) -> None:
        """Give bits to as many objects of each creatable kind as are wanted."""
        for kind, _ in self._creations:
            while sum(o.kind == kind for o in self._things.values()) < wanted.get(kind, 0):
                self._add_generation()
        self._grown()

    def make_room_for_another(self) -> None:
        """Give bits to one more object of every kind that can be created, if any can."""
        if self._creations:
            self._add_generation()
            self._grown()

    def admit(self, names: Iterable[str]) -> None:
        """Make room for the created objects among these names, as somebody else's course of play
        may have. A name that can be none of this world is left alone.

        Raises:
            UnknownNameError: A name is no string.
            WrongWorldError: An object would be more than `MAX_CREATED` of its kind.
        """
        creatable = {kind for kind, _ in self._creations}
        wanted: dict[str, int] = {}
        for name in names:
            if not isinstance(name, str):
                raise UnknownNameError(f"no object {name!r}")
            kind = name.rstrip("0123456789")
            digits = name[len(kind) :]
            if name in self._things or kind not in creatable or not digits:
                continue
            if len(digits) > 6 or int(digits) > MAX_CREATED:
                raise WrongWorldError(f"{name} would be more than {MAX_CREATED} of a kind")
            wanted[kind] = max(wanted.get(kind, 0), int(digits))
        if wanted:
            self.make_room(wanted)

    def _make_room_for(self, facts: int, most: int | None = None) -> None:
        """Have an atom for every bit of some facts, if they can be of this task at all, and need
        no more than `most` generations of created objects."""
        # Each generation in use has a name that was given: no facts need more room than that.
        given = facts.bit_count() if self._creations else 0
        most = given if most is None else min(given, most)
        while facts.bit_length() > len(self.table.atoms) and len(self._sizes) <= most:
            self.make_room_for_another()

    def _next_created(self, kind: str, type_: str, facts: int) -> str:
        """The name of the next object of a kind; its number was never used in this course."""
        while True:
            for thing in self._things.values():
                made = thing.tile is None and (thing.kind, thing.type) == (kind, type_)
                if made and not facts & self.table.bit[(USED, thing.name)]:
                    return thing.name
            self.make_room_for_another()

    def _add_generation(self) -> None:
        new = []
        for kind, type_ in self._creations:
            number = 1 + sum(thing.kind == kind for thing in self._things.values())
            thing = Object(f"{kind}{number}", kind, type_)
            self._things[thing.name] = thing
            new.append(thing)
        self.table.add(new)
        self._sizes.append(len(self.table.atoms))
        self.__dict__.pop("_said_of_transients", None)

    def _grown(self) -> None:
        """There is room for more objects: what was computed from all of them is out of date."""


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
