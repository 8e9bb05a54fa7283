"""Mapping of clicks and keys to actions, with a domain's input file.

The functions are pure: names of objects, buttons and keys go in, an action comes out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.rendering import Language, language_of
from robotouille.domain.schema import InputFile
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.objects import Tile
from robotouille.world.presentation.near_misses import (
    InputBinding,
    NearMisses,
    Situation,
    things_upon,
)
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import useful_actions, work_in_progress
from robotouille.world.scene import Placed, scene
from robotouille.world.timers import Progress
from robotouille.world.world import State, World

Button = Literal["left", "middle", "right"]
Direction = tuple[int, int]


@dataclass(frozen=True, slots=True)
class ResolvedInput:
    """Action that a click or key stands for, and a hint.

    Attributes:
        action: The action; None if the input stands for none.
        hint: The action in words or, if it is not possible, the reason.
        valid: True if the action is valid; an invalid action will be rejected.
        advice: True if the hint says what to do instead.
    """

    action: GroundAction | None
    hint: str
    valid: bool = False
    advice: bool = False


@dataclass(frozen=True, slots=True)
class Option:
    """A key, and the action it stands for now."""

    key: str
    action: GroundAction


class Controls:
    """Clicks and keys of one player.

    The input file's binding of a click or key comes first. If that action is not valid or changes
    nothing, a click on the player's own station stands for a key's action there, and a key stands
    for a click's action that makes sense (`sensible`). `names` are the participants' names by
    player.
    """

    def __init__(
        self, world: World, bindings: InputFile | None = None, language: Language | None = None
    ) -> None:
        self.world = world
        self.names: Mapping[str, str] = MappingProxyType({})
        self.bindings = bindings or bindings_of(world.task)
        self.language = language_of(world.task) if language is None else language
        schemas = {schema.name: schema for schema in world.schemas}
        self._clicks: dict[str, list[InputBinding]] = {}
        self._keys: dict[str, list[InputBinding]] = {}
        for click in self.bindings.mouse_click_actions:
            how = click.input_instructions
            if click.name in schemas:
                binding = InputBinding(schemas[click.name], how.click_on)
                self._clicks.setdefault(how.button, []).append(binding)
        for key in self.bindings.keyboard_actions:
            if key.name in schemas:
                binding = InputBinding(schemas[key.name], key.input_instructions.at)
                name = key.input_instructions.key.casefold()
                self._keys.setdefault(name, []).append(binding)

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of the input file, in its order."""
        return tuple(self._keys)

    def is_for_places(self, key: str) -> bool:
        """Return whether the key's action depends on the player's station."""
        return any(binding.parameter for binding in self._keys.get(key, ()))

    def wording(self, me: str | None) -> Wording:
        """Return the wording for the participant who plays `me`."""
        others = {player: name for player, name in self.names.items() if player != me and name}
        return Wording(self.world, self.language, me, others)

    def click(self, state: State, me: str, target: str, button: Button = "left") -> ResolvedInput:
        """Resolve a click on an object or on one of the things on it."""
        situation = Situation(state, me, scene(state))
        own = self._clicks.get(button, [])
        # Players who click where they stand do not want to walk there.
        others = self._keys_at_a_place() if own and target == situation.at else []
        there = [target, *things_upon(target, situation.placed)]
        # A key that is pressed once too often must do nothing else. A click has other actions.
        return self._resolve(situation, own, others, there, only_own_at_work=False)

    def key(self, state: State, me: str, key: str) -> ResolvedInput:
        """Resolve a key at the player's station."""
        situation = Situation(state, me, scene(state))
        own = self._keys.get(key.casefold(), [])
        here = [situation.at, *things_upon(situation.at, situation.placed)] if situation.at else []
        at_a_place = any(binding.parameter for binding in own)
        others = self._clicks.get("left", []) if at_a_place and here else []
        return self.sensible(state, me, self._resolve(situation, own, others, here))

    def sensible(self, state: State, me: str, resolved: ResolvedInput) -> ResolvedInput:
        """Return what a key does: nothing if it would put an object where it is of no use.

        Players who press a key at a stove want to cook, and at a crate to take something. A click
        puts objects down anywhere.
        """
        action = resolved.action if resolved.valid else None
        vain = "" if action is None else self._vain(state, me, action)
        return ResolvedInput(None, vain, advice=True) if vain else resolved

    def _vain(self, state: State, me: str, action: GroundAction) -> str:
        """Return why a station is of no use for what an action puts there, or ""."""
        before = Situation(state, me, scene(state))
        station, works = before.at, self._keys_at_a_place()
        if action.effects or station is None or not before.held:
            return ""
        thing, *_ = things_upon(me, before.placed)
        pile = things_upon(station, before.placed)
        misses = NearMisses(self.world, self.wording(me))
        workplace = any(misses.is_for(each, station) for each in works)
        if pile and workplace:
            # A second tomato on a board would only be in the way.
            twice = self._are_alike(thing, pile[0]) and not misses.serves_goal(action)
            noun = self.wording(me).kind(self.world.thing(thing).kind)
            return f"One {noun} at a time here" if twice else ""
        if pile:
            mixes = self._is_supply(station, pile) and not self._are_alike(thing, pile[0])
            words = capitalised(self.wording(me).thing(thing, state))
            return f"{words} does not belong here" if mixes else ""
        if not workplace:
            return ""
        after = State(self.world, facts_after(state, action), state.timers, state.orders)
        then = Situation(after, me, scene(after))
        if then.held or self.options(after, me) or misses.serves_goal(action, station):
            return ""
        here = [station, *things_upon(station, then.placed)]
        # Work that was interrupted at this station goes on.
        work = work_in_progress(self.world.successor(state, action))
        if any(row.subject in here and station in row.arguments for row in work):
            return ""
        miss = misses.nearest(then, works, here, at_work=False)
        vain = f"Nothing to do with {self.wording(me).thing(thing, state)} here"
        return miss.words if miss.advice else vain

    def _is_supply(self, station: str, pile: Sequence[str]) -> bool:
        """Return whether a pile is a supply, as in a crate, and not a dish."""
        shift = self.world.shift
        if station in self.world.floor.plain or (shift is not None and station in shift.serving):
            return False
        return len(pile) > 1 and all(self._are_alike(pile[0], name) for name in pile)

    def _are_alike(self, one: str, other: str) -> bool:
        return self.world.thing(one).kind == self.world.thing(other).kind

    def options(self, state: State, me: str) -> tuple[Option, ...]:
        """Return the keys whose own action at this station is valid and useful now."""
        situation, found = Situation(state, me, scene(state)), []
        here = [situation.at] if situation.at else []
        for key, bindings in self._keys.items():
            if all(binding.parameter is None for binding in bindings):
                continue
            action = _useful(situation, bindings, here)
            if action is not None:
                found.append(Option(key, action))
        return tuple(found)

    def help(self) -> tuple[tuple[str, str], ...]:
        """Return rows of (input, what it does), in the order of the input file."""
        rows = []
        for button, bindings in self._clicks.items():
            rows.append((f"{button.capitalize()} click", self._names(bindings)))
        for key, bindings in self._keys.items():
            rows.append((key.upper() if len(key) == 1 else key.capitalize(), self._names(bindings)))
        return tuple(rows)

    def _names(self, bindings: list[InputBinding]) -> str:
        """Return what some bindings do, without naming objects."""
        wording = self.wording(None)
        return ", ".join(dict.fromkeys(wording.in_general(each.schema) for each in bindings))

    def _keys_at_a_place(self) -> list[InputBinding]:
        return [each for bindings in self._keys.values() for each in bindings if each.parameter]

    def _resolve(
        self,
        situation: Situation,
        own: list[InputBinding],
        others: list[InputBinding],
        candidates: list[str],
        *,
        only_own_at_work: bool = True,
    ) -> ResolvedInput:
        """Resolve an input to its own bindings, or else to others.

        Args:
            only_own_at_work: True if work that goes on here rules out the others.
        """
        if not own:
            return ResolvedInput(None, "")
        state, me = situation.state, situation.me
        busy = state.busy_steps(me)
        if busy:
            return ResolvedInput(None, f"you are busy for {busy} more step{'s' * (busy > 1)}")
        action = _useful(situation, own, candidates)
        at_work = action is None and _is_at_work(situation, own, candidates)
        if action is None and not (at_work and only_own_at_work):
            action = _useful(situation, others, candidates)
        if action is not None:
            return ResolvedInput(action, capitalised(self.wording(me).action(action, state)), True)
        misses = NearMisses(self.world, self.wording(me))
        miss = misses.nearest(situation, [*own, *others], candidates, at_work=at_work)
        return ResolvedInput(miss.action, miss.words, advice=miss.advice)


