"""Renderings and pictures from servers: none of them stops a window."""

from __future__ import annotations

import base64
import io
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pygame
import pytest
from tests.support.window_play import headless_window

from robotouille import World
from robotouille.domain.pictures import MAX_DRAWN, picture_digest, sharp_side
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille.domain.schema import InputFile
from robotouille.errors import RobotouilleError
from robotouille.installation import data_folder
from robotouille.protocol import messages
from robotouille_client.window.app.remote_game import fetch_look
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.pictures.shapes import MAX_PICTURES, MAX_PIXELS, PictureCache
from robotouille_client.window.pictures.sprites import Sprites, drawing_thread, with_percentages
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.view import SeatView, View

SIZE = (640, 400)
ROLES = ("item", "station", "container")
SVG = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><path d="M1 1 H8 V8 Z"/></svg>'


def shown(rendering: RenderingFile, pictures: Path | None = None, task: str = "workshop/02") -> str:
    """Paint a task with a rendering and return the pixels."""
    world = World(task)
    surface = pygame.Surface(SIZE)
    surface.fill("red")
    seats = tuple(SeatView(player, "Ada") for player in world.players)
    view = View(world, world.initial, world.initial, 3, 100, seats=seats, phase=0.5)
    Painter(rendering, pictures).paint(surface, view)
    return pygame.image.tobytes(surface, "RGB").hex()


def content() -> dict[str, Any]:
    """Return the rendering of the workshop as in its file."""
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


