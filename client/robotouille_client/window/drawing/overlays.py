"""What floats over the kitchen: progress, names, speech, and what the mouse points at."""

from __future__ import annotations

from collections import defaultdict

import pygame

from robotouille.domain.rendering import RenderingFile
from robotouille.world.people.usefulness import work_in_progress
from robotouille.world.scene import Placed
from robotouille.world.world import Progress, State
from robotouille_client.window.drawing.kitchen_layer import RAISED
from robotouille_client.window.drawing.motion import Pose
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import Stage
from robotouille_client.window.pictures.shapes import RING_STEPS, box, pill, ring, speech
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    FAINT,
    GOOD,
    INK,
    PAPER,
    SEATS,
    TEXT,
    mixed,
)
from robotouille_client.window.view import Bubble, View

__all__ = ["Overlays"]

_BADGE = 0.46
_ICON = 0.3


class Overlays:
    """Draws over the kitchen; everything here is about one view."""

    def __init__(self, rendering: RenderingFile, sprites: Sprites, text: Typesetter) -> None:
        self._rendering = rendering
        self._sprites = sprites
        self._text = text

    def draw(
        self,
        target: pygame.Surface,
        layout: Layout,
        view: View,
        stage: Stage,
        poses: dict[str, Pose],
        *,
        ui_overlay: UiOverlay,
    ) -> None:
        """All of it, the more urgent over the less."""
        self._highlight(target, layout, stage, view.hover)
        self._progress(target, layout, view, stage, poses)
        self._names(target, layout, view, poses)
        self._states_of_players(target, layout, view, poses)
        lift: dict[str, int] = defaultdict(int)
        for bubble in view.bubbles:
            if bubble.player in poses:
                pose, above = poses[bubble.player], lift[bubble.player]
                lift[bubble.player] += self._bubble(target, layout, bubble, pose, above)
        if ui_overlay.tips and ui_overlay.pointer is not None:
            self._tips(target, layout, ui_overlay.pointer, ui_overlay.tips)

    # The station under the mouse

    def _highlight(
        self, target: pygame.Surface, layout: Layout, stage: Stage, hover: str | None
    ) -> None:
        placed = stage.placed.get(hover or "")
        if placed is None or placed.tile is None:
            return
        cell = layout.cell(placed.tile)
        target.blit(box(cell.size, (255, 255, 255, 60), layout.tile // 10), cell)
        width = max(2, layout.tile // 24)
        pygame.draw.rect(target, ACCENT, cell, width=width, border_radius=layout.tile // 10)

    def _tips(
        self,
        target: pygame.Surface,
        layout: Layout,
        pointer: tuple[int, int],
        tips: tuple[str, ...],
    ) -> None:
        size, pad = layout.text, 7
        most = max(120, layout.size[0] // 3)
        lines = [line for tip in tips for line in self._text.wrap(tip, size, most)]
        step = self._text.height(size)
        width = max(self._text.width(line, size) for line in lines) + 2 * pad
        area = pygame.Rect(pointer[0] + 14, pointer[1] + 16, width, step * len(lines) + pad)
        if area.bottom > layout.size[1]:
            area.bottom = pointer[1] - 6
        area.clamp_ip(target.get_rect())
        target.blit(box(area.size, (*INK, 235), 6), area)
        for i, line in enumerate(lines):
            words = self._text.line(line, size, TEXT)
            target.blit(words, (area.x + pad, area.y + pad // 2 + 1 + i * step))

    # Progress

    def _progress(
        self,
        target: pygame.Surface,
        layout: Layout,
        view: View,
        stage: Stage,
        poses: dict[str, Pose],
    ) -> None:
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
            x = spot[0] - taken[spot] * side * 0.95
            taken[spot] += 1
            self._badge(target, row, share, (round(x), round(spot[1])), side)

    def _spot(
        self, layout: Layout, row: Progress, stage: Stage, poses: dict[str, Pose]
    ) -> tuple[float, float] | None:
        """Where a badge is centred: at the station, or beside whoever holds the thing."""
        placed = stage.placed.get(row.subject)
        holder = _holder(placed, stage, poses)
        if holder is not None:
            x, y = layout.corner(poses[holder].at)
            return x + 0.12 * layout.tile, y + 0.1 * layout.tile
        if placed is None or placed.tile is None:
            return None
        x, y = layout.corner(placed.tile)
        return x + 0.8 * layout.tile, y + 0.12 * layout.tile

    def _badge(
        self,
        target: pygame.Surface,
        row: Progress,
        share: float,
        middle: tuple[int, int],
        side: int,
    ) -> None:
        colour = mixed(ACCENT, GOOD, share) if row.running else FAINT
        disc = ring(side, round(share * RING_STEPS), colour, 255 if row.running else 170)
        target.blit(disc, disc.get_rect(center=middle))
        icon = self._rendering.progress.get(row.action)
        size = round(side * 0.66)
        picture = (self._sprites.file if row.running else self._sprites.faded)(icon, size)
        if picture is None:
            letter = row.action[:1].upper()
            picture = self._text.line(letter, max(8, side // 2), INK if row.running else FAINT)
        target.blit(picture, picture.get_rect(center=middle))

    # Players

    def _names(
        self, target: pygame.Surface, layout: Layout, view: View, poses: dict[str, Pose]
    ) -> None:
        size = max(9, min(16, layout.tile // 6))
        seats = {seat.player: seat for seat in view.seats}
        for index, player in enumerate(view.world.players):
            if player not in poses:
                continue
            seat = seats.get(player)
            name = player if seat is None else seat.plate
            here = seat is None or seat.connected or bool(seat.stand_in)
            name = self._text.fit(name, size, round(layout.tile * 1.5))
            colour = SEATS[index % len(SEATS)]
            fill = mixed(colour, INK, 0.3) if here else (96, 90, 100)
            plate = pill(self._text.line(name, size, PAPER if here else FAINT), fill)
            x, y = layout.corner(poses[player].at)
            place = plate.get_rect(
                midtop=(round(x + layout.tile / 2), round(y + (0.98 - RAISED) * layout.tile))
            )
            target.blit(plate, place.clamp(layout.kitchen))

    def _states_of_players(
        self, target: pygame.Surface, layout: Layout, view: View, poses: dict[str, Pose]
    ) -> None:
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
                target.blit(picture, picture.get_rect(center=middle))

    def _mark(self, target: pygame.Surface, layout: Layout, pose: Pose) -> None:
        """A ring round a player who waits for a place, or stands where another wants to be."""
        x, y = layout.corner(pose.at)
        area = pygame.Rect(round(x), round(y), layout.tile, layout.tile)
        width = max(2, layout.tile // 20)
        pygame.draw.rect(target, BAD, area, width=width, border_radius=layout.tile // 2)

    def _bubble(
        self, target: pygame.Surface, layout: Layout, bubble: Bubble, pose: Pose, above: int
    ) -> int:
        """A speech bubble, `above` pixels higher than where it would be; its height."""
        size, pad = max(11, layout.text - 2), 8
        most = max(110, min(round(layout.tile * 2.6), layout.kitchen.width * 2 // 3))
        lines = self._text.wrap(bubble.text, size, most, 5)
        if not lines:
            return 0
        step = self._text.height(size)
        width = max(24, max(self._text.width(line, size) for line in lines) + 2 * pad)
        height = step * len(lines) + pad
        x, y = layout.corner(pose.at)
        x, y = x + layout.tile / 2, y - 0.1 * layout.tile - above
        area = pygame.Rect(round(x - width / 2), round(y - height - 8), width, height + 8)
        area.clamp_ip(pygame.Rect(0, 0, max(area.width, layout.panel.left), layout.size[1]))
        tail = min(width - 14, max(14, round(x) - area.x))
        edge, ink = (BAD, mixed(BAD, INK, 0.45)) if bubble.kind == "rejected" else (INK, INK)
        target.blit(speech((width, height), PAPER, edge, tail), area)
        for i, line in enumerate(lines):
            words = self._text.line(line, size, ink)
            target.blit(words, (area.x + pad, area.y + pad // 2 + 1 + i * step))
        return area.height


def _rows(state: State | None) -> tuple[Progress, ...]:
    return work_in_progress(state) if state is not None else ()


def _holder(placed: Placed | None, stage: Stage, poses: dict[str, Pose]) -> str | None:
    """The player that holds a thing or what it is in."""
    while placed is not None and placed.host is not None:
        if placed.host in poses:
            return placed.host
        placed = stage.placed.get(placed.host)
    return None