def _useful(
    situation: Situation, bindings: list[InputBinding], candidates: list[str]
) -> GroundAction | None:
    """Return the first valid and useful action of some bindings."""
    valid = useful_actions(situation.state, situation.me) if bindings else ()
    for binding in bindings:
        for action in valid:
            if action.schema is binding.schema and _fits(action, binding, candidates):
                return action
    return None


def _is_at_work(situation: Situation, bindings: list[InputBinding], candidates: list[str]) -> bool:
    """Return whether the bindings' work is going on or done here."""
    if any(row.subject in candidates for row in work_in_progress(situation.state)):
        return True
    valid = situation.state.actions(situation.me)
    return any(a.schema is b.schema and _fits(a, b, candidates) for b in bindings for a in valid)


def _fits(action: GroundAction, binding: InputBinding, candidates: list[str]) -> bool:
    if binding.parameter is None:
        return True
    return action.schema.bind(action.arguments).get(binding.parameter) in candidates


_ASIDE = 2
"""Weight of a tile to the side, compared with one ahead."""


def walks(state: State, me: str) -> dict[str, GroundAction]:
    """Return the player's valid walks, by the station they lead to."""
    found: dict[str, GroundAction] = {}
    for action in state.actions(me):
        there = action.destination
        if there is not None:
            found.setdefault(there, action)
    return found


