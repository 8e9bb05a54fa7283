"""Packs without delays: cooking, frying, filling and boiling end in the step that starts them.

The kitchens and goals are those of the paper's asynchronous tasks, but there is no reason to do
something else while something cooks.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from robotouille import World
from robotouille.domain.json_files import parse_json, validate
from robotouille.domain.schema import Delayed, DomainFile, EffectDef
from robotouille.domain.task import complete_domain
from robotouille.errors import RobotouilleError
from robotouille.planning import Limits, read_plan, replay
from robotouille.planning.solvers import AnytimePlanner
from robotouille_evaluation.packs.pack import KnownPlan, Pack, PackInstance, canonical_json

EXPANSIONS = 25_000
"""Expansions of the search for one player; for each further player a 50th of it."""

Progress = Callable[[int, int], None]
"""Called with the number of finished instances and of all."""


def delay_free(
    pack: Pack, instances: Iterable[PackInstance], progress: Progress, seats: int | None = None
) -> Pack:
    """Return a pack of some instances without delays, with the shortest plans of a search.

    Plans for other numbers of players and published constants are left out, because they belong to
    the kitchens with delays.

    Args:
        seats: Number of players of the plans; the usual number if None.

    Raises:
        RobotouilleError: Problems cannot set a delay of the domain, an instance is not for that
            many players, or it is a shift.
    """
    settings = _delay_settings(pack)
    chosen = tuple(instances)
    if seats is not None:
        pack.require_seats(chosen, seats)
    if any(pack.shift(instance) is not None for instance in chosen):
        raise RobotouilleError("the variant delay-free searches for plans, and a shift has no goal")
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
    """Return the names of the settings with which problems set the domain's delays."""
    source = f"{pack.name}: domain"
    domain = complete_domain(validate(parse_json(pack.domain, source), DomainFile, source))
    delays = [effect for action in domain.action_defs for effect in _delays(action.sfx)]
    if any(delay.config is None for delay in delays):
        raise RobotouilleError(f"{source}: problems cannot set one of its delays to 0")
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
    """Yield the shortest plan of a search or, if shorter, the known plan for the delays.

    A plan for the kitchen with delays usually also works without them.
    """
    world = World(pack.load(instance, seats=seats))
    players = len(world.players)
    # The number of joint actions grows exponentially with the players.
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
