"""What goes on in a step: who works, what is on its way, what steams. Pure, and without a clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from robotouille.domain.rendering import RenderingFile
from robotouille.domain.rendering.art import Effect
from robotouille.world.world import State
from robotouille_client.window.pictures.appearance import Stage

__all__ = ["Emission", "Life", "Moment", "life"]


@dataclass(frozen=True, slots=True)
class Moment:
    """A state, and what there is to draw of it."""

    state: State
    stage: Stage


@dataclass(frozen=True, slots=True)
class Emission:
    """An effect that comes out of a thing."""

    effect: Effect
    source: str


@dataclass(frozen=True, slots=True)
class Life:
    """What moves during a step.

    `travels` are the things that somebody takes, puts or pours, `working` the players who do
    something again and again, `emissions` the effects that are seen.
    """

    travels: frozenset[str] = frozenset()
    working: frozenset[str] = frozenset()
    emissions: tuple[Emission, ...] = ()


def life(
    rendering: RenderingFile, now: Moment, before: Moment | None, *, lost: bool = False
) -> Life:
    """What goes on between two moments; at the first of a game, what goes on at it. `lost`: the
    game is over, and its goal was not reached."""
    advanced = set(_advanced(now.state, before.state)) if before is not None else set()
    return Life(
        frozenset(_travels(now.stage, before.stage)) if before is not None else frozenset(),
        frozenset(_working(now, advanced)),
        (*_emissions(rendering, now, before, advanced), *_at_the_end(rendering, now, before, lost)),
    )


def _advanced(state: State, before: State) -> Iterator[tuple[str, str]]:
    """Actions that were done once more, each with what it was done to."""
    then = {(row.action, row.subject): row for row in before.progress() if not row.timed}
    now = {(row.action, row.subject): row for row in state.progress() if not row.timed}
    for key in then.keys() | now.keys():
        if key not in now or key not in then or now[key].done > then[key].done:
            yield key


def _travels(stage: Stage, earlier: Stage) -> Iterator[str]:
    """Things whose carrier is another than before, and that were to be seen there."""
    for host, pieces in stage.piles.items():
        there = {piece.name for piece in earlier.piles.get(host, ())}
        for piece in pieces:
            was = earlier.placed.get(piece.name)
            if piece.name not in there and was is not None and was.host is not None:
                yield piece.name


def _working(now: Moment, advanced: set[tuple[str, str]]) -> Iterator[str]:
    """Players at a station where something was done once more."""
    stations = {_carrier(now.stage, subject) for _, subject in advanced}
    for name in now.state.world.players:
        placed = now.stage.placed.get(name)
        if placed is not None and placed.at is not None and placed.at in stations:
            yield name


def _emissions(
    rendering: RenderingFile, now: Moment, before: Moment | None, advanced: set[tuple[str, str]]
) -> Iterator[Emission]:
    timed = ((r.action, r.subject) for r in now.state.progress() if r.timed and r.running)
    for action, subject in (*timed, *sorted(advanced)):
        name = rendering.during.get(action)
        if name is not None:
            yield Emission(rendering.effects[name], subject)
    for source, effects in _lasting(now.stage):
        for name in effects:
            yield Emission(rendering.effects[name], source)


def _at_the_end(
    rendering: RenderingFile, now: Moment, before: Moment | None, lost: bool
) -> Iterator[Emission]:
    """The effects of a game that was won or lost, which its players have."""
    won = before is not None and _reached(now.state, before.state)
    effect = rendering.moments.get("lost" if lost else "goal")
    if effect is not None and (won or lost):
        for player in now.state.world.players:
            yield Emission(rendering.effects[effect], player)


def _reached(state: State, before: State) -> bool:
    return state.goal_reached and not before.goal_reached


def _lasting(stage: Stage) -> Iterator[tuple[str, tuple[str, ...]]]:
    """The effects of pictures, such as steam over what is hot."""
    for name, appearance in stage.stations.items():
        yield name, appearance.effects
    for pieces in stage.piles.values():
        for piece in pieces:
            yield piece.name, piece.appearance.effects


def _carrier(stage: Stage, name: str) -> str | None:
    """The station that a thing is on, however deep in other things it is."""
    placed = stage.placed.get(name)
    for _ in range(len(stage.placed)):
        if placed is None or placed.host is None:
            return None
        if placed.host in stage.stations:
            return placed.host
        placed = stage.placed.get(placed.host)
    return None
