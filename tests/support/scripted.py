"""States that a player comes to by some actions."""

from __future__ import annotations

from robotouille import State, World

POT_AT_SINK = [
    "move table2", "pick-up-container pot1", "move sink1", "place-container", "fill-pot",
]  # fmt: skip
BOILING = [
    *POT_AT_SINK, "-", "-", "-", "pick-up-container pot1", "move stove1", "place-container",
    "boil-water",
]  # fmt: skip
"""In `asynchronous/09`."""


def after(name: str, *lines: str) -> State:
    """The state of a task after the first player has done `ACTION ARGUMENT…`, or waited (`-`)."""
    state = World(name).initial
    player = state.world.players[0]
    for line in lines:
        word, *arguments = line.split()
        actions = [a for a in state.actions(player) if a.name == word]
        chosen = [a for a in actions if set(arguments) <= set(a.arguments)][:1]
        assert chosen or line == "-"
        state = state.step(chosen).state
    return state
