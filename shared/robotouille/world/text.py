"""The observation in words: the benchmark's interface to agents that read."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.domain.schema import DomainFile
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, atom_name

__all__ = ["describe", "goal_sentences", "observation", "text_view"]


def observation(task: GroundTask, facts: int, actions: Iterable[GroundAction]) -> str:
    """A paragraph for each object, the valid actions of a player and the goal."""
    order = {name: i for i, name in enumerate(p.name for p in task.task.domain.predicate_defs)}
    things = task.objects_in(facts)
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


def text_view(text: str, player: str | None, terms: Iterable[tuple[str, bool]]) -> str:
    """What an agent that reads is sent: who it is, the observation, and each condition of the goal
    with whether it holds.

    Args:
        text: The observation.
        player: Who the agent is; None for one that only watches.
        terms: The conditions, as `goal_sentences` says them.
    """
    you = [f"You are {player}."] if player is not None else []
    conditions = [f"- {sentence}: {'yes' if holds else 'no'}" for sentence, holds in terms]
    return "\n\n".join([*you, text, "\n".join(["Goal conditions:", *conditions])])


def goal_sentences(task: GroundTask) -> tuple[str, ...]:
    """Every condition of the goal in words, in the problem's order.

    `some lettuce` is any one; where the goal speaks of several of a kind, they are `bread A`,
    `bread B` and so on, and all different.
    """
    variables = task.goal.variables
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
        for term in task.goal.terms
    )


def _letters(number: int) -> str:
    """A to Z, then AA and so on."""
    rest, letter = divmod(number, 26)
    return (_letters(rest - 1) if rest else "") + chr(ord("A") + letter)


def describe(domain: DomainFile, atom: Atom) -> str:
    """A fact in words: `lettuce1 is cut`."""
    definition = next((p for p in domain.predicate_defs if p.name == atom[0]), None)
    descriptors = definition.language_descriptors if definition else {}
    sentence = descriptors.get("0") or next(iter(descriptors.values()), "")
    return sentence.format(*atom[1:]) if sentence else atom_name(atom)
