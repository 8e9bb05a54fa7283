"""What a person calls the things, actions and facts of a domain: part of its rendering file.

All of it is optional. Domain files have sentences of their own, by which actions are named and
language models are told what is so; they are part of a task's hash, and these words are not.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from robotouille.domain.schema import Name, Schema

__all__ = ["ActionWords", "KindName", "Language", "PredicateWords"]

Words = Annotated[str, Field(max_length=200)]


def _named(raw: Any) -> Any:
    return {"name": raw} if isinstance(raw, str) else raw


def _listed(raw: Any) -> Any:
    return raw if isinstance(raw, list | tuple) else [raw]


def _done(raw: Any) -> Any:
    return {"do": raw} if isinstance(raw, str) else raw


class KindName(Schema):
    """What a thing of a kind is called: the first name that applies. With `when` it is for things
    of which this predicate holds, as any of its arguments."""

    name: Words
    when: Name | None = None


class ActionWords(Schema):
    """What an action does to things, and how one gets there where more than one thing is missing.

    Both may name the action's parameters in braces.
    """

    do: Words
    how: Words = ""


class PredicateWords(Schema):
    """What to tell somebody whose action fails by a predicate: `needed`, where it has to hold and
    does not; `forbidden`, where it holds and must not. `{0}` is its first argument."""

    needed: Words = ""
    forbidden: Words = ""


class Language(Schema):
    """A person's words, by the names of the domain."""

    kinds: dict[
        str,
        Annotated[
            tuple[Annotated[KindName, BeforeValidator(_named)], ...], BeforeValidator(_listed)
        ],
    ] = Field(default={}, max_length=500)
    actions: dict[str, Annotated[ActionWords, BeforeValidator(_done)]] = Field(
        default={}, max_length=200
    )
    predicates: dict[str, PredicateWords] = Field(default={}, max_length=500)
