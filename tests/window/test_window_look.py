"""What a kitchen looks like as a server tells it: nothing of it stops a window."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import pygame
import pytest

from robotouille import World
from robotouille.domain.pictures import picture_digest
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures import kept as kept_pictures
from robotouille_client.window.pictures import sprites
from robotouille_client.window.sources.remote_look import fetch_look
from robotouille_client.window.view import SeatView, View

SIZE = (640, 400)
ROLES = ("item", "station", "container")
SVG = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><path d="M1 1 H8 V8 Z"/></svg>'


def shown(rendering: RenderingFile, pictures: Path | None = None, task: str = "workshop/02") -> str:
    """A window of a task with some rendering; its pixels."""
    world = World(task)
    surface = pygame.Surface(SIZE)
    surface.fill("red")
    seats = tuple(SeatView(player, "Ada") for player in world.players)
    view = View(world, world.initial, world.initial, 3, 100, seats=seats, phase=0.5)
    Painter(rendering, pictures).paint(surface, view)
    return pygame.image.tobytes(surface, "RGB").hex()


def content() -> dict[str, Any]:
    """The rendering of the workshop as it is in its file."""
    return rendering_of(World("workshop/02").task).model_dump(by_alias=True, exclude_defaults=True)


@pytest.mark.parametrize("size", [-4, 0, 0.001, 4])
def test_any_size_is_drawn(size: float) -> None:
    rendering = content()
    for role in ROLES:
        constants = {"SCALE": size, "STATION_OFFSET": size, "STACK_OFFSET": size}
        rendering[role]["constants"] = constants
        for entity in rendering[role]["entities"].values():
            entity["constants"] = constants
    for effect in rendering["effects"].values():
        side = max(size, 0.001) / 2
        effect |= {"rise": size, "spread": size, "start": size, "size": (side, side), "count": 8}
    assert shown(RenderingFile.model_validate(rendering))


@pytest.mark.parametrize("value", [5, -5, float("nan"), float("inf"), "large", []])
def test_a_size_beyond_all_measure_is_refused(value: Any) -> None:
    rendering = content()
    rendering["item"]["constants"] = {"SCALE": value}
    with pytest.raises(ValueError, match="SCALE"):
        RenderingFile.model_validate(rendering)


@pytest.mark.parametrize(
    "name", ["../secret.svg", "/etc/passwd", "a/b.svg", "..", ".hidden.svg", "x" * 200, ""]
)
def test_a_picture_is_no_path(name: str) -> None:
    for change in ({"icons": {"app": name}}, {"assets": name}, {"inherited_assets": [name]}):
        with pytest.raises(ValueError, match=next(iter(change))):
            RenderingFile.model_validate(content() | change)


def test_what_is_missing_or_broken_is_seen_as_a_tile_with_its_name(tmp_path: Path) -> None:
    (tmp_path / "gear.svg").write_bytes(SVG[: len(SVG) // 2])
    (tmp_path / "bolt.svg").write_bytes(b"\x89PNG nothing of the kind")
    (tmp_path / "plate.svg").mkdir()
    rendering = content() | {"assets": "nowhere", "inherited_assets": ()}
    broken = shown(RenderingFile.model_validate(rendering), tmp_path)
    assert broken != shown(RenderingFile.model_validate(content()))
    nothing = RenderingFile.model_validate({"version": "2.0", "assets": "nowhere"})
    assert shown(nothing) not in (broken, "")


def test_pictures_take_no_more_memory_than_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_pictures, "MAX_PIXELS", 40_000)
    rendering = rendering_of(World("workshop/02").task)
    kept = sprites.Sprites(rendering.folders(None), Painter().text)
    for size in range(10, 120):
        picture = kept.file("gear.svg", size)
        assert picture is not None and picture.get_size() == (size, size)
        assert kept.shade("gear.svg", size, 99) is not None
        assert sum(each.get_width() ** 2 for each in kept._kept) <= 40_000
    huge = kept.file("gear.svg", 10**9)
    assert huge is not None and huge.get_width() == sprites.MAX_SIDE


class Server:
    """Tells a rendering, and sends what it likes for pictures."""

    def __init__(self, rendering: Any, pictures: dict[str, str], sent: dict[str, str]) -> None:
        self._told = messages.Rendering(rendering=rendering, bindings=None, pictures=pictures)
        self._sent = sent

    async def rendering(self) -> messages.Rendering:
        return self._told

    async def picture(self, digest: str) -> messages.Picture:
        if digest not in self._sent:
            raise RobotouilleError("there is no such picture")
        return messages.Picture(digest=digest, data=self._sent[digest])


def encoded(data: bytes) -> str:
    return base64.b64encode(data).decode()


def png(width: int) -> bytes:
    out = io.BytesIO()
    pygame.image.save(pygame.Surface((width, 1)), out, "x.png")
    return out.getvalue()


async def test_of_what_a_server_sends_only_whole_pictures_are_kept(tmp_path: Path) -> None:
    good, other = (picture_digest(each) for each in (SVG, b"other"))
    wide = picture_digest(png(3000))
    names = {
        "gear.svg": good, "bolt.svg": other, "plate.svg": "unknown", "box.svg": wide,
        "../up.svg": good, "not_named.svg": good,
    }  # fmt: skip
    sent = {good: encoded(SVG), other: encoded(SVG), wide: encoded(png(3000))}
    look = await fetch_look(Server(content(), names, sent), tmp_path)  # type: ignore[arg-type]
    assert look is not None
    assert [path.name for path in tmp_path.iterdir()] == ["gear.svg"]
    assert shown(look.rendering, look.pictures)


@pytest.mark.parametrize(
    "rendering", [{"item": 3}, {"player": {"fitter": []}}, {"effects": {"e": {"asset": "../x"}}}]
)
async def test_a_rendering_that_is_none_is_left_out(rendering: Any, tmp_path: Path) -> None:
    assert await fetch_look(Server(rendering, {}, {}), tmp_path) is None  # type: ignore[arg-type]
