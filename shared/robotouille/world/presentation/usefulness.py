"""Useful actions and work: what still changes something.

Actions whose effects already hold are valid but do nothing, such as cutting what is cut. Work
whose result already holds never ends. People are offered and shown neither; the rules allow both.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.effects import HOLDING, Effect, EffectNode
from robotouille.world.scene import scene
from robotouille.world.timers import Progress
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World


class Occupancy:
    """Rules of a domain about standing at stations."""

    def __init__(self, world: World) -> None:
        self._world = world

    def is_about_standing(self, predicate: str) -> bool:
        """Return whether a predicate says that a player, or no player, stands somewhere."""
        return predicate in self._standing or predicate in self._free

    def needed_free(self, unmet: Unmet) -> str | None:
        """Return the station that must be free, if that is what the condition asks for."""
        if unmet.kind is not UnmetKind.CONDITION or len(unmet.objects) != 1:
            return None
        return unmet.objects[0] if self._free.get(unmet.predicate) == unmet.expected else None

    def players_at(self, state: State, station: str) -> list[str]:
        """Return the players that stand at a station."""
        return [name for name, each in scene(state).items() if each.at == station]

    @cached_property
    def _standing(self) -> frozenset[str]:
        layout = self._world.task.domain.layout or ()
        return frozenset(rule.predicate for rule in layout if rule.when == "faces")

    @cached_property
    def _free(self) -> dict[str, bool]:
        """Return the station predicates that a walk changes, with their values before the walk."""
        found: dict[str, bool] = {}
        for schema in self._world.schemas:
            travel = schema.definition.travel
            for effect in schema.definition.immediate_fx if travel else ():
                if travel and effect.params == (travel[1],):
                    found[effect.predicate] = not effect.is_true
        return found


def changes_something(state: State, action: GroundAction) -> bool:
    """Return whether an action changes the state, now or later.

    Actions without any effects, such as waiting, count as useful: they are meant to do nothing.
    """
    facts = state.facts
    if (facts | action.touched) ^ action.removed != facts:
        return True
    if not action.effects:
        return not action.schema.definition.immediate_fx
    # Starting an effect again that is already running does nothing, unless it counts repetitions.
    running = {effect for effect, counters in state.timers.entries if _runs(effect, counters)}
    return any(
        _leads_on(effect.root, facts)
        for effect in action.effects
        if effect not in running or _repeats(effect.root)
    )


def useful_actions(state: State, player: str) -> tuple[GroundAction, ...]:
    """Return the useful actions of a player, in the order of `State.actions`."""
    return tuple(a for a in state.actions(player) if changes_something(state, a))


def work_in_progress(state: State) -> tuple[Progress, ...]:
    """Return the progress of all work that still changes something."""
    going_on = {
        (effect.label[0], effect.label[2])
        for effect, _ in state.timers.entries
        if any(_leads_on(node, state.facts) for node in effect.counters())
    }
    return tuple(row for row in state.progress() if (row.action, row.arguments) in going_on)


def work_towards(state: State) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield the facts that current work will make true, each with the share that is done."""
    far = {(row.action, row.arguments): row.done / max(1, row.total) for row in state.progress()}
    for effect, _ in state.timers.entries:
        share = far.get((effect.label[0], effect.label[2]))
        if share is not None:
            news = _sets(effect.root) & ~state.facts
            yield from ((state.world.table.atoms[bit], share) for bit in bits_of(news))


def _sets(node: EffectNode) -> int:
    facts = node.sets
    for nested in node.nested:
        facts |= _sets(nested)
    return facts


def _runs(effect: Effect, counters: tuple[int, ...]) -> bool:
    """Return whether an effect is active; a conditional one is not while its condition fails."""
    return not effect.root.pauses or counters[effect.root.slot] == HOLDING


def _repeats(node: EffectNode) -> bool:
    return node.counts == "performances" or any(map(_repeats, node.nested))


def _leads_on(node: EffectNode, facts: int) -> bool:
    """Return whether an effect tree still has something to change.

    Facts that a conditional effect asserts are not its purpose if other effects are nested in it.
    """
    if not node.possible:
        return False
    # Creating or deleting an object always changes something.
    if node.instant:
        return True
    if node.nested and node.pauses:
        return any(_leads_on(child, facts) for child in node.nested)
    news = node.sets & ~facts or node.clears & facts
    return bool(news) or any(_leads_on(child, facts) for child in node.nested)
