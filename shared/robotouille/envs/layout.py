"""Contents of vectors and of graph nodes under an environment's options."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from robotouille.envs.egocentric import own_columns
from robotouille.envs.rules import EnvRules, Perspective
from robotouille.envs.views import ObservationView, Vector, largest_team

SELF, SEEN, GOAL, SAID = "self", "seen", "goal", "said"
"""Features of the agent's own player, of things in sight or in the goal, and of messages."""

SILENCE = 0
"""Message of an agent that says nothing."""

Said = Sequence[int]
"""The last message of each player, by seat."""


class Layout:
    """Contents of the agents' observations.

    Attributes:
        rules: The rules of the environment.
        views: Its instances.
        perspective: Difference between the agents.
        players: Players of the largest team.
        objects: Number of objects that vectors mark as seen; 0 without a limit of sight.
        terms: Number of the goal's conditions in vectors; 0 if the goal is not observed.
        messages: Messages that an agent can choose from.
        state_size: Length of the state in a vector.
    """

    def __init__(
        self, rules: EnvRules, views: Sequence[ObservationView], perspective: Perspective
    ) -> None:
        self.rules, self.views, self.perspective = rules, tuple(views), perspective
        self.first, self.sizes = views[0], views[0].sizes
        self.players = largest_team(views)
        counts = [len(view.world.encoding.objects) for view in views] if rules.sight else [0]
        self.objects = max(counts)
        self.terms = max(len(view.world.goal.terms) for view in views) if rules.goal else 0
        self.messages = range(1, rules.tokens + 1)
        self.state_size = self.sizes.vector
        if self.egocentric:
            self.state_size = max(len(own_columns(view)) for view in views)

    def __reduce__(self) -> tuple[Any, ...]:
        return Layout, (self.rules, self.views, self.perspective)

    @property
    def egocentric(self) -> bool:
        """True if the agent's own player is in the place of the first one."""
        return self.perspective is Perspective.EGOCENTRIC

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of a vector's numbers in the first instance; see `Encoding.columns`.

        With several instances, numbers without a meaning in the first one are called `unused`.
        """
        encoding = self.first.world.encoding
        own = own_columns(self.first) if self.egocentric else encoding.columns
        unused = ("unused",) * (self.state_size - len(own))
        identity = self.perspective is Perspective.IDENTITY
        selves = tuple(f"{SELF}({player})" for player in self.players) if identity else ()
        things = [thing.name for thing in encoding.objects][: self.objects]
        seen = [f"{SEEN}({name})" for name in things]
        seen += ["unused"] * (self.objects - len(things))
        said = (f"{SAID}[{i}]({player})" for player in self.players for i in self.messages)
        goal = (f"{GOAL}[{i}]" for i in range(self.terms))
        return (*own, *unused, *selves, *seen, *goal, *said)

    @cached_property
    def features(self) -> tuple[str, ...]:
        """Names of a graph node's numbers.

        They are `Encoding.features`, and as far as options request them `self`, `seen`, messages
        and `goal`.
        """
        own = () if self.perspective is Perspective.SHARED else (SELF,)
        seen = (SEEN,) if self.rules.sight else ()
        said = (f"{SAID}[{i}]" for i in self.messages)
        goal = (GOAL,) if self.rules.goal else ()
        return (*self.first.world.encoding.features, *own, *seen, *said, *goal)

    def spoken(self, said: Said) -> Vector:
        """Return a row for each message, with a 1 in the place of its token."""
        return np.array([[token == i for i in self.messages] for token in said], np.float32)