def test_missing_or_broken_pictures_become_tiles(tmp_path: Path) -> None:
    (tmp_path / "gear.svg").write_bytes(SVG[: len(SVG) // 2])
    (tmp_path / "bolt.svg").write_bytes(b"\x89PNG nothing of the kind")
    (tmp_path / "plate.svg").mkdir()
    rendering = content() | {"assets": "nowhere", "inherited_assets": ()}
    broken = shown(RenderingFile.model_validate(rendering), tmp_path)
    assert broken != shown(RenderingFile.model_validate(content()))
    nothing = RenderingFile.model_validate({"version": "2.0", "assets": "nowhere"})
    assert shown(nothing) not in (broken, "")


class Server:
    """Server that sends a rendering, and any bytes as pictures."""

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


async def test_only_complete_pictures_are_kept(tmp_path: Path) -> None:
    good, other = (picture_digest(each) for each in (SVG, b"other"))
    wide = picture_digest(png(3000))
    names = {
        "gear.svg": good, "bolt.svg": other, "plate.svg": "unknown", "box.svg": wide,
        "../up.svg": good, "not_named.svg": good,
    }  # fmt: skip
    sent = {good: encoded(SVG), other: encoded(SVG), wide: encoded(png(3000))}
    look = await fetch_look(Server(content(), names, sent), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["gear.svg"]
    assert shown(look.rendering, look.pictures)


@pytest.mark.parametrize(
    "rendering", [{"item": 3}, {"player": {"fitter": []}}, {"effects": {"e": {"asset": "../x"}}}]
)
async def test_an_invalid_rendering_is_ignored(rendering: Any, tmp_path: Path) -> None:
    assert await fetch_look(Server(rendering, {}, {}), tmp_path) is None


def test_large_pictures_are_evicted_by_total_size() -> None:
    pictures, side = PictureCache(), 1000
    fitting = MAX_PIXELS // side**2
    for number in range(fitting):
        pictures.keep(number, pygame.Surface((side, side), depth=8))
    assert all(pictures.get(number) for number in range(fitting))
    newest = pictures.keep("one more", pygame.Surface((side, side), depth=8))
    assert pictures.get("one more") is newest
    assert not any(pictures.get(number) for number in range(fitting))


def test_small_pictures_are_evicted_by_number() -> None:
    pictures = PictureCache()
    for number in range(10 * MAX_PICTURES):
        pictures.keep(number, pygame.Surface((1, 1)))
    assert 0 < sum(pictures.get(n) is not None for n in range(10 * MAX_PICTURES)) <= MAX_PICTURES


ELABORATE = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">{
    '<rect x="4" width="1" height="9" fill="#010203"></rect>' * 1990
}</svg>""".encode()


@pytest.fixture
def drawn_sides(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sides in pixels at which SVG pictures are drawn."""
    sides: list[int] = []
    draw = pygame.image.load_sized_svg

    def recorded(file: Any, size: tuple[int, int]) -> pygame.Surface:
        sides.append(size[0])
        return draw(file, size)

    monkeypatch.setattr(pygame.image, "load_sized_svg", recorded)
    return sides


def test_elaborate_pictures_are_drawn_small_and_scaled(
    tmp_path: Path, drawn_sides: list[int]
) -> None:
    """Full circles in place of the lines would take a minute at this size."""
    (tmp_path / "a.svg").write_bytes(ELABORATE)
    picture = Sprites((tmp_path,), Typesetter()).file("a.svg", 2048)
    assert picture.get_size() == (2048, 2048)
    assert tuple(picture.get_at((1024, 1024))) == (1, 2, 3, 255)
    (side,) = drawn_sides
    assert 1990 * side**2 <= MAX_DRAWN


def test_dashes_of_local_pictures_are_not_drawn(tmp_path: Path) -> None:
    """A kilobyte of tiny dashes on a long line used up the memory."""
    (tmp_path / "a.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32">'
        '<path stroke="#010203" stroke-width="32" stroke-dasharray="8" d="M0 16 H32"/></svg>'
    )
    picture = Sprites((tmp_path,), Typesetter()).file("a.svg", SIDE)
    assert {tuple(picture.get_at((x, 16))) for x in range(SIDE)} == {(1, 2, 3, 255)}


def test_shipped_pictures_are_sharp() -> None:
    # The title in the folder above is drawn in one size only.
    pictures = data_folder("assets").glob("*/*.svg")
    assert min(sharp_side(path.read_bytes()) for path in pictures) > 999


def test_elaborate_pictures_from_a_server_never_delay_a_frame(tmp_path: Path) -> None:
    (tmp_path / "table.svg").write_bytes(ELABORATE)
    names = content() | {"floor": {"wall": "table.svg", "default": "table.svg"}}
    look = KitchenLook(RenderingFile.model_validate(names), InputFile(), tmp_path)
    world, begin = World("workshop/02"), threading.Event()
    source = SimpleNamespace(view=lambda: View(world, world.initial), finished=False)
    window = headless_window((1280, 720), look=look)
    # The thread that draws is busy, so that a frame that waited for it would never end.
    busy = drawing_thread.submit(begin.wait)
    for _ in range(3):
        window.frame(source)
    pygame.event.clear()
    plain = window.drawn
    begin.set()
    busy.result()
    drawing_thread.submit(int).result()
    window.frame(source)
    assert window.drawn == plain + 1
    assert (1, 2, 3) in {
        tuple(pygame.display.get_surface().get_at((x, 500)))[:3] for x in range(900)
    }
    window.close()


SIDE = 32
PICTURE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 128 128"><defs>{}
<stop offset="0" stop-color="#ff0000"/><stop offset="1" stop-color="#0000ff"/></{}Gradient></defs>
<rect width="128" height="128" fill="url(#g)"/></svg>"""


@pytest.mark.parametrize(
    ("plain", "percent"),
    [
        ('<linearGradient id="g" x2="0" y2="1">', '<linearGradient id="g" x2="0%" y2="100%">'),
        (
            "<linearGradient id='g' x1='.25' y1='0' x2='1.0' y2='1e-1'>",
            "<linearGradient id='g' x1='25%' y1='0%' x2='100%' y2='10%'>",
        ),
        (
            '<radialGradient id="g" cx="0.5" cy="0.4" r="0.75">',
            '<radialGradient id="g" cx="50%" cy="40%" r="75%">',
        ),
    ],
)
def test_numbers_are_drawn_like_percentages(tmp_path: Path, plain: str, percent: str) -> None:
    kind = "linear" if "linear" in plain else "radial"
    for name, tag in (("plain.svg", plain), ("percent.svg", percent)):
        (tmp_path / name).write_text(PICTURE.format(tag, kind))
    sprites = Sprites((tmp_path,), Typesetter())
    one, other = sprites.file("plain.svg", SIDE), sprites.file("percent.svg", SIDE)
    assert one.get_buffer().raw == other.get_buffer().raw
    assert len({tuple(one.get_at((x, x))) for x in range(SIDE)}) > 5


def test_pixels_and_percentages_stay() -> None:
    for tag in (
        '<linearGradient id="g1" gradientUnits="userSpaceOnUse" x1="3" y1="0" x2="9" y2="1">',
        '<radialGradient id="g2" cx="50%" r="75%">',
        '<rect x="1" r="2"/>',
    ):
        assert (
            with_percentages(PICTURE.format(tag, "linear").encode())
            == PICTURE.format(tag, "linear").encode()
        )


@pytest.mark.parametrize("number", ["1", "1.", ".1", "1e1"])
def test_an_endless_number_takes_no_time(number: str) -> None:
    """A quadratic pattern took hours for such a number, which a server could send."""
    long = number + number[-1] * 250_000
    tag = f'<linearGradient id="g" x1="{long}z">'
    assert with_percentages(tag.encode()) == tag.encode()