def towards(
    state: State, me: str, directions: Sequence[Direction], placed: dict[str, Placed]
) -> GroundAction | None:
    """Return the walk in some directions, one after the other, without stops on the way.

    The first direction is relative to the station where the player is, or else to the player's
    tile, and each other direction to the station before it. A direction without a free station on
    that side changes nothing.

    Returns:
        None if the directions lead nowhere, or back to where the player is.
    """
    own = placed.get(me)
    if own is None:
        return None
    here = placed[own.at].tile if own.at else own.tile
    if here is None:
        return None
    valid = walks(state, me)
    reachable = [name for name in {*valid, own.at} if name]
    target = own.at
    for direction in directions:
        found = _nearest(here, direction, reachable, placed)
        if found is not None:
            target, here = found
    return valid.get(target) if target else None


def _nearest(
    here: Tile, direction: Direction, names: Iterable[str], placed: dict[str, Placed]
) -> tuple[str, Tile] | None:
    """Return the nearest of some stations in a direction, and its tile."""
    # Ties go to the first name, so that the same key always leads to the same station.
    ranked = []
    for name in names:
        there = placed[name].tile
        far = None if there is None else _distance(here, there, direction)
        if there is not None and far is not None:
            ranked.append((far, name, there))
    return min(ranked)[1:] if ranked else None


def _distance(here: Tile, there: Tile, direction: Direction) -> tuple[bool, int] | None:
    """Return how far off a tile is in a direction; None if it is not on that side.

    Tiles that lie more to the side than ahead come last: nobody expects that a key for walking to
    the right leads to the corner above.
    """
    dx, dy = there[0] - here[0], there[1] - here[1]
    ahead = dx * direction[0] + dy * direction[1]
    aside = abs(dx * direction[1]) + abs(dy * direction[0])
    return (aside > ahead, ahead + _ASIDE * aside) if ahead > 0 else None


WAIT = "wait until it is done, or click to take it"
EARLY = "before it is done"
HOLDS = "shares_tile"
"""Layout rule of the predicates that say who carries what."""
STACKED = "next_in_stack"
"""Layout rule of the predicates that say what lies on what."""


def possible(state: State, me: str) -> tuple[GroundAction, ...]:
    """Return the player's useful actions, the most useful ones first.

    The order is: work, picking up and putting down here; walks to stations with something on
    them; other walks, the nearest first; waiting.
    """
    walks = _Walks(state, me)
    return tuple(sorted(useful_actions(state, me), key=lambda a: _order(state, me, a, walks)))


def _order(state: State, me: str, action: GroundAction, walks: _Walks) -> tuple[int, int]:
    there = action.destination
    if there is not None:
        return (3 if walks.matters(there) else 4), walks.steps(there)
    if not (action.touched or action.effects):
        return 5, 0
    before, after = (
        _carried(state, me, state.facts),
        _carried(state, me, facts_after(state, action)),
    )
    more = len(after) - len(before)
    return (0, 1, 2)[(more > 0) + 2 * (more < 0)], 0


def handled(state: State, me: str, action: GroundAction) -> frozenset[str]:
    """Return the things that an action puts into a player's hands or takes from them."""
    return _carried(state, me, state.facts) ^ _carried(state, me, facts_after(state, action))


