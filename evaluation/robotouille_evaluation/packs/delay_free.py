"""A pack without waiting: what cooks, fries, fills or boils is done in the step that starts it.

The paper's asynchronous tasks in a world without delays: the same kitchens and goals, and no reason
to do something else meanwhile.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from robotouille import World
from robotouille.domain.files import parse_json, validate
from robotouille.domain.schema import Delayed, DomainFile, EffectDef
from robotouille.domain.task import complete_domain
from robotouille.errors import RobotouilleError
from robotouille.planning import Limits, read_plan, replay
from robotouille.planning.anytime import AnytimePlanner
from robotouille_evaluation.packs.pack import KnownPlan, Pack, PackInstance, canonical_json

__all__ = ["delay_free"]

EXPANSIONS = 25_000
"""What the search for a plan of one player may cost; for each further one a 50th of it."""

Progress = Callable[[int, int], None]
"""Called with the number of instances that are done, and of all."""


def delay_free(
    pack: Pack, instances: Iterable[PackInstance], progress: Progress, seats: int | None = None
) -> Pack:
    """A pack of some instances without delays, with the shortest plans that a search finds.

    Plans for other numbers of players and published constants are left out: they are those of the
    kitchens with delays.

    Args:
        seats: How many players the plans are for; the usual number if None.

    Raises:
        RobotouilleError: A delay of the domain cannot be set by problems, or an instance is not
            for so many players.
    """
    settings = _delay_settings(pack)
    chosen = tuple(instances)
    if seats is not None:
        pack.require_seats(chosen, seats)
    changed = []
    for number, instance in enumerate(chosen, start=1):
        bare = replace(instance, problem=_without_delays(instance.problem, settings), plans=())
        changed.append(replace(bare, plans=tuple(_best(pack, bare, instance.best(seats), seats))))
        progress(number, len(chosen))
    names = {instance.task for instance in chosen}
    tasks = tuple(
        replace(
            task, problem=_without_delays(task.problem, settings), optimal=None, optimal_from=""
        )
        for task in pack.tasks
        if task.name in names
    )
    return replace(pack, name=f"{pack.name}-delay-free", tasks=tasks, instances=tuple(changed))


def _delay_settings(pack: Pack) -> tuple[str, ...]:
    """What problems call the delays of the domain."""
    source = f"{pack.name}: domain"
    domain = complete_domain(validate(parse_json(pack.domain, source), DomainFile, source))
    delays = [effect for action in domain.action_defs for effect in _delays(action.sfx)]
    if any(delay.config is None for delay in delays):
        raise RobotouilleError(f"{source}: has a delay that problems cannot set to 0")
    return tuple(dict.fromkeys(str(delay.config) for delay in delays))


def _delays(effects: Iterable[EffectDef]) -> Iterator[Delayed]:
    for effect in effects:
        if isinstance(effect, Delayed):
            yield effect
        yield from _delays(effect.sfx)


def _without_delays(problem: str, settings: Iterable[str]) -> str:
    raw = json.loads(problem)
    none = {setting: {"default": 0} for setting in settings}
    return canonical_json({**raw, "config": {**raw.get("config", {}), **none}})


def _best(
    pack: Pack, instance: PackInstance, earlier: KnownPlan | None, seats: int | None
) -> Iterator[KnownPlan]:
    """The shortest plan that a search finds, or the one for the kitchen with delays if that is
    shorter: waiting does no harm."""
    world = World(pack.load(instance, seats=seats))
    players = len(world.players)
    limits = Limits(expansions=max(1, EXPANSIONS // 50 ** (players - 1)))
    *_, found = AnytimePlanner(world).search(world.initial, limits)
    plans = [] if found.plan is None else [found.plan]
    if earlier is not None:
        known = read_plan("\n".join(earlier.plan), world, instance.id)
        plans += [known] if replay(known, world).ok else []
    if plans:
        best = min(plans, key=len)
        lines = tuple("; ".join(map(str, joint)) or "-" for joint in best)
        yield KnownPlan(players, lines, found.bound)
