"""Strategies, teams and policies that play the seats of a job."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

from robotouille import GroundAction, State, World
from robotouille.errors import RobotouilleError
from robotouille.planning import Plan
from robotouille.planning.policies import (
    Did,
    PlannerOptions,
    PlannerPolicy,
    Policy,
    RandomPolicy,
    Script,
    TeamPolicy,
)
from robotouille.planning.policies.shift_policy import ShiftPolicy
from robotouille.planning.shift import DishPlanner
from robotouille.planning.solvers import AnytimePlanner
from robotouille_client.bots.own_policy import own_policy_maker
from robotouille_evaluation.agents.joint_team import JointTeam
from robotouille_evaluation.agents.making import make_strategy, team_strategy
from robotouille_evaluation.agents.proposal import (
    AgentObservation,
    Complete,
    Proposal,
    ProposalSteps,
    Strategy,
)
from robotouille_evaluation.agents.team import IndependentTeam, Team, TurnsTeam
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs.job_list import EpisodeJob
from robotouille_evaluation.runs.text_episode import TextView


class PolicyAgent:
    """Strategy that does what a policy chooses, including nothing."""

    retries_left = 0

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    def retry(self) -> bool:
        """Return False: a policy does not start again."""
        return False

    def observe(self, did: Did) -> None:
        """Pass on what all players did in a step."""
        self._policy.observe(did)

    def propose(self, observation: AgentObservation) -> ProposalSteps:
        """Return one action without a request."""
        if observation.state is None:
            raise RobotouilleError("a policy needs the state, not only its text")
        action = self._policy.act(observation.state)
        sentence = action.sentence if action is not None else ""
        return Proposal((sentence,), anticipates=_anticipates(self._policy))
        yield  # Unreachable, but strategies are generators.


class LockstepScript:
    """Policy that carries out a player's part of a plan, if all seats decide at the same time.

    Several actions of a plan's step may depend on each other: one player leaves a station, and
    another one walks there. `Script.act` chooses only what is possible before the step.
    """

    def __init__(self, player: str, plan: Plan, start: State) -> None:
        self._player = player
        self._script = Script(player, plan, start)
        self.anticipating = False
        """True if another player's action in the same step makes the last one possible."""

    def observe(self, did: Did) -> None:
        """Pass on what all players did in a step."""
        self._script.observe(did)

    def act(self, state: State) -> GroundAction | None:
        """Return the action to take in a state; None to do nothing this step."""
        action, self.anticipating = self._script.joint(state).get(self._player, (None, False))
        return action


class Replanner:
    """Policy that plans again after a random reversal.

    It computes the state that the players' actions lead to. Any other state shows a reversal.

    Args:
        plan: Returns a policy that plans from the next state on.
    """

    def __init__(self, plan: Callable[[], Policy]) -> None:
        self._plan = plan
        self._policy = plan()
        self._expected: State | None = None

    @property
    def anticipating(self) -> bool:
        """True if another player's action in the same step makes the last one possible."""
        return _anticipates(self._policy)

    def observe(self, did: Did) -> None:
        """Pass on what all players did in a step."""
        if self._expected is not None:
            applied = [action for _, action, was_applied in did if was_applied]
            self._expected = self._expected.step(applied).state
        self._policy.observe(did)

    def act(self, state: State) -> GroundAction | None:
        """Return the action to take in a state; None to do nothing this step."""
        if self._expected is not None and state != self._expected:
            self._policy = self._plan()
        self._expected = state
        return self._policy.act(state)


def planner_policy(world: World, player: str, seed: int, clock: str | None = None) -> Policy:
    """Return a policy that searches, and plans again when others or chance interfere.

    With a clock, it assumes that all other seats plan in the same way.
    """

    def make() -> Policy:
        options = PlannerOptions(seed=seed)
        policy = (
            PlannerPolicy(world, player, options, anytime=_anytime(world))
            if world.shift is None
            else ShiftPolicy(world, player, options, dishes=_dishes(world))
        )
        if clock is not None:
            policy.meet(dict.fromkeys(world.players, "bot"), clock)
        return policy

    return Replanner(make)


