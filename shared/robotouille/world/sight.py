"""Partial observability: the part of a state that one player sees (docs/episodes.md).

A player knows the kitchen's plan, which things exist and what never changes about them. Of things
out of sight it does not know where they are and in which condition.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import ceil, floor
from weakref import WeakKeyDictionary

from robotouille.domain.schema import Condition
from robotouille.errors import UnknownNameError, WrongArgumentError
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.objects import Atom, Object, Tile, bound
from robotouille.world.scene import Placed, scene
from robotouille.world.text import conditions_text, observation, orders_text, text_view
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World

ON_A_TILE = frozenset({"shares_tile", "bottom_of_stack", "next_in_stack"})
FACING = frozenset({*ON_A_TILE, "faces"})
"""Rules of layouts whose predicates relate things at one place, and those that also relate a player
and its station."""


@dataclass(frozen=True)
class Sight:
    """Rule for what players see.

    Args:
        distance: Number of tiles that a player sees in each direction, also diagonally. None is no
            limit.
        blocked: True if stations hide what is behind them.

    Raises:
        WrongArgumentError: The distance is not a number of tiles.
    """

    distance: int | None = None
    blocked: bool = False

    def __post_init__(self) -> None:
        limit = self.distance
        if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int)):
            raise WrongArgumentError(f"distance: expected a number of tiles, found {limit!r}")
        if limit is not None and limit < 1:
            raise WrongArgumentError(f"distance: expected 1 or more tiles, found {limit}")

    def reaches(self, here: Tile, there: Tile, stations: frozenset[Tile]) -> bool:
        """Return whether a player on one tile sees another tile."""
        steps = max(abs(here[0] - there[0]), abs(here[1] - there[1]))
        if self.distance is not None and steps > self.distance:
            return False
        return not self.blocked or _is_free(here, there, stations)


PART_OF_KITCHEN = (
    "You see a part of the kitchen. Of things out of sight, you know neither the place nor the "
    "condition, and actions may fail because of them."
)
"""Explanation for language models, in each text because some prompts contain the last text only."""


@dataclass(frozen=True)
class Found:
    """Results about the visible facts, which states with the same facts and busy players share.

    Finding the actions and writing the text takes twenty times as long as finding what is in sight.

    Attributes:
        actions: The actions by player.
        texts: The observations by player, without orders and conditions.
    """

    actions: dict[str, tuple[GroundAction, ...]] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Seen:
    """The part of a state that some players see, or one of them.

    Attributes:
        state: The state without facts and effects of things out of sight, apart from their
            existence. It is for observations only: steps from it are wrong.
        things: Names of the objects in sight.
        players: The players.
        found: Results that earlier states share.
    """

    state: State
    things: frozenset[str]
    players: tuple[str, ...]
    found: Found = field(default_factory=Found, compare=False, repr=False)

    @cached_property
    def hidden(self) -> tuple[str, ...]:
        """Names of the objects out of sight, in the order of `ranks`."""
        rank, names = ranks(self.state.world), (thing.name for thing in self.state.objects)
        return tuple(sorted((n for n in names if n not in self.things), key=rank.__getitem__))

    @property
    def actions(self) -> tuple[GroundAction, ...]:
        """The actions of the first player; see `actions_of`."""
        return self.actions_of(self.players[0])

    def actions_of(self, player: str) -> tuple[GroundAction, ...]:
        """Return a player's actions whose conditions in sight hold.

        If another condition is out of sight, the action may turn out to be invalid.
        """
        actions = self.found.actions
        if player not in actions:
            actions[player] = tuple(_seemingly_valid(self.state, player, self._doubtful))
        return actions[player]

    def after(self, earlier: Seen) -> Seen:
        """Return this view with the results of an earlier one of the same players."""
        if earlier == self:
            return earlier
        if self._basis != earlier._basis:
            return self
        return replace(self, found=earlier.found)

    def of_later(self, state: State) -> Seen:
        """Return what the players see of a later state with the same facts."""
        seen = _seen(state, self.state.facts, self.things)
        return Seen(seen, self.things, self.players).after(self)

    @property
    def _basis(self) -> tuple[object, ...]:
        """Everything on which `found` depends."""
        return self.state.facts, self.state.timers.busy, self.things

    @cached_property
    def _doubtful(self) -> int:
        """Mask of the facts that may be true or false, for all that the players see."""
        table = self.state.world.table
        doubtful = _about(self.state, self.hidden)
        # Things do not lie on themselves. Hidden things do not lie at places in sight. Players know
        # where they stand and what they hold.
        doubtful &= ~table.reflexive
        doubtful &= ~(_relations(self.state.world, ON_A_TILE) & _about(self.state, self.things))
        return doubtful & ~(_relations(self.state.world, FACING) & _about(self.state, self.players))

    def unmet(self, action: GroundAction) -> tuple[Unmet, ...]:
        """Return the reasons against an action that the players can see.

        The result is empty for the actions of `actions_of`.
        """
        world, sure = self.state.world, action.tested & ~self._doubtful
        # This test takes a hundredth of the time of the reasons.
        if self.state.facts & sure == action.required & sure and not self.state.timers.busy:
            return ()
        return tuple(r for r in world.unmet(self.state, action) if self._is_sure(r))

    def _is_sure(self, reason: Unmet) -> bool:
        bit = self.state.world.table.bit.get((reason.predicate, *reason.objects), 0)
        return not bit & self._doubtful

    def text_view(self, player: str) -> str:
        """Return the text for a language model, as `State.text_view` does."""
        world, state = self.state.world, self.state
        if world.shift is not None and state.orders is not None:
            end = orders_text(world, world.shift, state.orders)
        else:
            end = conditions_text(world.goal_terms(state))
        texts = self.found.texts
        if player not in texts:
            beyond = f"{PART_OF_KITCHEN}\nOut of sight: {', '.join(self.hidden) or 'nothing'}."
            text = observation(world, state.facts, self.actions_of(player), ranks(world))
            texts[player] = f"{beyond}\n\n{text}"
        return text_view(texts[player], player, end)


def seen_by(state: State, players: str | Sequence[str], sight: Sight) -> Seen:
    """Return what a player sees of a state, or what several players see together.

    Raises:
        UnknownNameError: No such player.
    """
    world = state.world
    players = (players,) if isinstance(players, str) else tuple(players)
    for player in players:
        if player not in world.players:
            raise UnknownNameError.player(player, world.players)
    things = frozenset(name for player in players for name in _in_sight(state, player, sight))
    hidden = (thing.name for thing in state.objects if thing.name not in things)
    return Seen(_seen(state, state.facts & ~_about(state, hidden), things), things, players)


def _seen(state: State, facts: int, things: frozenset[str]) -> State:
    """Return a state with only these facts, and the effects on things in sight."""
    timers = state.world.timers.get(
        tuple(entry for entry in state.timers.entries if things.issuperset(entry[0].label[2])),
        tuple(row for row in state.timers.busy if row[0] in things),
    )
    return State(state.world, facts, timers, state.orders)


_ranks: WeakKeyDictionary[World, tuple[int, Mapping[str, int]]] = WeakKeyDictionary()


def ranks(world: World) -> Mapping[str, int]:
    """Return the rank of each object in an order that does not show where it was at the start.

    A world's own order is that of the first places. Here, objects are sorted by type, stations and
    players in the world's order, and all others by kind and number.
    """
    known = _ranks.get(world)
    # The number of atoms grows with the objects.
    if known is None or known[0] != len(world.table.atoms):
        types = {kind: i for i, kind in enumerate(world.task.domain.object_types)}
        fixed = {*world.task.domain.station_types, *world.task.domain.player_types}

        def key(row: tuple[int, Object]) -> tuple[int, str, int]:
            i, thing = row
            if thing.type in fixed:
                return types[thing.type], "", i
            return types[thing.type], thing.kind, int(thing.name[len(thing.kind) :])

        order = sorted(enumerate(world.all_objects()), key=key)
        found = {thing.name: rank for rank, (_, thing) in enumerate(order)}
        known = _ranks[world] = len(world.table.atoms), found
    return known[1]


HIDDEN_REASON = "something out of sight prevents it"


def told(unmet: Iterable[Unmet], things: Collection[str]) -> tuple[Unmet, ...]:
    """Return the reasons that a player with these things in sight may learn.

    If all reasons are about other things, one without details takes their place.
    """
    known = {*things}
    shown = [r for r in unmet if r.kind is not UnmetKind.CONDITION or known.issuperset(r.objects)]
    return tuple(shown) or (Unmet(UnmetKind.OTHER, HIDDEN_REASON),)


def _about(state: State, names: Iterable[str]) -> int:
    """Return the mask of the facts about things, apart from their existence."""
    table, mask = state.world.table, 0
    for name in names:
        mask |= table.mentions(name)
    return mask & ~table.internal


def _relations(world: World, rules: Collection[str]) -> int:
    """Return the mask of the predicates that the domain's layout defines by these rules."""
    mask = 0
    for rule in world.task.domain.layout or ():
        if rule.when in rules and rule.predicate in world.table.fluents:
            mask |= world.table.matching((rule.predicate, None, None))
    return mask