def takes(state: State, me: str, action: GroundAction) -> bool:
    """Return whether an action puts something into a player's hands."""
    after = facts_after(state, action)
    return bool(_carried(state, me, after) - _carried(state, me, state.facts))


def takes_apart(state: State, action: GroundAction) -> bool:
    """Return whether an action separates two things that may belong together in a dish."""
    world = state.world
    stacks = {rule.predicate for rule in world.task.domain.layout or () if rule.when == STACKED}
    removed = (world.table.atoms[bit] for bit in bits_of(action.removed & state.facts))
    pairs = [{world.thing(name).kind for name in atom[1:]} for atom in removed if atom[0] in stacks]
    # Equal things are a supply.
    pairs = [kinds for kinds in pairs if len(kinds) > 1]
    if not pairs:
        return False
    dishes = [] if world.shift is None else [world.shift.goal(name) for name in world.shift.menu]
    return any(
        kinds <= {variable.kind for variable in goal.variables.values()}
        for goal in (world.goal, *dishes)
        for kinds in pairs
    )


def facts_after(state: State, action: GroundAction) -> int:
    """Return the facts after an action, without the passing of time."""
    return (state.facts | action.touched) ^ action.removed


def _carried(state: State, me: str, facts: int) -> frozenset[str]:
    """Return the things that a player carries."""
    world = state.world
    carries = {rule.predicate for rule in world.task.domain.layout or () if rule.when == HOLDS}
    mine = (world.table.atoms[bit] for bit in bits_of(facts & world.table.mentions(me)))
    return frozenset(name for atom in mine if atom[0] in carries for name in atom[1:]) - {me}


class _Walks:
    """Contents and distances of the stations."""

    def __init__(self, state: State, me: str) -> None:
        placed = scene(state)
        self._resolve_use = {each.host for each in placed.values()}
        self._here = placed[me].at
        self._world = state.world

    def matters(self, station: str) -> bool:
        """Return whether something lies on the station or can be done there."""
        return station in self._resolve_use or station not in self._world.floor.plain

    def steps(self, station: str) -> int:
        return self._world.floor.distance(self._here, station) if self._here else 0


def walk(
    controls: Controls, state: State, me: str, directions: Sequence[Direction]
) -> ResolvedInput:
    """Resolve direction keys that were pressed one after the other."""
    busy = state.busy_steps(me)
    if busy:
        return ResolvedInput(None, f"you are busy for {busy} more step{'s' * (busy > 1)}")
    action = towards(state, me, directions, scene(state))
    if action is None:
        return ResolvedInput(None, "there is no free station that way")
    return ResolvedInput(action, controls.wording(me).action(action, state), True)


def use(controls: Controls, state: State, me: str, key: str = "") -> ResolvedInput:
    """Resolve the use key: the most useful action here.

    That is a key's work here, or else what a click on the station would do. Work that goes on by
    itself is not interrupted.

    Args:
        key: The key that was pressed. Its binding in the domain's input file comes first.
    """
    own = controls.key(state, me, key) if key in controls.keys else None
    if own is not None and own.valid:
        return own
    for option in controls.options(state, me):
        return controls.key(state, me, option.key)
    here = scene(state)[me].at
    if here is None:
        return own or ResolvedInput(None, "nothing to do here")
    clicked = controls.click(state, me, here)
    if clicked.valid and clicked.action and ends_work(state, clicked.action):
        return ResolvedInput(None, WAIT)
    if clicked.action is not None or own is None or own.action is None:
        return controls.sensible(state, me, clicked)
    return own


def ends_work(state: State, action: GroundAction) -> bool:
    """Return whether an action interrupts work that continues without a player."""
    # Work that players repeat does not continue by itself: the last stroke does not interrupt it.
    running = [_key(row) for row in work_in_progress(state) if row.running and row.timed]
    if not running:
        return False
    # Work may end by itself in this step. Only a comparison shows what the action causes.
    then, without = _running(state.step(action).state), _running(state.step([]).state)
    return any(not then[key] if key in then else without.get(key, False) for key in running)


def _running(state: State) -> dict[tuple[str, tuple[str, ...]], bool]:
    """Return the work in progress, and whether each part goes on."""
    return {_key(row): row.running for row in work_in_progress(state)}


def _key(row: Progress) -> tuple[str, tuple[str, ...]]:
    return row.action, row.arguments
