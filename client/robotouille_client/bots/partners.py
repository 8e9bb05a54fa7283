"""Bots that play in a game of this process, next to a person."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.planning.policies.policy import Policy, TeamPolicy, waits
from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.bots.kinds import BotKind, policy_maker


class Decision(NamedTuple):
    """A bot's decision: an action, or None to do nothing.

    `waits` declares that doing nothing means waiting for a place or a teammate.
    """

    player: str
    action: GroundAction | None
    waits: bool = False


class Partners(Protocol):
    """The bots of all seats that no person has.

    Decisions may take time, so they are requested with `ask` and collected with `answers`.
    """

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Tell the bots who controls each player, and the clock."""

    def observe(self, did: Did) -> None:
        """Tell the bots the actions of a step; called once for each step, before `ask`."""

    def hear(self, player: str, text: str) -> None:
        """Tell the bots a chat message of a player."""

    def ask(self, player: str, state: State) -> None:
        """Request a decision of a player's bot, which must have answered the last request."""

    def answers(self) -> list[Decision]:
        """Return the decisions since the last call."""

    def spoken(self) -> list[tuple[str, str]]:
        """Return the chat messages since the last call, as players and texts."""

    def news(self) -> list[str]:
        """Return messages about failed or restarted bots since the last call, for people."""

    def close(self) -> None:
        """Stop the bots."""


MakePartners = Callable[[State, BotKind, int, Sequence[str], Language], Partners]
"""Makes bots from the initial state, their kind, the seed, their players and the language of
their chat messages."""


class PromptPartners:
    """Bots that decide at once in the calling thread, so that a game can be repeated exactly."""

    def __init__(self, policies: Mapping[str, Policy]) -> None:
        self._policies = policies
        self._team = {p: each for p, each in policies.items() if isinstance(each, TeamPolicy)}
        self._answers: list[Decision] = []

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        for policy in self._team.values():
            policy.meet(kinds, clock)

    def observe(self, did: Did) -> None:
        for policy in self._policies.values():
            policy.observe(did)

    def hear(self, player: str, text: str) -> None:
        for each, policy in self._team.items():
            if each != player:
                policy.hear(player, text)

    def ask(self, player: str, state: State) -> None:
        policy = self._policies[player]
        action = policy.act(state)
        self._answers.append(Decision(player, action, action is None and waits(policy)))

    def answers(self) -> list[Decision]:
        found, self._answers = self._answers, []
        return found

    def spoken(self) -> list[tuple[str, str]]:
        return [(player, text) for player, each in self._team.items() for text in each.speak()]

    def news(self) -> list[str]:
        return []

    def close(self) -> None:
        pass


def prompt_partners(
    start: State, kind: BotKind, seed: int, players: Sequence[str], words: Language = NO_WORDS
) -> PromptPartners:
    """Make bots that decide in the calling thread. Planners share one search of the task."""
    if kind is not BotKind.PLANNER:
        make = policy_maker(kind, seed)
        return PromptPartners({player: make(start, player) for player in players})
    from robotouille.planning.policies.planner_policy import PlannerOptions, PlannerPolicy
    from robotouille.planning.solvers import AnytimePlanner

    known = AnytimePlanner(World(start.world.task))
    options = PlannerOptions(seed=seed, words=words)
    return PromptPartners(
        {
            player: PlannerPolicy(start.world, player, options, start=start, anytime=known)
            for player in players
        }
    )