def _in_sight(state: State, player: str, sight: Sight) -> Iterator[str]:
    """Yield the objects that a player sees: also its own station and what it holds."""
    placed = scene(state)
    if player not in placed:  # The domain has deleted the player.
        return
    me, stations = placed[player], state.world.floor.blocked
    vessels = {inner: name for name, each in placed.items() for inner in each.contents}
    for name, thing in placed.items():
        own = name in (player, me.at) or player in (name, thing.host)
        tile = _tile(name, placed, vessels)
        if own or me.tile is None or tile is None or (
            sight.reaches(me.tile, tile, stations)
            or (me.at is not None and tile == placed[me.at].tile)
        ):  # fmt: skip
            yield name


def _tile(name: str, placed: Mapping[str, Placed], vessels: Mapping[str, str]) -> Tile | None:
    """Return the tile of a thing, or that of what it has been added to, as to a soup."""
    # The loop is bounded because custom domains can have cyclic relations.
    for _ in range(len(placed)):
        if placed[name].tile is not None or name not in vessels:
            break
        name = vessels[name]
    return placed[name].tile


def _seemingly_valid(state: State, player: str, doubtful: int) -> Iterator[GroundAction]:
    """Yield the player's actions whose conditions hold, apart from doubtful ones, in order."""
    if state.busy_steps(player):
        return
    world, rank = state.world, ranks(state.world)
    choices = _Choices(state, doubtful)
    for schema in world.schemas:
        found = choices.of(schema, player)
        for names in sorted(found, key=lambda names: [rank[name] for name in names]):
            yield world.ground_action(schema, names)