@lru_cache(maxsize=4)
def _anytime(world: World) -> AnytimePlanner:
    # Shared by all seats: they make the same plans, so the second request is answered from memory.
    return AnytimePlanner(World(world.task))


@lru_cache(maxsize=4)
def _dishes(world: World) -> dict[str, DishPlanner]:
    return {}


def _anticipates(policy: Policy) -> bool:
    return isinstance(policy, TeamPolicy | Replanner | LockstepScript) and policy.anticipating


def planner(world: World, player: str, seed: int, clock: str | None = None) -> PolicyAgent:
    """Return `planner_policy` as an agent."""
    return PolicyAgent(planner_policy(world, player, seed, clock))


def random_actions(world: World, player: str, seed: int) -> PolicyAgent:
    """Return an agent that takes random valid actions."""
    return PolicyAgent(RandomPolicy(player, seed))


def script(plan: Plan, player: str, world: World, *, lockstep: bool) -> PolicyAgent:
    """Return an agent that carries out a player's part of a plan.

    Args:
        lockstep: True if all players decide at the same time.
    """
    policy = LockstepScript if lockstep else Script
    return PolicyAgent(policy(player, plan, world.initial))


class JobAgents:
    """Agents of one job in its world."""

    def __init__(self, job: EpisodeJob, pack: Pack, world: World) -> None:
        self._job = job
        self._pack = pack
        self._world = world
        self.published = any(found.id == job.agent.strategy for found in pack.experiments)
        """True if the strategy is an experiment of the pack."""
        self.strategies: dict[str, Strategy] = (
            {player: self._strategy(player) for player in world.players}
            if job.control == "each"
            else {}
        )
        """Strategy of each player, unless one model controls all of them."""

    @property
    def view(self) -> TextView | None:
        """Description of states that models read; None for planners.

        Published strategies read the published text. Other strategies read what a server sends.
        """
        if self._job.agent.kind != "model":
            return None
        return State.text if self.published else State.text_view

    def team(self, complete: Mapping[str, Complete]) -> Team:
        """Return the team of a job with several seats.

        One model for all seats is asked as the first player.
        """
        job, pack = self._job, self._pack
        if job.control == "each":
            return IndependentTeam(self.strategies, complete)
        strategy = team_strategy(pack, job.agent.strategy, self._dataset, job.control)
        first = complete[self._world.players[0]]
        return JointTeam(strategy, first) if job.control == "joint" else TurnsTeam(strategy, first)

    def helpers(self) -> dict[str, Policy]:
        """Return the policies that act while models think. Planners need no helper."""
        job, world = self._job, self._world
        kind = job.real_time.helper if job.real_time is not None else "none"
        if kind == "none" or job.agent.kind != "model":
            return {}
        if kind == "planner":
            return {p: planner_policy(world, p, job.seed) for p in world.players}
        plan = self._pack.plan(job.instance, world)
        return {p: Script(p, plan, world.initial) for p in world.players}

    @property
    def _dataset(self) -> str:
        return self._pack.task(self._pack.instance(self._job.instance).task).dataset

    def _strategy(self, player: str) -> Strategy:
        job, world = self._job, self._world
        match job.agent.kind:
            case "planner":
                clock = job.clock if job.real_time is None else None
                return planner(world, player, job.seed, clock)
            case "random":
                return random_actions(world, player, job.seed)
            case "scripted":
                plan = self._pack.plan(job.instance, world)
                return script(plan, player, world, lockstep=job.real_time is None)
            case "custom":
                return PolicyAgent(own_policy_maker(job.agent.name)(world.initial, player))
            case "model":
                return make_strategy(self._pack, job.agent.strategy, self._dataset)
