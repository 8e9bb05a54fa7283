"""Signs over the kitchen: progress, busy and rejected players, the station under the mouse."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import pygame

from robotouille.domain.rendering import RenderingFile
from robotouille.world.presentation.work import work_in_progress
from robotouille.world.scene import Placed
from robotouille.world.timers import Progress
from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.spots import Pose
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import SceneSprites
from robotouille_client.window.pictures.shapes import RING_STEPS, frame, ring, seat_fill
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BAD, FAINT, GOOD, INK, PAPER, mixed
from robotouille_client.window.view import View

_BADGE = 0.46
_ICON = 0.3
# Opacity of the wash over the marked station. Its edge marks it on light wood.
_WASH = 44


class Overlays:
    """Draws the signs of one view."""

    def __init__(self, rendering: RenderingFile, sprites: Sprites, text: Typesetter) -> None:
        self._rendering = rendering
        self._sprites = sprites
        self._text = text

    def draw(
        self,
        target: pygame.Surface,
        layout: Layout,
        view: View,
        stage: SceneSprites,
        poses: dict[str, Pose],
    ) -> list[pygame.Rect]:
        """Draw all signs, the most urgent on top. Return the covered areas."""
        self._pointed_at(target, layout, view, stage, poses)
        return [
            *self._progress(target, layout, view, stage, poses),
            *self._states_of_players(target, layout, view, poses),
        ]

    # The station under the mouse

    def highlight(
        self, target: pygame.Surface, layout: Layout, stage: SceneSprites, hover: str | None
    ) -> None:
        """Mark the station under the mouse, below the objects and players there."""
        placed = stage.placed.get(hover or "")
        if placed is None or placed.tile is None:
            return
        cell, width = layout.cell(placed.tile), max(2, layout.tile // 28)
        marked = frame(cell.size, width, layout.tile // 10, PAPER, _WASH)
        target.blit(marked, marked.get_rect(center=cell.center))

    # Signals

    def _pointed_at(
        self,
        target: pygame.Surface,
        layout: Layout,
        view: View,
        stage: SceneSprites,
        poses: dict[str, Pose],
    ) -> None:
        """Mark what signals point at, in the colour of the player who points."""
        for bubble in view.bubbles:
            if not bubble.target or bubble.player not in poses:
                continue
            holder = _holder(stage.placed.get(bubble.target), stage, poses)
            player = bubble.target if bubble.target in poses else holder
            placed = stage.placed.get(bubble.target)
            if player is not None:
                area = pygame.Rect(layout.corner(poses[player].at), (layout.tile, layout.tile))
            elif placed is not None and placed.tile is not None:
                area = layout.cell(placed.tile)
            else:
                continue
            colour = seat_fill(view.world.players.index(bubble.player))
            width, inner = max(3, layout.tile // 14), -layout.tile // 5
            corner = layout.tile // 5
            outside, inside = area.inflate(4, 4), area.inflate(inner, inner)
            pygame.draw.rect(target, colour, outside, width, border_radius=corner)
            pygame.draw.rect(target, colour, inside, width // 2, border_radius=corner)

    # Progress

    def _progress(
        self,
        target: pygame.Surface,
        layout: Layout,
        view: View,
        stage: SceneSprites,
        poses: dict[str, Pose],
    ) -> Iterator[pygame.Rect]:
        before = {(p.action, p.arguments): p.done for p in _rows(view.previous)}
        taken: dict[tuple[float, float], int] = defaultdict(int)
        side = max(12, round(_BADGE * layout.tile))
        for row in _rows(view.state):
            spot = self._spot(layout, row, stage, poses)
            if spot is None:
                continue
            start = before.get((row.action, row.arguments), 0)
            done = start + (row.done - start) * view.phase if row.done >= start else row.done
            share = round(min(1.0, done / max(1, row.total)) * RING_STEPS) / RING_STEPS
            # Badges at one place stand side by side.
            x = spot[0] - taken[spot] * side * 0.95
            taken[spot] += 1
            yield self._progress_ring(target, row, share, (round(x), round(spot[1])), side)

    def _spot(
        self, layout: Layout, row: Progress, stage: SceneSprites, poses: dict[str, Pose]
    ) -> tuple[float, float] | None:
        """Return the centre of a badge: at the station, or next to the player with the object."""
        placed = stage.placed.get(row.subject)
        holder = _holder(placed, stage, poses)
        if holder is not None:
            x, y = layout.corner(poses[holder].at)
            return x + 0.12 * layout.tile, y + 0.1 * layout.tile
        if placed is None or placed.tile is None:
            return None
        x, y = layout.corner(placed.tile)
        return x + 0.8 * layout.tile, y + 0.12 * layout.tile

    def _progress_ring(
        self,
        target: pygame.Surface,
        row: Progress,
        share: float,
        middle: tuple[int, int],
        side: int,
    ) -> pygame.Rect:
        colour = mixed(ACCENT, GOOD, share) if row.running else FAINT
        disc = ring(side, round(share * RING_STEPS), colour, 255 if row.running else 170)
        covered = target.blit(disc, disc.get_rect(center=middle))
        icon = self._rendering.progress.get(row.action)
        size = round(side * 0.66)
        picture = (self._sprites.file if row.running else self._sprites.faded)(icon, size)
        if picture is None:
            # A rendering need not have a picture for every action.
            letter = row.action[:1].upper()
            picture = self._text.line(letter, max(8, side // 2), INK if row.running else FAINT)
        target.blit(picture, picture.get_rect(center=middle))
        return covered

    # Players

    def _states_of_players(
        self, target: pygame.Surface, layout: Layout, view: View, poses: dict[str, Pose]
    ) -> Iterator[pygame.Rect]:
        rejected = {bubble.player for bubble in view.bubbles if bubble.kind == "rejected"}
        for player in {each for waiting, _, by in view.blocked for each in (waiting, by)}:
            if player in poses:
                self._mark(target, layout, poses[player])
        for player, pose in poses.items():
            icon = None
            if player in rejected:
                icon = self._rendering.icons.get("rejected")
            elif view.state.busy_steps(player) and not pose.walking:
                icon = self._rendering.icons.get("busy")
            picture = self._sprites.file(icon, round(_ICON * layout.tile))
            if picture is not None:
                x, y = layout.corner(pose.at)
                middle = (round(x + 0.85 * layout.tile), round(y))
                yield target.blit(picture, picture.get_rect(center=middle))

    def _mark(self, target: pygame.Surface, layout: Layout, pose: Pose) -> None:
        """Draw a ring around a player that waits for a place or blocks one."""
        x, y = layout.corner(pose.at)
        area = pygame.Rect(round(x), round(y), layout.tile, layout.tile)
        width = max(2, layout.tile // 20)
        pygame.draw.rect(target, BAD, area, width=width, border_radius=layout.tile // 2)


def _rows(state: State | None) -> tuple[Progress, ...]:
    return work_in_progress(state) if state is not None else ()


def _holder(placed: Placed | None, stage: SceneSprites, poses: dict[str, Pose]) -> str | None:
    """Return the player that holds an object, or holds its container."""
    while placed is not None and placed.host is not None:
        if placed.host in poses:
            return placed.host
        placed = stage.placed.get(placed.host)
    return None
