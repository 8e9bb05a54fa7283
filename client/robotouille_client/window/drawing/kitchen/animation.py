"""Movement during a step: work, objects on their way, particles. Pure, without a clock."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import pygame

from robotouille.domain.art import ParticleEffect, Tool
from robotouille.domain.rendering import RenderingFile
from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.spots import Spot
from robotouille_client.window.pictures.appearance import SceneSprites
from robotouille_client.window.pictures.sprites import Sprites


@dataclass(frozen=True, slots=True)
class Moment:
    """State with everything to draw of it."""

    state: State
    stage: SceneSprites


@dataclass(frozen=True, slots=True)
class Emission:
    """Particle effect that comes out of an object."""

    effect: ParticleEffect
    source: str


@dataclass(frozen=True, slots=True)
class ToolInUse:
    """Tool that moves over an object."""

    tool: Tool
    target: str


@dataclass(frozen=True, slots=True)
class StepAnimation:
    """Everything that moves during a step.

    Attributes:
        travels: Objects that a player takes, puts or pours.
        working: Players whose repeated work advanced, or who started something that takes time.
        shaken: Objects with which something goes on by itself, such as cooking.
        emissions: Visible particle effects.
        tools: Tools in use.
    """

    travels: frozenset[str] = frozenset()
    working: frozenset[str] = frozenset()
    shaken: frozenset[str] = frozenset()
    emissions: tuple[Emission, ...] = ()
    tools: tuple[ToolInUse, ...] = ()


def step_animation(
    rendering: RenderingFile,
    now: Moment,
    before: Moment | None,
    *,
    lost: bool = False,
    settled: bool = False,
) -> StepAnimation:
    """Return what moves between two moments, or at the first moment of a game.

    `lost` says that the game ended without its goal, and `settled` that its end was long ago.
    """
    advanced = set(_advanced(now.state, before.state)) if before is not None else set()
    running = {row.subject for row in now.state.progress() if row.timed and row.running}
    began = set() if before is None else running - {r.subject for r in before.state.progress()}
    end = () if settled else _at_the_end(rendering, now, before, lost)
    return StepAnimation(
        frozenset(_travels(now.stage, before.stage)) if before is not None else frozenset(),
        frozenset(_working(now, {subject for _, subject in advanced} | began)),
        frozenset(running),
        (*_emissions(rendering, now, advanced), *end),
        tuple(
            ToolInUse(rendering.tools[action], subject)
            for action, subject in _under_way(now, advanced)
            if action in rendering.tools
        ),
    )


def _advanced(state: State, before: State) -> Iterator[tuple[str, str]]:
    """Yield repeated actions that were done once more, each with its object."""
    then = {(row.action, row.subject): row for row in before.progress() if not row.timed}
    now = {(row.action, row.subject): row for row in state.progress() if not row.timed}
    for key in then.keys() | now.keys():
        # Progress that appears or vanishes was advanced too: the first and the last repetition.
        if key not in now or key not in then or now[key].done > then[key].done:
            yield key


def _travels(stage: SceneSprites, earlier: SceneSprites) -> Iterator[str]:
    """Yield objects that have a new carrier and were visible on the old one."""
    for host, pieces in stage.piles.items():
        there = {piece.name for piece in earlier.piles.get(host, ())}
        for piece in pieces:
            was = earlier.placed.get(piece.name)
            if piece.name not in there and was is not None and was.host is not None:
                yield piece.name


def _working(now: Moment, subjects: set[str]) -> Iterator[str]:
    """Yield players at a station where one of these objects is."""
    stations = {_carrier(now.stage, subject) for subject in subjects}
    for name in now.state.world.players:
        placed = now.stage.placed.get(name)
        if placed is not None and placed.at is not None and placed.at in stations:
            yield name


def _under_way(now: Moment, advanced: set[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """Yield actions that go on, each with its object: timed ones, and repeated ones done now."""
    yield from ((r.action, r.subject) for r in now.state.progress() if r.timed and r.running)
    yield from sorted(advanced)


def _emissions(
    rendering: RenderingFile, now: Moment, advanced: set[tuple[str, str]]
) -> Iterator[Emission]:
    for action, subject in _under_way(now, advanced):
        name = rendering.during.get(action)
        if name is not None:
            yield Emission(rendering.effects[name], subject)
    for source, effects in _lasting(now.stage):
        for name in effects:
            yield Emission(rendering.effects[name], source)


def _at_the_end(
    rendering: RenderingFile, now: Moment, before: Moment | None, lost: bool
) -> Iterator[Emission]:
    """Yield the effects of a won or lost game, at its players."""
    won = before is not None and _reached(now.state, before.state)
    effect = rendering.moments.get("lost" if lost else "goal")
    if effect is not None and (won or lost):
        for player in now.state.world.players:
            yield Emission(rendering.effects[effect], player)


def _reached(state: State, before: State) -> bool:
    return state.goal_reached and not before.goal_reached


def _lasting(stage: SceneSprites) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the effects of pictures, such as steam over hot food."""
    for name, appearance in stage.stations.items():
        yield name, appearance.effects
    for pieces in stage.piles.values():
        for piece in pieces:
            yield piece.name, piece.appearance.effects


def _carrier(stage: SceneSprites, name: str) -> str | None:
    """Return the station an object is on, however deeply it is nested."""
    placed = stage.placed.get(name)
    for _ in range(len(stage.placed)):
        if placed is None or placed.host is None:
            return None
        if placed.host in stage.stations:
            return placed.host
        placed = stage.placed.get(placed.host)
    return None


BEATS = 2
"""Strokes of a tool in a step, and of the arms that hold it."""
# Number of sizes and shades of a particle, each drawn once.
_FRAMES = 12

_GOLDEN = 0.618


def draw_particles(
    target: pygame.Surface, sprites: Sprites, emission: Emission, spot: Spot, time: float
) -> None:
    """Draw the particles of an effect at a time in steps."""
    effect = emission.effect
    for number in range(effect.count):
        age = (time / effect.steps + number / effect.count) % 1.0
        size, opacity = _look(effect, round(age * _FRAMES), spot.tile)
        picture = sprites.shade(effect.asset, size, opacity)
        if picture is None:
            continue
        # The golden ratio spreads the particles evenly, without a random generator: pictures can
        # be repeated.
        lean = math.sin(math.tau * _GOLDEN * (number + 1 + len(emission.source)))
        x = spot.x + lean * effect.spread * spot.tile * (0.4 + 0.6 * age)
        y = spot.y - (effect.start + effect.rise * age) * spot.tile
        target.blit(picture, (round(x - size / 2), round(y - size / 2)))


def particle_looks(effect: ParticleEffect, tile: float) -> Iterator[tuple[int, int]]:
    """Return each size and opacity of an effect's particles, for a tile size."""
    return (_look(effect, frame, tile) for frame in range(_FRAMES + 1))


def _look(effect: ParticleEffect, frame: int, tile: float) -> tuple[int, int]:
    """Return the size and opacity of a particle in one of its `_FRAMES`."""
    look = frame / _FRAMES
    first, last = effect.size
    return max(2, round((first + (last - first) * look) * tile)), round(255 * (1 - look**2))
