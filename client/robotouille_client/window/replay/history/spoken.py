"""What was done and refused in a step, in the words of a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from robotouille.domain.rendering import Language
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.wording import Wording
from robotouille.world.unmet import Unmet, UnmetKind, from_words
from robotouille.world.world import State, World

__all__ = ["Spoken"]


class Spoken:
    """Says a world's actions and reasons in a language."""

    def __init__(self, world: World, language: Language) -> None:
        self._world = world
        self._language = language

    def move(self, action: Sequence[str], state: State, names: Mapping[str, str]) -> str:
        """A recorded action: its name, then its arguments."""
        try:
            return self.action(self._world.action(*action), state, names)
        except (RobotouilleError, TypeError):
            return " ".join(action)

    def action(self, action: GroundAction, state: State, names: Mapping[str, str]) -> str:
        """An action of the world, in a state in which it is done."""
        return self._wording(names).action(action, state)

    def attempt(self, note: Mapping[str, Any], state: State, names: Mapping[str, str]) -> str:
        """What a `rejected` note says was asked for; its own text if that is no action."""
        try:
            action = self._world.parse(state, note["player"], note["action"], valid=False)
        except RobotouilleError:
            return str(note.get("text") or note["action"])
        return self.action(action, state, names)

    def reasons(
        self,
        words: Sequence[str],
        why: Sequence[Mapping[str, Any]],
        state: State,
        names: Mapping[str, str],
    ) -> tuple[str, ...]:
        """Why not: the recorded words, where there are no values beside them."""
        return self.unmet(_unmet(words, why), state, names)

    def unmet(
        self, unmet: Sequence[Unmet], state: State, names: Mapping[str, str]
    ) -> tuple[str, ...]:
        """Why not: what is unmet in a state."""
        wording = self._wording(names)
        return tuple(wording.reason(each, state) for each in unmet)

    def _wording(self, names: Mapping[str, str]) -> Wording:
        return Wording(self._world, self._language, None, names)


def _unmet(words: Sequence[str], why: Sequence[Mapping[str, Any]]) -> tuple[Unmet, ...]:
    known = set(UnmetKind)
    if len(words) != len(why) or any(row["kind"] not in known for row in why):
        return from_words(*words)
    return tuple(
        Unmet(
            UnmetKind(row["kind"]),
            text,
            row.get("predicate", ""),
            tuple(row.get("objects", ())),
            row.get("expected", True),
        )
        for text, row in zip(words, why, strict=True)
    )
