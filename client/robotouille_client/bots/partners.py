"""The bots of a game in this process: they are told what happens, and decide when they have
thought."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.planning.policies.policy import Policy, TeamPolicy, waits
from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.bots.kinds import BotKind, policy_maker

__all__ = ["Decision", "MakePartners", "Partners", "PromptPartners", "prompt_partners"]


class Decision(NamedTuple):
    """What a player's bot does in the state that it was asked about: an action, or nothing. Who
    does nothing may be one who `waits` for a place or for somebody."""

    player: str
    action: GroundAction | None
    waits: bool = False


class Partners(Protocol):
    """What decides for all seats that are not a person's."""

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Who moves each player now; and the clock."""

    def observe(self, did: Did) -> None:
        """What everybody did in a step; called once for each step, before the next `ask`."""

    def hear(self, player: str, text: str) -> None:
        """Something that a player says."""

    def ask(self, player: str, state: State) -> None:
        """Have a player's bot decide in a state; not before it has answered the last time."""

    def answers(self) -> list[Decision]:
        """What was decided since this was last called."""

    def spoken(self) -> list[tuple[str, str]]:
        """What was said since this was last called: players and words."""

    def news(self) -> list[str]:
        """What has become of them since this was last called, for people to read."""

    def close(self) -> None:
        """The game is over for them."""


MakePartners = Callable[[State, BotKind, int, Sequence[str], Language], Partners]
"""Makes the bots of some players: the state at which they begin, their kind, the seed, the players,
and the words that are laid over those of the domain when they talk."""


class PromptPartners:
    """Bots that decide as soon as they are asked: the same questions have the same course."""

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
    """Bots in this process and thread; planners share what they find out about the task."""
    if kind is not BotKind.PLANNER:
        make = policy_maker(kind, seed)
        return PromptPartners({player: make(start, player) for player in players})
    from robotouille.planning.anytime import AnytimePlanner
    from robotouille.planning.policies.planner_policy import PlannerPolicy

    known = AnytimePlanner(World(start.world.task))
    return PromptPartners(
        {
            player: PlannerPolicy(
                start.world, player, seed=seed, start=start, anytime=known, words=words
            )
            for player in players
        }
    )