Names = Mapping[str, str]
"""Parameters of an action, with objects or types."""


class _Choices:
    """Objects for the parameters of actions, chosen by the facts that are not doubtful.

    It does not use the numbers of actions, because they take seconds to compute for a large
    kitchen, and NumPy.
    """

    def __init__(self, state: State, doubtful: int) -> None:
        self._table, self._facts, self._doubtful = state.world.table, state.facts, doubtful
        self._by_type: dict[str, list[str]] = {}
        for thing in state.objects:
            self._by_type.setdefault(thing.type, []).append(thing.name)

    def of(self, schema: ActionSchema, player: str) -> Iterator[tuple[str, ...]]:
        """Yield the arguments with which a player's action may be valid."""
        binding = {schema.parameters[0][0]: player} if schema.player else {}
        conditions = schema.definition.precons
        own = [c for c in conditions if binding.keys() >= {*c.params}]
        if all(self._is_possible(bound(c, binding), c.is_true) for c in own):
            open_ = {name: kind for name, kind in schema.parameters if name not in binding}
            for found in self._extended(conditions, binding, open_):
                yield tuple(found[name] for name, _ in schema.parameters)

    def _extended(
        self, conditions: Sequence[Condition], binding: Names, open_: Names
    ) -> Iterator[Names]:
        """Yield all ways to bind the open parameters, which have these types."""
        if not open_:
            yield binding
            return
        pools: dict[str, list[Names]] = {}
        for name, kind in open_.items():
            pools[name] = self._bound(conditions, binding, name, kind)
            if not pools[name]:
                return
        # The player's station has one choice. Beginning with it leaves few choices for the others.
        first = min(pools, key=lambda name: len(pools[name]))
        rest = {name: kind for name, kind in open_.items() if name != first}
        for found in pools[first]:
            yield from self._extended(conditions, found, rest)

    def _bound(
        self, conditions: Sequence[Condition], binding: Names, name: str, kind: str
    ) -> list[Names]:
        """Return all ways to bind one more parameter."""
        tested = [
            c for c in conditions if name in c.params and binding.keys() >= {*c.params} - {name}
        ]
        found: list[Names] = []
        for thing in self._by_type.get(kind, ()):
            extended = {**binding, name: thing}
            if all(self._is_possible(bound(c, extended), c.is_true) for c in tested):
                found.append(extended)
        return found

    def _is_possible(self, atom: Atom, is_true: bool) -> bool:
        bit = self._table.bit.get(atom)
        if bit is None:
            return (atom in self._table.static) == is_true
        return bool(bit & self._doubtful) or bool(bit & self._facts) == is_true


@lru_cache(maxsize=1 << 14)
def _is_free(here: Tile, there: Tile, stations: frozenset[Tile]) -> bool:
    """Return whether no station hides a tile. Stations never move, so this is often repeated."""
    steps = max(abs(here[0] - there[0]), abs(here[1] - there[1]))
    return all(
        any(tile not in stations for tile in tiles) for tiles in _between(here, there, steps)
    )


def _between(here: Tile, there: Tile, steps: int) -> Iterator[set[Tile]]:
    """Yield the tiles on a straight line without its ends; two where it runs between them."""
    for i in range(1, steps):
        x = here[0] + (there[0] - here[0]) * i / steps
        y = here[1] + (there[1] - here[1]) * i / steps
        yield {(across, up) for across in _nearest(x) for up in _nearest(y)}


def _nearest(value: float) -> set[int]:
    return {floor(value + 0.5), ceil(value - 0.5)}
