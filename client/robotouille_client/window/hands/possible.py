"""What a player can do now, and which of it is the most useful."""

from __future__ import annotations

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.usefulness import useful_actions, work_in_progress
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.controls import Controls, Meaning
from robotouille_client.window.hands.walking import destination, towards

__all__ = ["possible", "use", "walk"]


def possible(state: State, me: str) -> tuple[GroundAction, ...]:
    """What a player can do that changes something: here first, then the walks, the nearest
    first."""
    valid = useful_actions(state, me)
    walks = {action: there for action in valid if (there := destination(action))}
    here = scene(state)[me].at
    floor = state.world.floor

    def steps(action: GroundAction) -> int:
        return floor.distance(here, walks[action]) if here else 0

    others = [action for action in valid if action not in walks]
    return (*others, *sorted(walks, key=steps))


def walk(controls: Controls, state: State, me: str, direction: tuple[int, int]) -> Meaning:
    """What a direction key means."""
    busy = state.busy_steps(me)
    if busy:
        return Meaning(None, f"busy for {busy} more step{'s' * (busy > 1)}")
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
    if clicked.valid and _at_work(state, clicked.action):
        return Meaning(None, "wait until it is done, or click to take it")
    if clicked.valid or own is None or own.action is None:
        return clicked
    return own


def _at_work(state: State, action: GroundAction | None) -> bool:
    """Whether an action is about something in progress that still changes it."""
    subjects = {row.subject for row in work_in_progress(state) if row.running}
    return action is not None and not subjects.isdisjoint(action.arguments)
