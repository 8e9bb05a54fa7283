"""Policies of the planning package as agents: they ask no model."""

from __future__ import annotations

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille.planning import Plan
from robotouille.planning.policies import Did, PlannerPolicy, Policy, RandomPolicy, Script
from robotouille_evaluation.agents.proposal import Observation, Proposal, ProposalSteps

__all__ = ["PolicyAgent", "planner", "random_actions", "script"]


class PolicyAgent:
    """Does what a policy says; doing nothing is an action, too."""

    retries_left = 0

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    def retry(self) -> bool:
        """Never."""
        return False

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        self._policy.observe(did)

    def propose(self, observation: Observation) -> ProposalSteps:
        """One action, at once."""
        if observation.state is None:
            raise RobotouilleError("a policy plans on states; it is no agent that reads")
        action = self._policy.act(observation.state)
        return Proposal((action.sentence if action is not None else "",))
        yield  # It asks nobody, and is a generator all the same.


def planner(world: World, player: str, seed: int) -> PolicyAgent:
    """Searches, and plans anew when others get in its way."""
    return PolicyAgent(PlannerPolicy(world, player, seed=seed))


def random_actions(world: World, player: str, seed: int) -> PolicyAgent:
    """Takes valid actions by chance."""
    return PolicyAgent(RandomPolicy(player, seed))


def script(plan: Plan, player: str, world: World) -> PolicyAgent:
    """Carries out a player's part of a plan."""
    return PolicyAgent(Script(player, plan, world.initial))
