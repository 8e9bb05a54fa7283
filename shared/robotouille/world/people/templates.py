"""Words with places for others, as languages have them."""

from __future__ import annotations

from string import Formatter

__all__ = ["capitalised", "filled", "parameters"]


def filled(template: str, *called: str, **words: str) -> str:
    """A template with its words; empty where it asks for others than there are."""
    try:
        return template.format(*called, **words)
    except (AttributeError, LookupError, ValueError):
        return ""


def parameters(template: str) -> set[str]:
    """What a template asks for; nothing where it is none."""
    try:
        return {name for _, name, _, _ in Formatter().parse(template) if name}
    except ValueError:
        return set()


def capitalised(words: str) -> str:
    """The same with a capital at its beginning."""
    return words[:1].upper() + words[1:]
