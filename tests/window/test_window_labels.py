"""The words of a window never cover each other, a station in use or what is held."""

from __future__ import annotations

import dataclasses
import itertools

import pygame
import pytest

from robotouille import World
from robotouille.world.scene import scene
from robotouille_client.window.drawing import lobby_card
from robotouille_client.window.drawing import painter as painting
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.pictures import theme
from robotouille_client.window.pictures.badges import seat_fill, seat_ink
from robotouille_client.window.pictures.colour_vision import contrast, strong_ink
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import Bubble, SeatView, View

SIZES = [(320, 240), (640, 360), (1280, 720), (2560, 1440)]
NAMES = ("Ada", "A name of forty wide characters WWWWWWWWWW", "厨房", "Björn")


def crowded(steps: int) -> View:
    """Everybody has a name, a reason or something to say."""
    world = World("multi_agent/10@4")
    previous = state = world.initial
    for step in range(steps):
        previous = state
        did = {p: a[(step * 5 + i) % len(a)] for i, p in enumerate(world.players)
               if (a := state.actions(p))}  # fmt: skip
        state = state.step(did).state
    seats = tuple(SeatView(p, NAMES[i]) for i, p in enumerate(world.players))
    bubbles = (
        Bubble("robot1", "Needs: table2 has a free surface."),
        Bubble("robot2", "I need the sink, and then the pot that is on the stove", "chat"),
        Bubble("robot4", "Coming!", "chat"),
    )
    return View(world, state, previous, steps, 80, "", 0.5, seats, "robot1", bubbles)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("steps", [0, 9, 23])
def test_no_words_overlap(size: tuple[int, int], steps: int, monkeypatch) -> None:
    seen: dict[str, list[pygame.Rect]] = {}
    place_all = painting.Labels.draw

    def watched(self, *arguments, **obstacles) -> None:
        seen.update(obstacles)
        place_all(self, *arguments, **obstacles)
        seen["words"] = list(self.places().values())

    monkeypatch.setattr(painting.Labels, "draw", watched)
    view, painter, surface = crowded(steps), Painter(), pygame.Surface(size)
    layout = painter.layout(size, view.world)
    overlay = UiOverlay(layout.kitchen.center, ("Pick up lettuce1 at table2",), "[E] Cut")
    painter.paint(surface, view, overlay)
    words = seen["words"]
    assert len(words) >= (5 if size[0] > 400 else 3)
    for one, other in itertools.combinations(words, 2):
        assert not one.colliderect(other)
    for area in words:
        assert area.collidelist(seen["blocked"]) < 0
        assert area.right <= layout.panel.left and surface.get_rect().contains(area)


def test_letters_grow_with_the_window() -> None:
    painter, world = Painter(), World("multi_agent/10@4")
    small, large = (painter.layout(size, world) for size in SIZES[2:])
    assert large.text == 2 * small.text
    assert abs(large.panel.width - 2 * small.panel.width) <= 2
    bigger = Painter(preferences=Preferences(text_scale=1.5)).layout(SIZES[2], world)
    assert bigger.text == round(1.5 * small.text)
    assert painter.layout((320, 240), world).text >= 11


PAIRS = {
    "text": (theme.TEXT, theme.PANEL), "text on a card": (theme.TEXT, theme.CARD),
    "faint": (theme.FAINT, theme.PANEL), "faint on a card": (theme.FAINT, theme.CARD),
    "accent": (theme.ACCENT, theme.PANEL), "accent on a card": (theme.ACCENT, theme.CARD),
    "done": (theme.GOOD, theme.CARD), "rejected": (theme.BAD, theme.CARD),
    "ticket": (theme.INK, theme.PAPER), "code": (theme.INK, theme.ACCENT),
    "prompt": (theme.TEXT, theme.INK), "reason": (theme.REASON, theme.PAPER),
    "somebody away": (theme.PAPER, theme.ABSENT),
    "nobody yet": (lobby_card._QUIET, theme.PAPER),
    "no connection": (theme.PAPER, theme.mixed(theme.BAD, theme.INK, 0.6)),
}  # fmt: skip


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_words_are_read_by_those_who_see_little_contrast(pair) -> None:
    assert contrast(*pair) >= 4.5


DARK = (theme.PANEL, theme.CARD, theme.INK, theme.BACKGROUND)
"""Grounds on which nothing but letters changes with strong contrast."""


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_with_strong_contrast_words_are_read_at_7_to_1(pair) -> None:
    ink, ground = pair
    under = ground if ground in DARK or ink == theme.INK else Typesetter(strong=True).ground(ground)
    assert contrast(strong_ink(ink), ground if ground == theme.PAPER else under) >= 7


@pytest.mark.parametrize("seat", range(len(theme.SEATS)))
def test_with_strong_contrast_the_names_of_all_seats_are_read_at_7_to_1(seat: int) -> None:
    ground = Typesetter(strong=True).ground(seat_fill(seat))
    assert contrast(strong_ink(theme.PAPER), ground) >= 7
    assert contrast(strong_ink(seat_ink(seat)), theme.CARD) >= 7


