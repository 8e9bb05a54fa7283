"""Draw every object of a domain in every state on one picture.

python tools/contact_sheet.py [--task asynchronous/10] [--rendering chalk] [--out out/contact_sheet]

Writes the sheet in its normal size, in double size, and as seen with deuteranopia and protanopia.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import numpy as np
import pygame

from robotouille import Task, load_task
from robotouille.domain.art import SIDES
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille_client.window.pictures.appearance import Appearance, AppearanceResolver
from robotouille_client.window.pictures.shapes import RING_STEPS, SHAPES, badge, ring, tick
from robotouille_client.window.pictures.sprites import Sprites, generate
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, DICHROMACIES, DONE, INK

COLUMNS, SIDE, LETTERS = 12, 84, 9
GROUND = (232, 220, 196)


def cells(task: Task, side: int, look: str = "") -> Iterator[tuple[str, pygame.Surface]]:
    """Yield a label and a picture for everything that the rendering `look` draws."""
    rendering, text = rendering_of(task, look), Typesetter()
    sprites = Sprites(rendering.folders(task.folder), text)
    yield from _things(rendering, sprites, side)
    yield from _players(task, rendering, sprites, side)
    small = side // 2
    for name, file in (*rendering.progress.items(), *rendering.icons.items()):
        yield name, _on(side, sprites.file(file, small))
        if name in rendering.progress:
            disc = ring(small, RING_STEPS * 2 // 3, ACCENT).copy()
            icon = sprites.file(file, round(small * 0.66))
            if icon is not None:
                disc.blit(icon, icon.get_rect(center=(small // 2, small // 2)))
            yield f"{name}, two thirds", _on(side, disc)
    for name, effect in rendering.effects.items():
        picture = sprites.file(effect.asset, max(2, round(side * max(effect.size))))
        yield f"effect {name}", _on(side, picture)
    for seat, shape in enumerate(SHAPES):
        yield f"seat {seat + 1}, {shape}", _on(side, badge(seat, small))
    yield "reached", _on(side, tick(small, DONE))
    for role in ("station", "item", "container"):
        made = generate(Appearance("gizmo", role, None, "shiny"), side, text)
        yield f"{role} without a picture", made


def _things(
    rendering: RenderingFile, sprites: Sprites, side: int
) -> Iterator[tuple[str, pygame.Surface]]:
    for kind, place, art in rendering.arts():
        if art.asset is not None:
            state = place.partition(".assets")[2].lstrip(".").replace(".", " ")
            yield f"{kind} {state}".strip(), _on(side, sprites.file(art.asset, side))
            for i, stage in enumerate(art.stages):
                yield f"{kind} {state} {i + 1}", _on(side, sprites.file(stage, side))


def _players(
    task: Task, rendering: RenderingFile, sprites: Sprites, side: int
) -> Iterator[tuple[str, pygame.Surface]]:
    resolver = AppearanceResolver(task.domain, rendering)
    for kind, looks in rendering.player.items():
        for seat in range(len(looks)):
            for facing in SIDES:
                feet = resolver.feet(kind, seat, facing) or ("",)
                for frame, carrying in ((0, False), (1, False), (0, True)):
                    look = resolver.player(kind, seat, facing, carrying=carrying)
                    below = sprites.file(feet[frame % len(feet)], side)
                    doing = "carries" if carrying else "walks" if frame else "stands"
                    body = sprites.of(look, side)
                    yield f"{seat + 1} {facing}, {doing}", _on(side, below, body)


def _on(side: int, *pictures: pygame.Surface | None) -> pygame.Surface:
    """Return pictures stacked in the centre of a square."""
    cell = pygame.Surface((side, side), pygame.SRCALPHA)
    for picture in pictures:
        if picture is not None:
            cell.blit(picture, picture.get_rect(center=(side // 2, side // 2)))
    return cell


def sheet(task: Task, side: int = SIDE, letters: int = LETTERS, look: str = "") -> pygame.Surface:
    """Return all cells in rows; labels are omitted if `letters` is 0."""
    shown, text = list(cells(task, side, look)), Typesetter()
    gap = side // 10
    high = side + gap + (text.height(letters) if letters else 0)
    rows = -(-len(shown) // COLUMNS)
    surface = pygame.Surface((COLUMNS * (side + gap) + gap, rows * high + gap))
    surface.fill(GROUND)
    for number, (words, picture) in enumerate(shown):
        x, y = gap + number % COLUMNS * (side + gap), gap + number // COLUMNS * high
        surface.blit(picture, (x, y))
        if letters:
            line = text.line(text.fit(words, letters, side + gap), letters, INK)
            surface.blit(line, line.get_rect(midtop=(x + side // 2, y + side)))
    return surface


def seen_by(surface: pygame.Surface, kind: str) -> pygame.Surface:
    """Simulate how a picture looks with a kind of colour blindness in DICHROMACIES."""
    share = pygame.surfarray.array3d(surface).astype(np.float64) / 255
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    light = np.clip(light @ np.array(DICHROMACIES[kind]).T, 0, 1)
    share = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    return pygame.surfarray.make_surface(np.rint(share * 255).astype(np.uint8))


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the sheets."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--task", default="asynchronous/10", help="task whose domain is drawn")
    parser.add_argument("--rendering", default="", help="rendering instead of the domain's own")
    parser.add_argument("--out", type=Path, default=Path("out/contact_sheet"))
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    task = load_task(options.task)
    look = options.rendering
    plain = sheet(task, look=look)
    pictures = {"sheet": plain, "sheet@2x": sheet(task, 2 * SIDE, 2 * LETTERS, look)}
    pictures |= {f"sheet-{kind}": seen_by(plain, kind) for kind in DICHROMACIES}
    for name, picture in pictures.items():
        path = options.out / f"{name}.png"
        pygame.image.save(picture, path)
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
