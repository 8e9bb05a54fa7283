"""Labels and tips: their contrast, and that they cover nothing in use."""

from __future__ import annotations

import dataclasses
import itertools

import pygame
import pytest
from tests.support.golden_pictures import middle
from tests.support.samples import quick_sample
from tests.support.window_play import world_of

from robotouille import World, load_task
from robotouille.domain.task import Timing
from robotouille.world.scene import scene
from robotouille_client.window.drawing import painter as painting
from robotouille_client.window.drawing.cards import lobby_card
from robotouille_client.window.drawing.kitchen.spots import (
    Pose,
    extent,
    hands,
    occupied,
    player_area,
)
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.tags.labels import LabelSurroundings
from robotouille_client.window.drawing.tags.tips import Tips
from robotouille_client.window.drawing.window_layout import ActionMark, UiOverlay
from robotouille_client.window.pictures import theme
from robotouille_client.window.pictures.shapes import seat_fill, seat_ink
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import INK, contrast, strong_ink
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import Bubble, PauseView, SeatView, View

SIZES = [(320, 240), (640, 360), (1280, 720), (2560, 1440)]
NAMES = ("Ada", "A name of forty wide characters WWWWWWWWWW", "厨房", "Björn")


def crowded(steps: int) -> View:
    """Return a view in which every player has a name, a reason or something to say."""
    world = world_of("multi_agent/10@4")
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


@pytest.mark.parametrize("size", quick_sample((size,) for size in SIZES))
@pytest.mark.parametrize("steps", quick_sample([23, 0, 9]))
def test_labels_do_not_overlap(size: tuple[int, int], steps: int, monkeypatch) -> None:
    drawn: list[tuple[LabelSurroundings, list[pygame.Rect]]] = []
    draw = painting.Labels.draw

    def watched(self, *arguments) -> None:
        draw(self, *arguments)
        drawn.append((arguments[-1], list(self.places().values())))

    monkeypatch.setattr(painting.Labels, "draw", watched)
    view, painter, surface = crowded(steps), Painter(), pygame.Surface(size)
    layout = painter.layout(size, view.world)
    overlay = UiOverlay(layout.kitchen.center, ("Pick up lettuce1 at table2",), "[E] Cut")
    painter.paint(surface, view, overlay)
    [(around, words)] = drawn
    assert len(words) >= (5 if size[0] > 400 else 3)
    for one, other in itertools.combinations(words, 2):
        assert not one.colliderect(other)
    for area in words:
        assert area.collidelist(around.blocked) < 0
        assert area.right <= layout.panel.left and surface.get_rect().contains(area)


def test_letters_grow_with_the_window() -> None:
    painter, world = Painter(), world_of("multi_agent/10@4")
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
    "absent participant": (theme.PAPER, theme.ABSENT),
    "free seat": (lobby_card._QUIET, theme.PAPER),
    "no connection": (theme.PAPER, theme.mixed(theme.BAD, theme.INK, 0.6)),
}  # fmt: skip


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_text_has_enough_contrast(pair) -> None:
    assert contrast(*pair) >= 4.5


DARK = (theme.PANEL, theme.CARD, theme.INK, theme.BACKGROUND)
# Grounds on which strong contrast changes only the letters.


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_strong_contrast_is_7_to_1(pair) -> None:
    ink, ground = pair
    under = ground if ground in DARK or ink == theme.INK else Typesetter(strong=True).ground(ground)
    assert contrast(strong_ink(ink), ground if ground == theme.PAPER else under) >= 7


def test_strong_contrast_changes_weak_inks_only() -> None:
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
def test_seat_names_have_enough_contrast(seat: int) -> None:
    assert contrast(theme.PAPER, seat_fill(seat)) >= 4.5
    assert contrast(seat_ink(seat), theme.CARD) >= 4.5
    assert contrast(seat_ink(seat), theme.PANEL) >= 4.5
    ground = Typesetter(strong=True).ground(seat_fill(seat))
    assert contrast(strong_ink(theme.PAPER), ground) >= 7
    assert contrast(strong_ink(seat_ink(seat)), theme.CARD) >= 7


