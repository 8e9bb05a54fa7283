"""Partners of cross-play: scripted, planning, trained and own policies, by their names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from robotouille.certification import load_certificate
from robotouille.domain.task import Task
from robotouille.errors import RobotouilleError
from robotouille.planning.plan import Plan, read_plan
from robotouille.planning.policies.policy import Policy, RandomPolicy
from robotouille.planning.policies.skill import SKILLS, SkilledPolicy, skill_named
from robotouille.planning.policies.trained import TrainedPolicy, read_actor
from robotouille.world.world import State, World
from robotouille_client.bots.bot_names import bot_named
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.own_policy import own_policy_maker
from robotouille_evaluation.runs.job_agents import LockstepScript

MakePartner = Callable[[State, str, int], Policy]
"""Makes the policy of a seat from the initial state, the player and a seed."""

RANDOM, SCRIPTED = "random", "scripted"
STEP_SECONDS = 1.0
"""Seconds of a step for the reaction times of skills. In the timing profile `people`, which has
five times as many steps, five steps take a second."""


@dataclass(frozen=True)
class Partner:
    """A member of the population.

    Attributes:
        maker: Returns the function that makes the policies of one pair's episodes, from a seed.
            Policies of one function may share what they learn of the kitchen.
    """

    name: str
    maker: Callable[[int], MakePartner]

    @classmethod
    def simple(cls, name: str, make: MakePartner) -> Partner:
        """Return a partner whose policies share nothing."""
        return cls(name, lambda seed: make)


def partners_named(names: Sequence[str], task: Task) -> list[Partner]:
    """Return partners by their names, as in `random`, or by names of the user's: `noise=random`.

    Raises:
        RobotouilleError: A name is unknown or given twice, a file is invalid, or a scripted partner
            has no plan.
    """
    found: dict[str, Partner] = {}
    for given in names:
        name, kind = _name_and_kind(given)
        partner = _partner(kind, task)
        if name:
            partner = replace(partner, name=name)
        if partner.name in found:
            raise RobotouilleError(
                f"two partners are called {partner.name!r}. Each partner also plays with itself; "
                f"to list it twice, name one of them: NAME={kind}"
            )
        found[partner.name] = partner
    return list(found.values())


def _name_and_kind(given: str) -> tuple[str, str]:
    name, mark, kind = given.partition("=")
    # The path of a file can contain the sign, too.
    named = name and mark and not Path(given).is_file()
    return (name, kind) if named else ("", given)


def _partner(name: str, task: Task) -> Partner:
    shipped: dict[str, Callable[[], Partner]] = {
        RANDOM: _random,
        SCRIPTED: partial(_scripted, task),
        **{skill: partial(_planner, skill) for skill in SKILLS},
    }
    return bot_named(name, shipped, trained=partial(_trained, task), own=_own, what="partner")


def _random() -> Partner:
    return Partner.simple(RANDOM, lambda state, player, seed: RandomPolicy(player, seed))


def _scripted(task: Task) -> Partner:
    plan = _shipped_plan(task)
    return Partner.simple(SCRIPTED, lambda state, player, seed: LockstepScript(player, plan, state))


def _own(name: str) -> Partner:
    make = own_policy_maker(name)
    return Partner.simple(name, lambda state, player, seed: make(state, player))


def _trained(task: Task, path: Path) -> Partner:
    actor = read_actor(path)
    # Refuse a policy of another kitchen before anything is played.
    start = World(task).initial
    TrainedPolicy(actor, start, start.world.players[0])
    return Partner.simple(
        path.stem, lambda state, player, seed: TrainedPolicy(actor, state, player, seed)
    )


def _planner(skill: str) -> Partner:
    def maker(pair_seed: int) -> MakePartner:
        # The analysis of a kitchen takes seconds, so the episodes of a pair share it.
        plan = policy_maker(BotKind.PLANNER, pair_seed)

        def make(state: State, player: str, seed: int) -> Policy:
            policy, limits = plan(state, player), skill_named(skill)
            return SkilledPolicy(policy, player, limits, step_seconds=STEP_SECONDS, seed=seed)

        return make

    return Partner(skill, maker)


def _shipped_plan(task: Task) -> Plan:
    if task.problem.shift is not None:
        raise RobotouilleError(f"no plan for a scripted partner: {task.name} is a shift")
    lines = load_certificate(task).plan
    if lines is None:
        raise RobotouilleError(f"no plan of {task.name} for a scripted partner")
    return read_plan("\n".join(lines), World(task), task.name)
