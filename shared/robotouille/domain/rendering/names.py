"""Which names of its domain a rendering says: kinds, predicates, actions and their parameters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from string import Formatter
from typing import Literal

from robotouille.domain.rendering.art import Art
from robotouille.domain.rendering.rendering_file import Language, RenderingFile

__all__ = ["DomainName", "domain_names"]


@dataclass(frozen=True, slots=True)
class DomainName:
    """A name that a rendering has from its domain.

    `place` is where it stands in the file, `definition` the fields that lead to what says it.
    Those of a picture are `about` a kind of thing, parameters about an action.
    """

    what: Literal["kind", "predicate", "action", "parameter"]
    name: str
    place: str
    definition: tuple[str, ...]
    about: str = ""


def domain_names(rendering: RenderingFile) -> Iterator[DomainName]:
    """Every name that a rendering has from its domain."""
    for field in ("progress", "during"):
        for action in getattr(rendering, field):
            yield DomainName("action", action, f"{field}.{action}", (field, action))
    for kind in rendering.player:
        yield DomainName("kind", kind, f"player.{kind}", ("player", kind))
    for role in ("item", "station", "container"):
        for kind, entity in getattr(rendering, role).entities.items():
            definition = (role, "entities", kind)
            place = ".".join((*definition, "assets"))
            yield DomainName("kind", kind, place, definition)
            for where, art in entity.assets.parts(place):
                yield from _of_picture(art, where, definition, kind)
            for name, art in entity.assets.named.items():
                if art.named:  # Pictures of it while it holds something of that kind.
                    yield DomainName("kind", name, f"{place}.{name}", definition)
    yield from _of_language(rendering.language)


def _of_picture(
    art: Art, place: str, definition: tuple[str, ...], kind: str
) -> Iterator[DomainName]:
    for trait in art.predicates:
        yield DomainName("predicate", trait.name, place, definition, kind)
        for param in filter(None, trait.params):
            yield DomainName("kind", param, place, definition)
    for action in art.during:
        yield DomainName("action", action, place, definition, kind)


def _of_language(language: Language) -> Iterator[DomainName]:
    for kind, names in language.kinds.items():
        definition = ("language", "kinds", kind)
        place = ".".join(definition)
        yield DomainName("kind", kind, place, definition)
        for each in names:
            if each.when is not None:
                yield DomainName("predicate", each.when, place, definition)
    for action, words in language.actions.items():
        definition = ("language", "actions", action)
        place = ".".join(definition)
        yield DomainName("action", action, place, definition)
        for name in _in_braces(words.do) | _in_braces(words.how):
            yield DomainName("parameter", name, place, definition, action)
    for predicate in language.predicates:
        definition = ("language", "predicates", predicate)
        yield DomainName("predicate", predicate, ".".join(definition), definition)


def _in_braces(template: str) -> set[str]:
    try:
        return {name for _, name, _, _ in Formatter().parse(template) if name}
    except ValueError:
        return set()