def test_strong_contrast_is_of_all_letters_and_of_nothing_that_is_strong_already() -> None:
    plain, strong = Typesetter(), Typesetter(strong=True)
    for ink, stays in ((theme.FAINT, False), (theme.INK, True), (theme.TEXT, True)):
        one, other = (
            pygame.image.tobytes(text.line("Words", 20, ink), "RGBA") for text in (plain, strong)
        )
        assert (one == other) is stays
    pictures = []
    for chosen in (False, True):
        surface = pygame.Surface((640, 360))
        Painter(preferences=Preferences(strong_contrast=chosen)).paint(surface, crowded(9))
        pictures.append(pygame.image.tobytes(surface, "RGB"))
    assert pictures[0] != pictures[1]


@pytest.mark.parametrize("seat", range(len(theme.SEATS)))
def test_the_names_of_all_seats_are_read(seat: int) -> None:
    assert contrast(theme.PAPER, seat_fill(seat)) >= 4.5
    assert contrast(seat_ink(seat), theme.CARD) >= 4.5
    assert contrast(seat_ink(seat), theme.PANEL) >= 4.5


CHOICES = UiOverlay(choices=tuple(f"Go to table {i}" for i in range(8)), more="9 more")


@pytest.mark.parametrize("size", SIZES)
def test_nothing_is_seen_through_the_list(size: tuple[int, int]) -> None:
    """Nothing of the chat shines through."""
    view = crowded(9)
    chats = [(("Ada", word * 30),) * 9 for word in ("quick ", "brown ")]
    shown = []
    for chat in chats:
        painter, surface = Painter(), pygame.Surface(size)
        painter.paint(surface, dataclasses.replace(view, chat=chat, bubbles=()), CHOICES)
        rows = [area for area, key in painter._key_strip._places if key.isdigit()]
        shown.append(surface.subsurface(rows[0].unionall(rows[1:])))
    one, other = (pygame.image.tobytes(each, "RGB") for each in shown)
    assert one == other


@pytest.mark.parametrize("size", SIZES)
def test_words_keep_off_the_outcome_and_the_strip_of_keys(size: tuple[int, int]) -> None:
    view = dataclasses.replace(crowded(23), outcome="Out of steps.", lost=True)
    painter, surface = Painter(), pygame.Surface(size)
    layout = painter.layout(size, view.world)
    overlay = UiOverlay(layout.kitchen.midbottom, ("Pick up lettuce1",), "Nothing to do")
    painter.paint(surface, view, overlay)
    (band,) = painter._notices.reserved(layout, view, overlay)
    places = painter._labels.places().values()
    assert places
    for area in places:
        assert not area.colliderect(band)
        assert area.bottom <= layout.strip.top - 2 * layout.text


@pytest.mark.parametrize("station", ["table1", "board1", "stove1", "sink1"])
def test_what_is_under_the_mouse_is_marked(station: str) -> None:
    """On light wood and on dark iron: its edge differs from what is around it by a lot."""
    world = World("multi_agent/07")
    painter = Painter()
    view = View(world, world.initial, hover=station)
    plain, marked = pygame.Surface((640, 400)), pygame.Surface((640, 400))
    painter.paint(plain, dataclasses.replace(view, hover=None))
    painter.paint(marked, view)
    layout = painter.layout((640, 400), world)
    cell = layout.cell(painter.stage(world.initial).placed[station].tile)
    edge = (cell.left + 1, cell.centery)
    ink, ground = marked.get_at(edge)[:3], marked.get_at((cell.left - 1, cell.centery))[:3]
    assert contrast(ink, ground) > 4.5
    middle = cell.center
    assert contrast(marked.get_at(middle)[:3], plain.get_at(middle)[:3]) < 2.5, "and quietly"


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("task", ["multi_agent/10@4", "training/01", "multi_agent/01"])
@pytest.mark.parametrize("scale", [1.0, 1.6])
def test_the_list_covers_neither_the_order_nor_the_seats_nor_ones_own_player(
    size: tuple[int, int], task: str, scale: float
) -> None:
    world = World(task)
    seats = tuple(SeatView(player, player) for player in world.players)
    painter, surface = Painter(preferences=Preferences(text_scale=scale)), pygame.Surface(size)
    painter.paint(surface, View(world, world.initial, seats=seats, me=world.players[0]), CHOICES)
    rows = [area for area, key in painter._key_strip._places if key.isdigit()]
    whole, place = rows[0].unionall(rows[1:]), painter.layout(size, world)
    free = painter._panel.free
    assert free.contains(whole) or not whole.colliderect(place.panel)
    if size[0] >= 640:
        assert surface.get_rect().contains(whole)
        tile = scene(world.initial)[world.players[0]].tile
        assert tile is not None
        if scale == 1.0:
            assert not whole.colliderect(place.cell(tile))
