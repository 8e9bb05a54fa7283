"""Sentences to actions: exactly, or as people and language models write them.

A sentence is read tolerantly: a full stop at its end, brackets and quotes around it, blanks and
case do not matter, and `move(robot1, table1, table2)` says the same as the sentence of that
action. What is exactly the sentence of one valid action is found first, and costs no more than
looking.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import product
from string import Formatter

from robotouille.errors import UnknownNameError, WrongArgumentError, did_you_mean
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.ground_task import GroundTask

__all__ = ["MAX_SENTENCE", "known", "no_valid_action", "plain", "said", "said_exactly"]

MAX_SENTENCE = 2_000
"""Characters beyond which a text is not looked at: no action takes so many to say."""
MAX_QUOTED = 200
"""Characters of a text that an error quotes."""

PAIRS = ("()", "[]", "{}", "<>", '""', "''", "``", "“”", "‘’", "«»")
CALL = re.compile(r"([^\s()]+)\((.*)\)")


def said_exactly(sentence: str, valid: Iterable[GroundAction]) -> GroundAction | None:
    """The one of some actions whose sentence this is, character for character.

    Raises:
        UnknownNameError: It is the sentence of several.
        WrongArgumentError: It is no string.
    """
    if not isinstance(sentence, str):
        raise WrongArgumentError(f"expected the sentence of an action, found {sentence!r}")
    return _only([action for action in valid if action.sentence == sentence], sentence)


def said(sentence: str, valid: Sequence[GroundAction]) -> GroundAction | None:
    """The one of some actions that a sentence says, read tolerantly.

    Raises:
        UnknownNameError: It says several.
        WrongArgumentError: It is no string.
    """
    found = said_exactly(sentence, valid)
    if found is not None or len(sentence) > MAX_SENTENCE:
        return found
    wanted = plain(sentence)
    call = _call(wanted)
    matches = [a for a in valid if plain(a.sentence) == wanted or (call and call == _call(str(a)))]
    return _only(matches, sentence)


def known(sentence: str, task: GroundTask) -> GroundAction | None:
    """The one action of a task, valid at present or not, that a sentence says, read tolerantly.

    Only actions whose sentence names all their arguments are found by it.

    Raises:
        UnknownNameError: It says several.
    """
    if len(sentence) > MAX_SENTENCE:
        return None
    wanted = plain(sentence)
    found = dict.fromkeys(
        action
        for schema in task.schemas
        for words in _arguments(schema, wanted)
        for action in _grounded(task, schema, words)
    )
    return _only(list(found), sentence)


def no_valid_action(
    sentence: str, valid: Iterable[GroundAction], reasons: Sequence[str] = ()
) -> UnknownNameError:
    """What to raise for a sentence: why its action is not valid, or the nearest that are."""
    cut = sentence if len(sentence) <= MAX_QUOTED else f"{sentence[:MAX_QUOTED]}…"
    if reasons:
        return UnknownNameError(f"no valid action {cut!r} now: {'; '.join(reasons)}")
    near = did_you_mean(plain(cut), [action.sentence for action in valid], most=3)
    return UnknownNameError(f"no valid action {cut!r}{near}")


def plain(sentence: str) -> str:
    """A sentence without what does not matter: see the module."""
    text = " ".join(sentence.split()).casefold()
    before = None
    while before != text:
        before = text
        text = text.rstrip(". ")
        if len(text) > 1 and text[0] + text[-1] in PAIRS:
            text = text[1:-1].strip()
    return text


def _call(text: str) -> str:
    """`move(a,b)` without blanks, quotes and case; empty if it is no such thing."""
    return re.sub(r"[\s\"'`]", "", text).casefold() if CALL.fullmatch(text) else ""


def _only(actions: Sequence[GroundAction], sentence: str) -> GroundAction | None:
    if len(actions) < 2:
        return actions[0] if actions else None
    listed = " or ".join(map(str, actions[:2]))
    raise UnknownNameError(f"{sentence[:MAX_QUOTED]!r} may be {listed}: say which")


def _arguments(schema: ActionSchema, wanted: str) -> Iterator[list[str]]:
    """The words that stand for the arguments of an action, if a text is one of that action."""
    names = [name for name, _ in schema.parameters]
    pattern, placeholders = _pattern(schema.definition.language_description)
    match = pattern.fullmatch(wanted) if {*names} <= {*placeholders} else None
    if match is not None:
        words_of = dict(zip(placeholders, match.groups(), strict=True))
        yield [words_of[name] for name in names]
    call = CALL.fullmatch(wanted)
    if call and call[1] == schema.name.casefold():
        words = [plain(word) for word in call[2].split(",")] if call[2].strip() else []
        if len(words) == len(names):
            yield words


def _grounded(task: GroundTask, schema: ActionSchema, words: list[str]) -> Iterator[GroundAction]:
    """The actions whose arguments are called so, whatever the case of their names."""
    pools = [
        [name for name in sorted(task.thing_names) if name.casefold() == word] for word in words
    ]
    for names in product(*pools):
        kinds = [kind for _, kind in schema.parameters]
        if [task.thing(name).type for name in names] == kinds:
            yield task.action(schema.name, *names)


@lru_cache(maxsize=1_000)
def _pattern(template: str) -> tuple[re.Pattern[str], tuple[str, ...]]:
    """What the sentences of a template look like once they are plain; its placeholders in order,
    a group for each."""
    groups: dict[str, int] = {}
    pieces = []
    for literal, name, _, _ in Formatter().parse(" ".join(template.split()).rstrip(". ")):
        pieces.append(re.escape(literal.casefold()))
        if name is not None:
            pieces.append(rf"\{groups[name]}" if name in groups else r"(\S+)")
            groups.setdefault(name, len(groups) + 1)
    return re.compile("".join(pieces)), tuple(groups)
