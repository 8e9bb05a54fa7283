"""Observations and actions as text, for agents that read."""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import product
from string import Formatter

from robotouille.domain.schema import DomainFile
from robotouille.errors import UnknownNameError, WrongArgumentError, did_you_mean
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.goal import Goal
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, atom_name
from robotouille.world.shift import Orders, ShiftRules


def observation(
    task: GroundTask,
    facts: int,
    actions: Iterable[GroundAction],
    ranks: Mapping[str, int] | None = None,
) -> str:
    """Return a paragraph for each object, then the valid actions and the goal.

    Args:
        ranks: The order of the objects; None for the task's own.
    """
    order = {name: i for i, name in enumerate(p.name for p in task.task.domain.predicate_defs)}
    things = task.objects_in(facts)
    if ranks is not None:
        things = tuple(sorted(things, key=lambda thing: ranks[thing.name]))
    lines: dict[str, list[str]] = {thing.name: [] for thing in things}
    rank = {name: i for i, name in enumerate(lines)}

    def position(atom: Atom) -> tuple[int, list[int]]:
        return order[atom[0]], [rank[name] for name in atom[1:]]

    for atom in sorted(task.table.true_atoms(facts), key=position):
        for argument, name in enumerate(atom[1:]):
            sentence = task.descriptor(atom[0], argument)
            if sentence:
                lines[name].append(sentence.format(*atom[1:]))
    paragraphs = [
        "\n".join([f"{thing.type.capitalize()} {thing.name}:", *lines[thing.name]])
        for thing in things
    ]
    paragraphs.append("\n".join(["Valid Actions:", *(action.sentence for action in actions)]))
    paragraphs.append(f"Goal: {task.task.goal_description}")
    return "\n\n".join(paragraphs)


def text_view(text: str, player: str | None, end: str) -> str:
    """Return an agent's message: its player, the observation, and what is to be done.

    Args:
        text: The observation.
        player: The agent's player; None for an agent that only watches.
        end: The result of `conditions_text` or `orders_text`.
    """
    you = [f"You are {player}."] if player is not None else []
    return "\n\n".join([*you, text, end])


def conditions_text(terms: Iterable[tuple[str, bool]]) -> str:
    """Return the conditions of the goal: the sentences of `goal_sentences` and their truth."""
    conditions = [f"- {sentence}: {'yes' if holds else 'no'}" for sentence, holds in terms]
    return "\n".join(["Goal conditions:", *conditions])


def orders_text(task: GroundTask, rules: ShiftRules, orders: Orders) -> str:
    """Return the menu of a shift, its open orders and its score."""
    menu = []
    for name, dish in rules.menu.items():
        worth = f"{dish.points} points, up to {dish.tip} more if it is early"
        menu.append(f"- {name} ({worth}; {dish.penalty} less if the order expires):")
        menu += [f"  - {sentence}" for sentence in goal_sentences(task, rules.goal(name))]
    waiting = [
        f"- {rules.dish_name(order.number)}: {order.due - orders.time} steps left"
        for order in orders.open
    ]
    time = f"step {orders.time} of {rules.steps}"
    score = f"{orders.score} points, {orders.served} served, {orders.expired} expired"
    return "\n".join(
        ["Menu:", *menu, "", f"Orders ({time}; {score}):", *(waiting or ["- none at the moment"])]
    )


def goal_sentences(task: GroundTask, goal: Goal) -> tuple[str, ...]:
    """Return a sentence for every condition of a goal, in the problem's order.

    `some lettuce` is any lettuce. If the goal needs several objects of a kind, they are called
    `bread A`, `bread B` and so on, and must be different objects.
    """
    variables = goal.variables
    by_kind: dict[str, list[int | str]] = {}
    for variable in variables.values():
        if variable.fixed is None:
            by_kind.setdefault(variable.kind, []).append(variable.id)
    names = {v.id: v.fixed for v in variables.values() if v.fixed is not None}
    for kind, alike in by_kind.items():
        for number, identifier in enumerate(alike):
            names[identifier] = f"{kind} {_letters(number)}" if alike[1:] else f"some {kind}"
    return tuple(
        describe(task.task.domain, (term.predicate, *(names[i] for i in term.ids)))
        for term in goal.terms
    )


def _letters(number: int) -> str:
    """Return A to Z, then AA and so on."""
    rest, letter = divmod(number, 26)
    return (_letters(rest - 1) if rest else "") + chr(ord("A") + letter)


def describe(domain: DomainFile, atom: Atom) -> str:
    """Return a fact as a sentence, such as `lettuce1 is cut`."""
    definition = next((p for p in domain.predicate_defs if p.name == atom[0]), None)
    descriptors = definition.language_descriptors if definition else {}
    sentence = descriptors.get("0") or next(iter(descriptors.values()), "")
    return sentence.format(*atom[1:]) if sentence else atom_name(atom)


MAX_SENTENCE = 2_000
"""Length of a text beyond which it cannot be an action, so that it need not be parsed."""
MAX_QUOTED = 200
"""Number of characters of a text that an error quotes."""
MAX_ALIKE = 8
"""Number of valid sentences that a text is compared with, letter by letter, for suggestions. A
server receives hundreds of texts per second, and comparing with all of them takes milliseconds."""
MAX_EXAMPLES = 2
"""Number of valid sentences that an error lists if none is similar."""

