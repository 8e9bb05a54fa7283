"""The objects of a task, including objects that play can create, and their atoms.

The objects of a world can grow, and then values computed from them are out of date
(`GroundObjects._grown`). Growth adds generations: one more object of every kind that can be
created, with its atoms after all others, so that no bit ever moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

from robotouille.domain.derived import parameter_types
from robotouille.domain.schema import Creation, Deletion, EffectDef
from robotouille.domain.task import Task
from robotouille.errors import (
    TooManyObjectsError,
    UnknownNameError,
    WrongWorldError,
    did_you_mean,
)
from robotouille.world.grounding.atoms import EXISTS, USED, AtomTable
from robotouille.world.grounding.objects import Floor, Object, initial_facts, place_objects

MAX_CREATED = 500
"""Largest number of one created kind that names from outside can make a world reserve."""
MAX_GROWTH = 12_000
"""Largest number of atoms that created objects can add to a world.

A step that creates an object takes 0.02 s then. In a domain with a predicate of two created
objects, the number of atoms grows with the square of the objects.
"""


class GroundObjects:
    """The objects and atoms of a task, and the objects that exist in a state."""

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
        # The first created objects have atoms from the start, so most episodes never add any.
        if self._creations:
            self._add_generation()

    @cached_property
    def floor(self) -> Floor:
        """The kitchen's floor."""
        problem, stations = self.task.problem, set(self.task.domain.station_types)
        return Floor(problem.width, problem.height, self.placed, stations)

    def thing(self, name: str) -> Object:
        """Return an object by its name.

        Raises:
            UnknownNameError: There is no such object.
        """
        thing = self._things.get(name) if isinstance(name, str) else None
        if thing is None:
            raise UnknownNameError(f"no object {name!r}{did_you_mean(name, self._things)}")
        return thing

    @property
    def thing_names(self) -> frozenset[str]:
        """Names of all objects, including objects that may not exist yet."""
        return frozenset(self._things)

    def all_objects(self) -> tuple[Object, ...]:
        """Return the objects of the problem and the created objects that have atoms so far."""
        return tuple(self._things.values())

    def objects_in(self, facts: int) -> tuple[Object, ...]:
        """Return the objects that exist in a state, by type, then by number."""
        return tuple(o for o in self._sorted_things if self.exists(o, facts))

    @cached_property
    def _sorted_things(self) -> list[Object]:
        """All objects by type, then by number."""
        order = {kind: i for i, kind in enumerate(self.task.domain.object_types)}
        return sorted(self._things.values(), key=lambda o: order[o.type])

    def used_objects(self, facts: int) -> list[str]:
        """Return the names of created objects that exist or existed; they are never reused."""
        return [
            name
            for name, thing in self._things.items()
            if thing.tile is None and facts & self.table.bit[(USED, name)]
        ]

    def _check_existence(self, facts: int) -> None:
        """Check that facts mention only objects that exist in them.

        Raises:
            WrongWorldError: They mention another object.
        """
        for name, there, about in self._transient_masks:
            if facts & about and not facts & there:
                raise WrongWorldError(f"facts about {name}, which does not exist in them")

    @cached_property
    def _transient_masks(self) -> tuple[tuple[str, int, int], ...]:
        """Each object that can be created or deleted, with masks of its existence and its atoms."""
        table = self.table
        return tuple(
            (name, table.bit[(EXISTS, name)], table.mentions(name) & ~table.internal)
            for name, thing in self._things.items()
            if thing.type in table.transient
        )

    def exists(self, thing: Object, facts: int) -> bool:
        """Return whether an object exists in a state."""
        return thing.type not in self.table.transient or bool(
            facts & self.table.bit[(EXISTS, thing.name)]
        )

    # Growth

    @property
    def table_sizes(self) -> tuple[int, ...]:
        """The number of atoms at first and after each generation."""
        return tuple(self._sizes)

    def table_size(self, facts: int) -> int:
        """Return the number of atoms that are needed to read these facts.

        It depends only on the facts, not on what other episodes of the world have created.
        """
        length = facts.bit_length()
        return next(size for size in self._sizes if length <= size)

    def make_room(self, wanted: Mapping[str, int]) -> None:
        """Assign bits to at least the wanted number of objects of each creatable kind."""
        try:
            for kind, _ in self._creations:
                while sum(o.kind == kind for o in self._things.values()) < wanted.get(kind, 0):
                    self._add_generation()
        finally:
            self._grown()

    def make_room_for_another(self) -> None:
        """Assign bits to one more object of every kind that can be created."""
        if self._creations:
            self._add_generation()
            self._grown()

    def admit(self, names: Iterable[str]) -> None:
        """Make room for the created objects among names that come from another process.

        Names that cannot belong to this world are ignored.

        Raises:
            UnknownNameError: A name is not a string.
            WrongWorldError: A number is greater than `MAX_CREATED`, which would fill the memory.
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
                raise WrongWorldError(
                    f"{name} exceeds the limit of {MAX_CREATED} objects of a kind"
                )
            wanted[kind] = max(wanted.get(kind, 0), int(digits))
        if wanted:
            self.make_room(wanted)

    def _make_room_for(self, facts: int, most: int | None = None) -> None:
        """Add generations until every bit of some facts has an atom, but at most `most`."""
        # Facts have a `USED` bit for each created object, so valid facts never need more
        # generations than they have bits. Invalid facts must not make the table grow forever.
        given = facts.bit_count() if self._creations else 0
        most = given if most is None else min(given, most)
        while facts.bit_length() > len(self.table.atoms) and len(self._sizes) <= most:
            self.make_room_for_another()

    def _next_created(self, kind: str, type_: str, facts: int) -> str:
        """Return the name of the next created object, whose number was not used before."""
        while True:
            for thing in self._things.values():
                made = thing.tile is None and (thing.kind, thing.type) == (kind, type_)
                if made and not facts & self.table.bit[(USED, thing.name)]:
                    return thing.name
            self.make_room_for_another()

    def _add_generation(self) -> None:
        new: list[Object] = []
        for kind, type_ in self._creations:
            things = (*self._things.values(), *new)
            number = 1 + sum(thing.kind == kind for thing in things)
            new.append(Object(f"{kind}{number}", kind, type_))
        if self.table.size_with(new) > self._sizes[0] + MAX_GROWTH:
            kinds = ", ".join(sorted({thing.kind for thing in new}))
            raise TooManyObjectsError(
                f"too many objects have been created ({kinds}): the facts about them exceed "
                f"{MAX_GROWTH:,}"
            )
        self._things.update((thing.name, thing) for thing in new)
        self.table.add(new)
        self._sizes.append(len(self.table.atoms))
        for outdated in ("_transient_masks", "_sorted_things"):
            self.__dict__.pop(outdated, None)

    def _grown(self) -> None:
        """Discard values that were computed from all objects. Subclasses extend this."""


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
