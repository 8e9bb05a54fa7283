"""What a player can do now, and which of it is the most useful."""

from __future__ import annotations

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.people.usefulness import useful_actions, work_in_progress
from robotouille.world.scene import scene
from robotouille.world.timers import Progress
from robotouille.world.world import State
from robotouille_client.window.hands.controls import Controls, Meaning
from robotouille_client.window.hands.walking import towards

__all__ = ["EARLY", "WAIT", "ends_work", "possible", "use", "walk"]

WAIT = "wait until it is done, or click to take it"
EARLY = "before it is done"
HOLDS = "shares_tile"
"""The layout rule of predicates that say who carries what."""


def possible(state: State, me: str) -> tuple[GroundAction, ...]:
    """What a player can do that changes something, the useful things first: work, picking up and
    putting down here; walks to where there is something; other walks; at last to do nothing.

    Of walks the nearest come first.
    """
    walks = _Walks(state, me)
    return tuple(sorted(useful_actions(state, me), key=lambda a: _order(state, me, a, walks)))


def _order(state: State, me: str, action: GroundAction, walks: _Walks) -> tuple[int, int]:
    there = action.destination
    if there is not None:
        return (3 if walks.matters(there) else 4), walks.steps(there)
    if not (action.touched or action.effects):
        return 5, 0
    after = (state.facts | action.touched) ^ action.removed
    more = _carried(state, me, after) - _carried(state, me, state.facts)
    return (0, 1, 2)[(more > 0) + 2 * (more < 0)], 0


def _carried(state: State, me: str, facts: int) -> int:
    """How much a player carries."""
    world = state.world
    carries = {rule.predicate for rule in world.task.domain.layout or () if rule.when == HOLDS}
    mine = bits_of(facts & world.table.mentions(me))
    return sum(world.table.atoms[bit][0] in carries for bit in mine)


class _Walks:
    """What there is at the stations, and how far they are."""

    def __init__(self, state: State, me: str) -> None:
        placed = scene(state)
        self._used = {each.host for each in placed.values()}
        self._here = placed[me].at
        self._world = state.world

    def matters(self, station: str) -> bool:
        """Whether something lies there, or may be done there."""
        return station in self._used or station not in self._world.floor.plain

    def steps(self, station: str) -> int:
        return self._world.floor.distance(self._here, station) if self._here else 0


def walk(controls: Controls, state: State, me: str, direction: tuple[int, int]) -> Meaning:
    """What a direction key means."""
    busy = state.busy_steps(me)
    if busy:
        return Meaning(None, f"you are busy for {busy} more step{'s' * (busy > 1)}")
    action = towards(state, me, direction, scene(state))
    if action is None:
        return Meaning(None, "there is no free place that way")
    return Meaning(action, controls.wording(me).action(action, state), True)


def use(controls: Controls, state: State, me: str, key: str = "") -> Meaning:
    """The most useful thing to do here: work that a key stands for, else what a click on the
    station would do. What is at work by itself stays where it is.

    Args:
        key: The one that was pressed; what the domain's input file says of it comes first.
    """
    own = controls.key(state, me, key) if key in controls.keys else None
    if own is not None and own.valid:
        return own
    for option in controls.options(state, me):
        return controls.key(state, me, option.key)
    here = scene(state)[me].at
    if here is None:
        return own or Meaning(None, "nothing to do here")
    clicked = controls.click(state, me, here)
    if clicked.valid and clicked.action and ends_work(state, clicked.action):
        return Meaning(None, WAIT)
    if clicked.action is not None or own is None or own.action is None:
        return clicked
    return own


def ends_work(state: State, action: GroundAction) -> bool:
    """Whether an action stops something that goes on by itself before it is done."""
    running = [_key(row) for row in work_in_progress(state) if row.running]
    if not running:
        return False
    then, without = _running(state.step(action).state), _running(state.step([]).state)
    return any(not then[key] if key in then else without.get(key, False) for key in running)


def _running(state: State) -> dict[tuple[str, tuple[str, ...]], bool]:
    """What is in progress, and whether it goes on."""
    return {_key(row): row.running for row in work_in_progress(state)}


def _key(row: Progress) -> tuple[str, tuple[str, ...]]:
    return row.action, row.arguments
