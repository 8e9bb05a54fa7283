"""What a policy needs to plan for one goal: a world, searches, and words for messages."""

from __future__ import annotations

from functools import cached_property

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.planning.policies.team_plan import TeamPlanner, TeamSearch
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import Occupancy
from robotouille.world.world import World


class PlanningModel:
    """World, searches and words with which one seat plans for one goal.

    Args:
        alone: True to ignore other participants.
        words: Words that replace those of the domain.
    """

    def __init__(
        self,
        world: World,
        anytime: AnytimePlanner,
        *,
        seed: int,
        expansions: int,
        alone: bool,
        words: Language = NO_WORDS,
    ) -> None:
        self.world = world
        self.anytime = anytime
        self.search = TeamSearch(anytime, seed, expansions)
        self.planner = TeamPlanner(anytime, self.search, alone=alone)
        self._words = words

    @cached_property
    def wording(self) -> Wording:
        """Words for chat messages to people and models."""
        return Wording(self.world, language_of(self.world.task).with_words(self._words))

    @cached_property
    def rules(self) -> Occupancy:
        """Rules about the places of players."""
        return Occupancy(self.world)

    def own(self, action: GroundAction) -> GroundAction:
        """Return an action of another copy of the world as an action of this one."""
        if action.source is self.world:
            return action
        self.world.admit(action.arguments)
        return self.world.action(action.name, *action.arguments)
