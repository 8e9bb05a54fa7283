"""Metrics of asynchronous work: whether it comes first, and the players' time without actions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from robotouille.domain.schema import Creation, Delayed, EffectDef
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World
from robotouille_evaluation.metrics.outcomes import success_rate
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.metrics.trajectory import Trajectory


def is_waiting(action: GroundAction) -> bool:
    """Return whether an action only lets time pass, like `wait`."""
    definition = action.schema.definition
    return not (definition.precons or definition.immediate_fx or definition.sfx)


def is_travel(action: GroundAction) -> bool:
    """Return whether an action takes a player to another station, like `move`."""
    return action.destination is not None


def is_asynchronous(action: GroundAction) -> bool:
    """Return whether an action starts work that continues by itself: cook, fry, fill, boil.

    A delay of 0 does not count, because it ends with the first update of the effect.
    """
    return any(
        node.counts == "steps" and node.total > 1
        for effect in action.effects
        for node in effect.counters()
    )


def is_joining(action: GroundAction) -> bool:
    """Return whether an action joins two things: stack, add to a soup, pour into a bowl."""
    domain = action.source.task.domain
    places = {*domain.station_types, *domain.player_types}
    types = {p.name: p.param_types for p in domain.predicate_defs}
    return any(
        fact.is_true
        and len(types[fact.predicate]) > 1
        and not places.intersection(types[fact.predicate])
        for fact in action.schema.definition.immediate_fx
    )


def is_work(action: GroundAction) -> bool:
    """Return whether an action prepares or joins things, unlike walking and carrying."""
    return bool(action.schema.definition.sfx) or is_joining(action)


def work_stations(world: World) -> frozenset[str]:
    """Return the stations at which something can be prepared.

    These are the stations that an action with a special effect requires. Its preconditions name
    their kind with a static predicate, such as `isboard`.
    """
    kinds = set()
    for schema in world.schemas:
        if schema.definition.sfx:
            for condition in schema.definition.precons:
                static = condition.predicate in world.table.static_predicates
                if static and len(condition.params) == 1 and condition.is_true:
                    kinds.add(condition.predicate)
    stations = set(world.task.domain.station_types)
    return frozenset(
        thing.name
        for thing in world.placed
        if thing.type in stations and any((k, thing.name) in world.table.static for k in kinds)
    )


def needs_asynchronous_work(world: World) -> bool:
    """Return whether the goal needs delayed results, such as cooked food, that do not exist yet.

    Delays of 0 steps do not count.
    """
    delayed = _results_of_delays(world)
    wanted: dict[tuple[str, tuple[str, ...]], int] = {}
    there: dict[tuple[str, tuple[str, ...]], int] = {}
    for term in set(world.goal.terms):
        if term.predicate in delayed or delayed.intersection(term.args):
            key = (term.predicate, term.args)
            wanted[key] = wanted.get(key, 0) + 1
            mask = world.goal.possible_mask(term)
            there[key] = there.get(key, 0) | (world.initial.facts & mask)
    return any(count > there[key].bit_count() for key, count in wanted.items())


def _results_of_delays(world: World) -> frozenset[str]:
    """Return the predicates and kinds of objects that delays of more than 0 steps produce."""
    found: set[str] = set()

    def walk(effects: Iterable[EffectDef], delayed: bool) -> None:
        for effect in effects:
            late = delayed or (isinstance(effect, Delayed) and _steps(world, effect) > 0)
            if late:
                found.update(fact.predicate for fact in effect.fx if fact.is_true)
                if isinstance(effect, Creation):
                    found.add(effect.created_obj.name)
            walk(effect.sfx, late)

    for schema in world.schemas:
        walk(schema.definition.sfx, False)
    return frozenset(found)


def _steps(world: World, effect: Delayed) -> int:
    """Return the longest delay for any object of the task, in steps."""
    table = world.task.problem.config.get(effect.config or "", {})
    return max(table.values(), default=effect.default)


def asynchronous_first(trajectory: Trajectory) -> bool | None:
    """Return whether the first work of the run was asynchronous (paper, finding 6).

    Work is an action with a special effect, or one that joins two things. It is asynchronous if it
    then continues by itself: cooking, frying, filling, boiling. Walking and carrying are not work.
    In a step with several players, asynchronous work of one player is enough.

    Returns:
        None if the goal needs no asynchronous work; False if no work was done.
    """
    if not needs_asynchronous_work(trajectory.world):
        return None
    for joint in trajectory.moves:
        work = [move.action for move in joint if move.applied and is_work(move.action)]
        if work:
            return any(map(is_asynchronous, work))
    return False


def success_by_asynchronous_first(
    rows: Sequence[ResultRow],
) -> tuple[float | None, float | None]:
    """Return the success rates of runs that began with asynchronous work, and of the others.

    The paper reports 16 % and 6 % (finding 6).
    """
    return (
        success_rate([row for row in rows if row.measures.asynchronous_first is True]),
        success_rate([row for row in rows if row.measures.asynchronous_first is False]),
    )


@dataclass(frozen=True, slots=True)
class TimeShares:
    """Shares of the players' steps without an action, from 0 to 1.

    `waiting`: something is in progress. `idle`: nothing is in progress. `busy`: the player is in
    the middle of an action that takes several steps.
    """

    waiting: float
    idle: float
    busy: float


def time_shares(trajectory: Trajectory) -> TimeShares | None:
    """Return the shares of the players' steps without an action; None for a run without steps.

    If the player is not busy and applies no action, or only one that does nothing, the step is
    waiting if something is in progress before or after it, and idle otherwise. Gantt charts of
    schedules distinguish slack from blocked time in the same way.
    """
    waiting = idle = busy = 0
    players = trajectory.world.players
    for before, joint, after in trajectory.each_step():
        runs = any(p.timed and p.running for state in (before, after) for p in state.progress())
        acting = {move.player for move in joint if move.applied and not is_waiting(move.action)}
        for player in players:
            if player in acting:
                continue
            if before.busy_steps(player):
                busy += 1
            elif runs:
                waiting += 1
            else:
                idle += 1
    total = trajectory.steps * len(players)
    return TimeShares(waiting / total, idle / total, busy / total) if total else None
