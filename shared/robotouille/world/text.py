"""The observation in words: the benchmark's interface to agents that read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotouille.world.grounding.objects import Atom, atom_name

if TYPE_CHECKING:
    from robotouille.domain.schema import DomainFile
    from robotouille.world.state import State

__all__ = ["describe", "observation"]


def observation(state: State, player: str | None = None) -> str:
    """A paragraph for each object, the valid actions of a player and the goal.

    Without a player, the first one's actions are listed.
    """
    world = state.world
    order = {name: i for i, name in enumerate(p.name for p in world.task.domain.predicate_defs)}
    lines: dict[str, list[str]] = {thing.name: [] for thing in state.objects}
    rank = {name: i for i, name in enumerate(lines)}

    def position(atom: Atom) -> tuple[int, list[int]]:
        return order[atom[0]], [rank[name] for name in atom[1:]]

    for atom in sorted(world.table.true_atoms(state.facts), key=position):
        for argument, name in enumerate(atom[1:]):
            sentence = world.descriptor(atom[0], argument)
            if sentence:
                lines[name].append(sentence.format(*atom[1:]))
    paragraphs = [
        "\n".join([f"{thing.type.capitalize()} {thing.name}:", *lines[thing.name]])
        for thing in state.objects
    ]
    actor = player or world.players[0]
    sentences = [action.sentence for action in state.actions(actor)]
    paragraphs.append("\n".join(["Valid Actions:", *sentences]))
    paragraphs.append(f"Goal: {world.task.goal_description}")
    return "\n\n".join(paragraphs)


def describe(domain: DomainFile, atom: Atom, is_true: bool) -> str:
    """A fact in words, for reasons: `lettuce1 is cut`, or `not: lettuce1 is cut`."""
    definition = next((p for p in domain.predicate_defs if p.name == atom[0]), None)
    descriptors = definition.language_descriptors if definition else {}
    sentence = descriptors.get("0") or next(iter(descriptors.values()), "")
    words = sentence.format(*atom[1:]) if sentence else atom_name(atom)
    return words if is_true else f"not: {words}"