CHOICES = UiOverlay(choices=tuple(f"Go to table {i}" for i in range(8)), more="9 more")


@pytest.mark.parametrize("size", quick_sample((size,) for size in SIZES))
def test_the_list_is_opaque(size: tuple[int, int]) -> None:
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


@pytest.mark.parametrize("station", ["table1", "board1", "stove1", "sink1"])
def test_the_station_under_the_mouse_is_marked(station: str) -> None:
    """The mark's edge has contrast on light wood and on dark iron, but its wash is faint."""
    world = world_of("multi_agent/07")
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
    assert contrast(marked.get_at(middle)[:3], plain.get_at(middle)[:3]) < 2.5, "the wash is faint"


@pytest.mark.parametrize("size", quick_sample((size,) for size in SIZES))
@pytest.mark.parametrize(
    "task", quick_sample(["multi_agent/10@4", "training/01", "multi_agent/01"])
)
@pytest.mark.parametrize("scale", [1.0, 1.6])
def test_the_list_does_not_cover_the_ticket_the_seats_or_the_local_player(
    size: tuple[int, int], task: str, scale: float
) -> None:
    world = world_of(task)
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
        if scale == 1.0:
            assert not whole.colliderect(place.cell(tile))


def gap(one: pygame.Rect, other: pygame.Rect) -> int:
    across = max(0, one.left - other.right, other.left - one.right)
    return max(across, one.top - other.bottom, other.top - one.bottom)


def tip_of(painter: Painter, view: View, size: tuple[int, int]) -> pygame.Rect:
    surface = pygame.Surface(size)
    layout = painter.layout(size, view.world)
    tile = painter.stage(view.state).placed[view.hover or ""].tile
    painter.paint(surface, view, UiOverlay(layout.cell(tile).center, ("Go to the table", "Now")))
    (area,) = (a for key, a in painter._labels.places().items() if key[0] == ("tip", view.hover))
    return area


@pytest.mark.parametrize("size", [(640, 360), (1280, 720)])
@pytest.mark.parametrize(
    "name", quick_sample(["multi_agent/01@2", "asynchronous/06", "multi_agent/07@2"])
)
def test_station_tips_are_near_and_cover_nothing_in_use(name: str, size: tuple[int, int]) -> None:
    before, state, step = middle(load_task(name))
    view = View(state.world, state, before, step)
    painter = Painter()
    for station in list(painter.stage(state).stations):
        area = tip_of(painter, dataclasses.replace(view, hover=station), size)
        layout, stage = painter.layout(size, view.world), painter.stage(state)
        poses = painter._poses(view)
        about = extent(layout, stage, station, poses)
        assert about is not None
        assert gap(area, about) <= 1.5 * layout.tile, station
        assert area.collidelist(occupied(layout, stage, poses)) < 0


@pytest.mark.parametrize(("distance", "notched"), [(20, True), (150, False)])
def test_a_tip_points_at_its_station_only_from_nearby(distance: int, notched: bool) -> None:
    """A notch across the kitchen would be a long spike."""
    layout = Painter().layout((1280, 720), world_of("multi_agent/07"))
    text, surface = Typesetter(), pygame.Surface((1280, 720))
    tips, station = Tips(text, Sprites((), text)), pygame.Rect(300, 300, 80, 80)
    tip = tips.next_to(layout, "tip", ("The hatch",), station, 0)
    area = pygame.Rect((station.right + distance, 330), next(iter(tip.shapes)))
    surface.fill("white")
    tips.draw(surface, layout, tip, area)
    surface.fill("white", area)
    assert (pygame.mask.from_threshold(surface, INK, (9, 9, 9, 255)).count() > 0) == notched