PAIRS = ("()", "[]", "{}", "<>", '""', "''", "``", "“”", "‘’", "«»")
CALL = re.compile(r"([^\s()]+)\((.*)\)")


def find_by_exact_sentence(sentence: str, valid: Iterable[GroundAction]) -> GroundAction | None:
    """Return the action with exactly this sentence, or None.

    Raises:
        UnknownNameError: Several actions have this sentence.
        WrongArgumentError: The sentence is not a string.
    """
    if not isinstance(sentence, str):
        raise WrongArgumentError(f"expected the sentence of an action, found {sentence!r}")
    return _only([action for action in valid if action.sentence == sentence], sentence)


def find_valid_by_sentence(sentence: str, valid: Sequence[GroundAction]) -> GroundAction | None:
    """Return the action that a sentence names, or None.

    Case, blanks, a final full stop and enclosing quotes or brackets are ignored, and calls such as
    `move(robot1, table1, table2)` are accepted.

    Raises:
        UnknownNameError: The sentence names several actions.
        WrongArgumentError: The sentence is not a string.
    """
    found = find_by_exact_sentence(sentence, valid)
    if found is not None or len(sentence) > MAX_SENTENCE:
        return found
    wanted = plain(sentence)
    call = _call(wanted)
    matches = [a for a in valid if plain(a.sentence) == wanted or (call and call == _call(str(a)))]
    return _only(matches, sentence)


def find_by_sentence(sentence: str, task: GroundTask) -> GroundAction | None:
    """Return the action of a task, valid now or not, that a sentence names, or None.

    An action can be found by its sentence only if the sentence names all its arguments.

    Raises:
        UnknownNameError: The sentence names several actions.
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
    """Return the error for a sentence: why its action is not valid, or similar valid actions."""
    # A model's answer can be long; an error must not repeat all of it.
    cut = sentence if len(sentence) <= MAX_QUOTED else f"{sentence[:MAX_QUOTED]}…"
    if reasons:
        return UnknownNameError(f"no valid action {cut!r} now: {'; '.join(reasons)}")
    wanted = plain(cut)
    words = {*wanted.split()}
    sentences = dict.fromkeys(action.sentence for action in valid)
    alike = heapq.nlargest(
        MAX_ALIKE,
        sentences,
        key=lambda known: len(words.intersection(plain(known).split())),
    )
    near = did_you_mean(wanted, alike, most=3) or _examples(list(sentences))
    return UnknownNameError(f"no valid action {cut!r}{near}")


def _examples(sentences: Sequence[str]) -> str:
    """Return a clause with some of the valid sentences."""
    if not sentences:
        return "; no action is valid now"
    more = f" and {len(sentences) - MAX_EXAMPLES} more" if len(sentences) > MAX_EXAMPLES else ""
    return f"; valid are {', '.join(map(repr, sentences[:MAX_EXAMPLES]))}{more}"


def plain(sentence: str) -> str:
    """Return a sentence without case, extra blanks, full stops and enclosing quotes or brackets."""
    text = " ".join(sentence.split()).casefold()
    # Models wrap sentences in several layers, such as `"(Move robot1 to table2.)"`.
    before = None
    while before != text:
        before = text
        text = text.rstrip(". ")
        if len(text) > 1 and text[0] + text[-1] in PAIRS:
            text = text[1:-1].strip()
    return text


def _call(text: str) -> str:
    """Return a call such as `move(a,b)` without blanks, quotes and case; empty for other texts."""
    return re.sub(r"[\s\"'`]", "", text).casefold() if CALL.fullmatch(text) else ""


def _only(actions: Sequence[GroundAction], sentence: str) -> GroundAction | None:
    if len(actions) < 2:
        return actions[0] if actions else None
    listed = " or ".join(map(str, actions[:2]))
    raise UnknownNameError(f"{sentence[:MAX_QUOTED]!r} is ambiguous: {listed}")


def _arguments(schema: ActionSchema, wanted: str) -> Iterator[list[str]]:
    """Yield the words of an action's arguments if a text names the action."""
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
    """Yield the actions with arguments of these names, ignoring case."""
    pools = [
        [name for name in sorted(task.thing_names) if name.casefold() == word] for word in words
    ]
    for names in product(*pools):
        kinds = [kind for _, kind in schema.parameters]
        if [task.thing(name).type for name in names] == kinds:
            yield task.action(schema.name, *names)


@lru_cache(maxsize=1_000)
def _pattern(template: str) -> tuple[re.Pattern[str], tuple[str, ...]]:
    """Return a pattern for a template's plain sentences, and the placeholder of each group."""
    groups: dict[str, int] = {}
    pieces = []
    for literal, name, _, _ in Formatter().parse(" ".join(template.split()).rstrip(". ")):
        pieces.append(re.escape(literal.casefold()))
        if name is not None:
            pieces.append(rf"\{groups[name]}" if name in groups else r"(\S+)")
            groups.setdefault(name, len(groups) + 1)
    return re.compile("".join(pieces)), tuple(groups)
