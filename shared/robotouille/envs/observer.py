"""Observations of agents: a state from an agent's perspective, with the goal (docs/train.md)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import GraphInstance

from robotouille.envs.egocentric import Places, own_columns, places, turned
from robotouille.envs.play import Play
from robotouille.envs.rules import EnvObservation, EnvRules, Perspective
from robotouille.envs.views import Mask, ObservationView, Vector, largest_team, text_space
from robotouille.world.arrays.goal_graph import goal_graph
from robotouille.world.arrays.graph import Graph
from robotouille.world.sight import Seen, Sight, seen_by
from robotouille.world.world import State

SELF, SEEN, GOAL, SAID = "self", "seen", "goal", "said"
"""Features of the agent's own player, of things in sight or in the goal, and of messages."""

SILENCE = 0
"""Message of an agent that says nothing."""

Said = Sequence[int]
"""The last message of each player, by seat."""


class Observer:
    """Observations of the agents of an environment.

    Args:
        rules: The rules of the environment.
        views: Its instances.
        perspective: Difference between the agents.
    """

    def __init__(
        self, rules: EnvRules, views: Sequence[ObservationView], perspective: Perspective
    ) -> None:
        self.kind = EnvObservation(rules.observation)
        self._rules, self._views = rules, tuple(views)
        self._perspective = perspective
        self._goal = rules.goal
        self._tokens = rules.tokens
        self._sight = rules.sight
        self._last_state: State | None = None
        self._last_seen: dict[int, Seen] = {}
        counts = [len(view.world.encoding.objects) for view in views] if rules.sight else [0]
        self._objects = max(counts)
        self._limited = self._sight is not None or perspective is Perspective.EGOCENTRIC
        self._extended = self._sight is not None or self._goal or self._tokens > 0
        changed = self._limited or self._extended or perspective is Perspective.IDENTITY
        self._plain = self.kind is EnvObservation.VECTOR and not changed
        self._sizes = views[0].sizes
        self._players = largest_team(views)
        self._terms = max(len(view.world.goal.terms) for view in views) if rules.goal else 0
        self._places: dict[ObservationView, tuple[Places, ...]] = {}
        self._goals: dict[ObservationView, Graph] = {}
        self._first = views[0]
        self._state_size = self._sizes.vector
        if perspective is Perspective.EGOCENTRIC:
            self._state_size = max(len(own_columns(view)) for view in views)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of a vector's numbers in the first instance; see `Encoding.columns`.

        With several instances, numbers without a meaning in the first one are called `unused`.
        """
        egocentric = self._perspective is Perspective.EGOCENTRIC
        own = own_columns(self._first) if egocentric else self._first.world.encoding.columns
        unused = ("unused",) * (self._state_size - len(own))
        identity = self._perspective is Perspective.IDENTITY
        selves = tuple(f"{SELF}({player})" for player in self._players) if identity else ()
        things = [thing.name for thing in self._first.world.encoding.objects][: self._objects]
        seen = [f"{SEEN}({name})" for name in things]
        seen += ["unused"] * (self._objects - len(things))
        said = (f"{SAID}[{i}]({player})" for player in self._players for i in self._messages)
        goal = (f"{GOAL}[{i}]" for i in range(self._terms))
        return (*own, *unused, *selves, *seen, *goal, *said)

    @property
    def _messages(self) -> range:
        return range(1, self._tokens + 1)

    @cached_property
    def features(self) -> tuple[str, ...]:
        """Names of a graph node's numbers.

        They are `Encoding.features`, and as far as options request them `self`, `seen`, messages
        and `goal`.
        """
        own = () if self._perspective is Perspective.SHARED else (SELF,)
        seen = (SEEN,) if self._sight else ()
        said = (f"{SAID}[{i}]" for i in self._messages)
        goal = (GOAL,) if self._goal else ()
        return (*self._first.world.encoding.features, *own, *seen, *said, *goal)

    def space(self) -> spaces.Space[Any]:
        """Return the space of observations."""
        if self.kind is EnvObservation.TEXT:
            return text_space()
        if self.kind is EnvObservation.VECTOR:
            return spaces.Box(-1.0, self._sizes.high, (len(self.columns),), np.float32)
        encoding = self._first.world.encoding
        high = max(self._sizes.high, len(encoding.relations))
        nodes = spaces.Box(-1.0, high, (len(self.features),), np.float32)
        return spaces.Graph(nodes, spaces.Box(-1.0, high, (1 + encoding.counters,), np.float32))

    def observe_all(self, play: Play, said: Said) -> list[Any]:
        """Return the observation of each player's agent, in seat order."""
        seats = range(len(play.players))
        identity = self._perspective is Perspective.IDENTITY
        if self.kind is EnvObservation.VECTOR and identity and not self._extended:
            # One array for all agents takes less time than one for each.
            vectors = np.empty((len(seats), self._length), dtype=np.float32)
            vectors[:, : self._state_size] = play.arrays.vector
            vectors[:, self._state_size :] = self._identities[: len(seats)]
            return list(vectors)
        return [self.observe(play, seat, said) for seat in seats]

    @cached_property
    def _identities(self) -> Vector:
        return np.eye(len(self._players), dtype=np.float32)

    def observe(self, play: Play, seat: int | None = None, said: Said = ()) -> Any:
        """Return an observation of a game's state, as an object of its own.

        Args:
            seat: Seat of the agent, or None for an agent that controls all players.
            said: The players' messages, if there are any.
        """
        # A step of the world or the engine takes some microseconds, so the usual case is short.
        if self._plain:
            return play.arrays.vector.copy()
        if self.kind is EnvObservation.VECTOR:
            return self._vector(play, seat, said)
        players = play.players if seat is None else play.players[seat : seat + 1]
        if self.kind is EnvObservation.TEXT:
            texts = [self._text(play, player) for player in players]
            return "\n\n".join([*texts, *self._heard(play, said)])
        return self._graph(play, seat, said)

    def masks(self, play: Play) -> tuple[Mask, ...]:
        """Return each player's valid actions, for all that it sees. Do not change them."""
        masks, sight = play.arrays.masks, self._sight
        if sight is None:
            return masks
        return tuple(self._seeming(play, seat, sight, mask) for seat, mask in enumerate(masks))

    def _seeming(self, play: Play, seat: int, sight: Sight, mask: Mask) -> Mask:
        """Return the actions that are valid for all that an agent sees."""
        player, found = play.players[seat], np.zeros_like(mask)
        valid = self._seen(play, seat, sight).actions
        found[[play.state.action_number(action, player) for action in valid]] = 1
        return found

    def _seen(self, play: Play, seat: int, sight: Sight) -> Seen:
        # An agent's mask and observation are of the same state.
        if self._last_state is not play.state:
            self._last_state = play.state
            self._last_seen.clear()
        if seat not in self._last_seen:
            self._last_seen[seat] = seen_by(play.state, play.players[seat], sight)
        return self._last_seen[seat]

    def _visible(self, play: Play, seat: int | None) -> State:
        """Return the state, or the part of it that an agent sees."""
        if self._sight is None or seat is None:
            return play.state
        return self._seen(play, seat, self._sight).state

    def _in_sight(self, play: Play, seat: int, sight: Sight) -> Vector:
        """Return for each object or slot whether an agent sees it."""
        world, things = play.view.world, self._seen(play, seat, sight).things
        slots = world.encoding.slots.filled(play.state.facts)
        found = np.zeros(self._objects, dtype=np.float32)
        for i, thing in enumerate(world.encoding.objects):
            found[i] = slots.get(thing.name, thing.name) in things
        return found

    def _text(self, play: Play, player: str) -> str:
        if self._sight is None:
            return play.state.text_view(player)
        return self._seen(play, play.players.index(player), self._sight).text_view(player)

    def _heard(self, play: Play, said: Said) -> list[str]:
        """Return the messages in words."""
        if not self._tokens:
            return []
        lines = [
            f"- {player}: {token}"
            for player, token in zip(play.players, said, strict=True)
            if token != SILENCE
        ]
        return ["\n".join(["Messages of the last step:", *(lines or ["- none"])])]

    def _spoken(self, said: Said) -> Vector:
        """Return a row for each message, with a 1 in the place of its token."""
        return np.array([[token == i for i in self._messages] for token in said], np.float32)

    def _vector(self, play: Play, seat: int | None, said: Said) -> Vector:
        state = self._state(play, seat) if self._limited else play.arrays.vector
        vector, size = np.zeros(self._length, dtype=np.float32), self._state_size
        vector[:size] = state
        if seat is not None and self._perspective is Perspective.IDENTITY:
            vector[size + seat] = 1
        if self._extended:
            more = *self._flags(play, seat), *self._progress(play, seat), *self._signals(seat, said)
            parts = np.concatenate(more)
            vector[-len(parts) :] = parts
        return vector

    @cached_property
    def _length(self) -> int:
        return len(self.columns)

    def _state(self, play: Play, seat: int | None) -> Vector:
        """Return the part of the state that an agent sees, from its perspective."""
        state = play.arrays.vector
        if self._sight is not None:
            vector = self._visible(play, seat).vector()
            state = np.pad(vector, (0, self._sizes.vector - len(vector)))
        if self._perspective is Perspective.EGOCENTRIC and seat is not None:
            state = np.append(state, np.float32(0))[self._places_of(play.view)[seat]]
        return state

    def _flags(self, play: Play, seat: int | None) -> list[Vector]:
        """Return the objects in sight, if sight is limited."""
        if self._sight is None or seat is None:
            return []
        seen = self._in_sight(play, seat, self._sight)
        if self._perspective is Perspective.EGOCENTRIC:
            order = _order(play)
            seen[order] = [*seen[order[seat:]], *seen[order[:seat]]]
        return [seen]

    def _progress(self, play: Play, seat: int | None) -> list[Vector]:
        """Return which conditions of the goal hold, if that is observed."""
        if not self._goal:
            return []
        visible = self._visible(play, seat)
        progress = np.zeros(self._terms, dtype=np.float32)
        holding = [holds for _, holds in visible.world.goal_terms(visible)]
        progress[: len(holding)] = holding
        return [progress]

    def _signals(self, seat: int | None, said: Said) -> list[Vector]:
        """Return the messages of all players, if agents can send some."""
        if not self._tokens:
            return []
        if self._perspective is Perspective.EGOCENTRIC and seat is not None:
            said = [*said[seat:], *said[:seat]]
        spoken = np.zeros((len(self._players), self._tokens), dtype=np.float32)
        spoken[: len(said)] = self._spoken(said)
        return [spoken.ravel()]

    def _places_of(self, view: ObservationView) -> tuple[Places, ...]:
        """Return, for each seat, the places in a padded vector of an agent's own columns."""
        found = self._places.get(view)
        if found is None:
            found = self._places[view] = places(view, self._state_size)
        return found

    def _graph(self, play: Play, seat: int | None, said: Said) -> GraphInstance:
        graph, order = self._visible(play, seat).graph(), _order(play)
        own = self._perspective is not Perspective.SHARED
        more = own + (self._sight is not None) + self._tokens
        nodes = np.pad(graph.nodes, ((0, 0), (0, more)))
        if self._sight is not None and seat is not None:
            seen = self._in_sight(play, seat, self._sight)[: len(nodes)]
            nodes[:, graph.nodes.shape[1] + own] = seen
        if self._tokens:
            nodes[order, -self._tokens :] = self._spoken(said)
        if seat is not None and own:
            nodes[order[seat], graph.nodes.shape[1]] = 1
        graph = graph._replace(nodes=nodes)
        if seat is not None and self._perspective is Perspective.EGOCENTRIC:
            graph = turned(graph, order, seat)
        if self._goal:
            graph = _with_goal(graph, self._goal_of(play.view))
        relations = graph.edges[:, :1].astype(np.float32)
        return GraphInstance(
            graph.nodes, np.hstack([relations, graph.counters]), graph.edges[:, 1:]
        )

    def _goal_of(self, view: ObservationView) -> Graph:
        found = self._goals.get(view)
        if found is None:
            found = self._goals[view] = goal_graph(view.world, view.world.encoding)
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        return Observer, (self._rules, self._views, self._perspective)


def _order(play: Play) -> list[int]:
    """Return the place of each player among the objects."""
    names = [thing.name for thing in play.view.world.encoding.objects]
    return [names.index(player) for player in play.players]


def _with_goal(graph: Graph, goal: Graph) -> Graph:
    """Return a graph with the nodes of a goal at the end, and a feature that marks them."""
    count, width = graph.nodes.shape
    nodes = np.pad(graph.nodes, ((0, len(goal.nodes)), (0, 1)))
    nodes[count:, : goal.nodes.shape[1]] = goal.nodes
    nodes[count:, width] = 1
    edges = np.concatenate([graph.edges, goal.edges + np.array([0, count, count])])
    return Graph(nodes, edges, np.concatenate([graph.counters, goal.counters]))