def test_a_busy_player_gets_a_tip(play) -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    before, state = play(world, "move table2")[-2:]
    view = View(world, state, before, 1, phase=0.1, me="robot1", hover="stove1")
    painter, surface = Painter(), pygame.Surface((1280, 720))
    layout = painter.layout((1280, 720), world)
    painter.paint(surface, view, UiOverlay(layout.kitchen.center, ("The stove",)))
    (received,) = (key for key in painter._labels.places() if key[0] == "busy")
    steps = state.busy_steps("robot1")
    assert received[1] == (f"On your way: {steps} more steps",)
    own = player_area(layout, painter._poses(view)["robot1"])
    assert gap(painter._labels.places()[received], own) <= layout.tile
    painter.paint(surface, dataclasses.replace(view, state=world.initial, previous=None))
    assert not [key for key in painter._labels.places() if key[0] == "busy"]


@pytest.mark.parametrize("name", quick_sample(["multi_agent/01@2", "multi_agent/10@4"]))
def test_station_tips_cover_no_other_station(name: str) -> None:
    before, state, step = middle(load_task(name))
    view = View(state.world, state, before, step)
    painter = Painter()
    for station in list(painter.stage(state).stations):
        area = tip_of(painter, dataclasses.replace(view, hover=station), (1280, 720))
        layout = painter.layout((1280, 720), view.world)
        stage = painter.stage(state)
        cells = [layout.cell(stage.placed[each].tile) for each in stage.stations]
        own = extent(layout, stage, station, painter._poses(view))
        others = [cell for cell in cells if not cell.colliderect(own)]
        assert area.collidelist(others) < 0, station


def test_names_have_fixed_places() -> None:
    """A name is below its player in every kitchen, even if it covers the edge of a station."""
    world = World("multi_agent/10@4")
    painter, surface = Painter(), pygame.Surface((1280, 720))
    view = View(world, world.initial)
    painter.paint(surface, view)
    layout, places = painter.layout((1280, 720), world), painter._labels.places()
    below = {
        player: places["name", player].top - layout.corner(pose.at)[1]
        for player, pose in painter._poses(view).items()
    }
    assert len(set(map(round, below.values()))) == 1, below


def test_a_pause_card_covers_the_mark_of_the_last_action() -> None:
    world = World("multi_agent/10@4")
    view = View(world, world.initial, me="robot1", pause=PauseView("Paused", "Take your time."))
    painter, size = Painter(), (1280, 720)
    layout = painter.layout(size, world)
    middle_of_card = pygame.Rect(0, 0, layout.tile, layout.tile)
    middle_of_card.center = (layout.panel.left // 2, layout.size[1] // 2)
    for station in world.floor.stations:
        pictures = []
        for overlay in (UiOverlay(), UiOverlay(marks=(ActionMark(station, "asked"),))):
            surface = pygame.Surface(size)
            painter.paint(surface, view, overlay)
            pictures.append(pygame.image.tobytes(surface.subsurface(middle_of_card), "RGB"))
        assert pictures[0] == pictures[1], station


def test_held_objects_and_bubbles_stay_inside_the_kitchen(monkeypatch) -> None:
    world = World(load_task("shifts/01_sandwich_bar", seats=1))
    me, painter, drawn = world.players[0], Painter(), []
    walk = next(a for a in world.initial.actions(me) if a.destination == "board1")
    state = world.initial.step(walk).state
    draw = painting.Labels.draw

    def watched(self, *arguments) -> None:
        draw(self, *arguments)
        drawn.append(self.places())

    monkeypatch.setattr(painting.Labels, "draw", watched)
    said = Bubble(me, "Can you put the cut tomato on the bread, please?", "chat")
    surface = pygame.Surface((1280, 720))
    painter.paint(surface, View(world, state, me=me, bubbles=(said,)))
    kitchen = painter.layout(surface.get_size(), world).kitchen
    (bubble,) = [area for key, area in drawn[0].items() if key[0] == me]
    assert kitchen.left <= bubble.left
    assert bubble.right <= kitchen.right
    place = painter.layout(surface.get_size(), world)
    for column, side in ((0, "left"), (world.task.problem.width - 1, "right")):
        spot = hands(place, Pose((column, 2), side, walking=True))
        assert kitchen.left < spot.x - 0.3 * place.tile
        assert spot.x + 0.3 * place.tile < kitchen.right
