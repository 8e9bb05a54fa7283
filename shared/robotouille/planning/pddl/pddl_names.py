"""Names in PDDL: case does not count there, few characters are allowed, and some words are taken.

Every name gets the nearest one that is allowed and free, always the same for the same world, so
the way back is a look-up.
"""

from __future__ import annotations

import re

from robotouille.world.world import World

__all__ = ["PddlNames"]

_TAKEN = frozenset((
    "all", "and", "assign", "at", "decrease", "define", "domain", "either", "end", "exists",
    "forall", "imply", "increase", "maximize", "metric", "minimize", "not", "number", "object",
    "or", "over", "problem", "scale-down", "scale-up", "start", "total-time", "when",
))  # fmt: skip


class PddlNames:
    """What types, predicates, actions and objects of a world are called in PDDL, and back."""

    def __init__(self, world: World) -> None:
        self._given: dict[tuple[str, str], str] = {}
        self._owner: dict[tuple[str, str], str] = {}
        self.domain = _allowed(world.task.domain.name)
        self.problem = _allowed(world.task.name)
        self.type("object")
        for predicate in world.task.domain.predicate_defs:
            self.predicate(predicate.name)
        for action in world.task.domain.action_defs:
            self.action(action.name)
        for kind in world.task.domain.object_types:
            self.type(f"={kind}")
        for thing in world.all_objects():
            self.symbol(thing.name)

    def type(self, name: str) -> str:
        return name if name in ("object", "number") else self._give("type", name)

    def predicate(self, name: str) -> str:
        return self._give("predicate", name)

    def action(self, name: str) -> str:
        return self._give("action", name)

    def symbol(self, name: str) -> str:
        """An object, or a variable, which begins with `?`."""
        if name.startswith("?"):
            return "?" + self._give("variable", name[1:])
        return self._give("object", name)

    def term(self, term: tuple[str, ...]) -> str:
        """`(item_on lettuce1 table2)`."""
        head = "=" if term[0] == "=" else self.predicate(term[0])
        return f"({' '.join([head, *map(self.symbol, term[1:])])})"

    def original(self, category: str, name: str) -> str:
        """The name that was said as `name`; KeyError if none was."""
        return self._owner[(category, name.lower())]

    def _give(self, category: str, name: str) -> str:
        given = self._given.get((category, name))
        if given is None:
            base = given = _allowed(name)
            number = 1
            while given in _TAKEN or (category, given) in self._owner:
                number += 1
                given = f"{base}-{number}"
            self._given[(category, name)] = given
            self._owner[(category, given)] = name
        return given


def _allowed(name: str) -> str:
    text = re.sub(r"[^a-z0-9_-]+", "-", name.lower()).strip("-")
    return text if text[:1].isalpha() else f"x{text}"
