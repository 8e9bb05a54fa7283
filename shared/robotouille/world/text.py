"""The observation in words: the benchmark's interface to agents that read."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.domain.schema import DomainFile
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, atom_name

__all__ = ["describe", "observation"]


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


def describe(domain: DomainFile, atom: Atom, is_true: bool) -> str:
    """A fact in words, for reasons: `lettuce1 is cut`, or `not: lettuce1 is cut`."""
    definition = next((p for p in domain.predicate_defs if p.name == atom[0]), None)
    descriptors = definition.language_descriptors if definition else {}
    sentence = descriptors.get("0") or next(iter(descriptors.values()), "")
    words = sentence.format(*atom[1:]) if sentence else atom_name(atom)
    return words if is_true else f"not: {words}"
