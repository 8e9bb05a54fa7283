"""Which work still changes something: for what people are offered and shown, not for the rules.

An action whose effects, at once and delayed, all hold already is valid, and does nothing: to cut
what is cut. Likewise work whose result holds already is never over, and brings nothing about.
"""

from __future__ import annotations

from collections.abc import Iterator

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.effects import HOLDING, Effect, EffectNode
from robotouille.world.timers import Progress
from robotouille.world.world import State

__all__ = ["changes_something", "useful_actions", "work_in_progress", "work_towards"]


def changes_something(state: State, action: GroundAction) -> bool:
    """Whether an action changes the state, at once or later. One that has no effects at all, such
    as to wait, is meant to do nothing: it counts as one that does."""
    facts = state.facts
    if (facts | action.touched) ^ action.removed != facts:
        return True
    if not action.effects:
        return not action.schema.definition.immediate_fx
    running = {effect for effect, counters in state.timers.entries if _runs(effect, counters)}
    return any(
        _leads_on(effect.root, facts)
        for effect in action.effects
        if effect not in running or _repeats(effect.root)
    )


def useful_actions(state: State, player: str) -> tuple[GroundAction, ...]:
    """What a player can do that changes something, in the order of `State.actions`."""
    return tuple(a for a in state.actions(player) if changes_something(state, a))


def work_in_progress(state: State) -> tuple[Progress, ...]:
    """What is in progress and still changes something when it is done."""
    going_on = {
        (effect.label[0], effect.label[2])
        for effect, _ in state.timers.entries
        if any(_leads_on(node, state.facts) for node in effect.counters())
    }
    return tuple(row for row in state.progress() if (row.action, row.arguments) in going_on)


def work_towards(state: State) -> Iterator[tuple[tuple[str, ...], float]]:
    """The facts that what is in progress will bring about, and which share of it is done."""
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
    """Whether an effect goes on by itself: it does not, if what it needs does not hold."""
    return effect.root.kind != "conditional" or counters[effect.root.slot] == HOLDING


def _repeats(node: EffectNode) -> bool:
    return node.kind == "repetitive" or any(map(_repeats, node.nested))


def _leads_on(node: EffectNode, facts: int) -> bool:
    """Whether something in an effect's tree does not hold yet. What a conditional effect asserts
    meanwhile is not what it is for, where others are nested in it."""
    if not node.possible:
        return False
    if node.kind in ("creation", "deletion"):
        return True
    if node.nested and node.kind == "conditional":
        return any(_leads_on(child, facts) for child in node.nested)
    news = node.sets & ~facts or node.clears & facts
    return bool(news) or any(_leads_on(child, facts) for child in node.nested)
