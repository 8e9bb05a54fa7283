"""Hints of the window at each station with each object in hand.

`python -m tests.support.golden_hints` writes the files that `test_window_hints` compares with.
Review the changes before you commit them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from robotouille import State
from robotouille.world.scene import scene
from robotouille_client.window.input.controls import Controls, ResolvedInput, use
from tests.support.scripted import after

GOLDEN = Path(__file__).parents[1] / "window" / "hints"
_SOUP = ["move table2", "pick-up-container pot1", "move sink1", "place-container", "fill-pot"]
KITCHENS: dict[str, tuple[str, list[str]]] = {
    "soup": ("asynchronous/06", []),
    "soup_filling": ("asynchronous/06", _SOUP),
    "soup_water": ("asynchronous/06", [*_SOUP, "-", "-", "-"]),
    "fries": ("asynchronous/04", []),
    "workshop": ("workshop/01", []),
}
"""Task of each kitchen, and the player's actions so far."""


def hints(kitchen: str) -> list[str]:
    """Return lines with the held object, the station and its hint, without duplicates."""
    task, lines = KITCHENS[kitchen]
    state = after(task, *lines)
    me, world = state.world.players[0], state.world
    controls = Controls(world)
    found: dict[str, str] = {}
    for held, holding in _held(state, me):
        for station in world.floor.stations:
            there = _walked(holding, me, station)
            if there is None:
                continue
            lying = sorted((each.level, world_kind(there, each.thing.name))
                           for each in scene(there).values() if each.host == station)  # fmt: skip
            at = " with ".join((world_kind(there, station), *(kind for _, kind in lying)))
            used, clicked = use(controls, there, me), controls.click(there, me, station)
            words = _said(used)
            if _said(clicked) != words:
                words = f"{words} | click: {_said(clicked)}"
            found.setdefault(f"{held} at {at}", words)
    return [f"{row}: {words}" for row, words in found.items()]


def world_kind(state: State, name: str) -> str:
    return state.world.thing(name).kind


def _said(meaning: ResolvedInput) -> str:
    """Return the hint, in brackets if the action is impossible."""
    return meaning.hint if meaning.valid else f"[{meaning.hint}]"


def _held(state: State, me: str) -> Iterator[tuple[str, State]]:
    """Yield the state with empty hands, and with each kind of object that can be picked up."""
    yield "nothing", state
    kinds: set[str] = set()
    for name, placed in scene(state).items():
        kind = world_kind(state, name)
        there = _walked(state, me, placed.host or "")
        if there is None or kind in kinds:
            continue
        for action in there.actions(me):
            after_it = there.step({me: action}).state
            if name in action.arguments and scene(after_it)[name].host == me:
                kinds.add(kind)
                yield kind, after_it
                break


def _walked(state: State, me: str, station: str) -> State | None:
    """Return the state after a player has walked to a station, or None if it is unreachable."""
    if scene(state)[me].at == station:
        return state
    for action in state.actions(me):
        if action.destination == station:
            return state.step({me: action}).state
    return None


if __name__ == "__main__":
    GOLDEN.mkdir(exist_ok=True)
    for name in KITCHENS:
        (GOLDEN / f"{name}.txt").write_text("\n".join(hints(name)) + "\n")
