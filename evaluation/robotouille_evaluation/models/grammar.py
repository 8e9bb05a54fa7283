"""Grammars (GBNF, of llama.cpp) that let a model say nothing but a valid action."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.errors import WrongArgumentError

__all__ = ["action_grammar"]


def action_grammar(actions: Iterable[str], reasoning: int = 0) -> str:
    """A grammar of answers `Action: …` with one of some sentences.

    Args:
        actions: The sentences.
        reasoning: Characters of free text in a line `Reasoning: …` before it; none if 0.

    Raises:
        WrongArgumentError: No action at all, which no answer could satisfy.
    """
    literals = [literal(action) for action in dict.fromkeys(actions)]
    if not literals:
        raise WrongArgumentError("expected at least one action for a grammar, found none")
    thought = f'"Reasoning: " [^\\n]{{1,{reasoning}}} "\\n" ' if reasoning else ""
    return f'root ::= {thought}"Action: " action\naction ::= {" | ".join(literals)}\n'


def literal(text: str) -> str:
    """A text as a literal of the grammar."""
    return '"' + "".join(map(_escaped, text)) + '"'


def _escaped(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    if character.isprintable():
        return character
    code = ord(character)
    return f"\\x{code:02X}" if code < 256 else f"\\U{code:08X}"
