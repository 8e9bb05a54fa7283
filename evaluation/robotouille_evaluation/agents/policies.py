"""Policies of the planning package as agents: they ask no model."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from robotouille import GroundAction, State, World
from robotouille.errors import RobotouilleError
from robotouille.planning import Plan
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.policies import (
    Did,
    PlannerPolicy,
    Policy,
    RandomPolicy,
    Script,
    TeamPolicy,
)
from robotouille_evaluation.agents.proposal import Observation, Proposal, ProposalSteps

__all__ = ["PolicyAgent", "Replanner", "planner", "planner_policy", "random_actions", "script"]


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
        sentence = action.sentence if action is not None else ""
        return Proposal((sentence,), anticipates=_anticipates(self._policy))
        yield  # It asks nobody, and is a generator all the same.


class Replanner:
    """Plans anew where the world is not as everybody's actions have left it: chance was at work.

    Args:
        plan: Makes a policy that plans from the next state on.
    """

    def __init__(self, plan: Callable[[], Policy]) -> None:
        self._plan = plan
        self._policy = plan()
        self._expected: State | None = None

    @property
    def anticipating(self) -> bool:
        """Whether another's action in the same step is to make the last one possible."""
        return _anticipates(self._policy)

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        if self._expected is not None:
            applied = [action for _, action, was_applied in did if was_applied]
            self._expected = self._expected.step(applied).state
        self._policy.observe(did)

    def act(self, state: State) -> GroundAction | None:
        """The action to take in a state; None to do nothing this step."""
        if self._expected is not None and state != self._expected:
            self._policy = self._plan()
        self._expected = state
        return self._policy.act(state)


def planner_policy(world: World, player: str, seed: int, clock: str | None = None) -> Policy:
    """Searches, and plans anew when others, or chance, get in its way. With a clock, it counts on
    all other seats to plan alike."""

    def make() -> Policy:
        policy = PlannerPolicy(world, player, seed=seed, anytime=_anytime(world))
        if clock is not None:
            policy.meet(dict.fromkeys(world.players, "bot"), clock)
        return policy

    return Replanner(make)


@lru_cache(maxsize=4)
def _anytime(world: World) -> AnytimePlanner:
    """One for all seats, which make the same plans: the second that asks is answered at once."""
    return AnytimePlanner(World(world.task))


def _anticipates(policy: Policy) -> bool:
    return isinstance(policy, TeamPolicy | Replanner) and policy.anticipating


def planner(world: World, player: str, seed: int, clock: str | None = None) -> PolicyAgent:
    """`planner_policy` as an agent."""
    return PolicyAgent(planner_policy(world, player, seed, clock))


def random_actions(world: World, player: str, seed: int) -> PolicyAgent:
    """Takes valid actions by chance."""
    return PolicyAgent(RandomPolicy(player, seed))


def script(plan: Plan, player: str, world: World) -> PolicyAgent:
    """Carries out a player's part of a plan."""
    return PolicyAgent(Script(player, plan, world.initial))
