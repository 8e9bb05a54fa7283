"""Seats are told apart without colour: by their badges and their hats; and by any eye by colour."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pygame
import pytest
from tests.support.colours import colour_distance

from robotouille import World, load_task
from robotouille.domain.rendering import rendering_of
from robotouille.planning.plan import read_plan
from robotouille_client.window.drawing.kitchen.spots import hands
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.panel.seat_cards import (
    SeatCards,
    latency_words,
    status,
    watching_words,
)
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.badges import SHAPES, badge
from robotouille_client.window.pictures.colour_vision import DICHROMACIES, simulated
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import SEATS, Colour
from robotouille_client.window.view import SeatView, View

PLAN = "07_onion_potato_tomato_soup@4.plan"
HAT = 0.32
"""The part of a robot's picture, from the top, that its hat takes."""


@pytest.mark.parametrize("eye", [None, *DICHROMACIES])
def test_every_eye_tells_the_colours_of_seats_apart(eye: str | None) -> None:
    def seen(colour: Colour) -> Colour:
        return simulated(colour, eye) if eye else colour

    for (i, one), (j, other) in itertools.combinations(enumerate(SEATS), 2):
        least = 30 if max(i, j) < 4 else 20
        assert colour_distance(seen(one), seen(other)) > least, (i, j, eye)


def outline(picture: pygame.Surface) -> list[bool]:
    width, height = picture.get_size()
    return [picture.get_at((x, y)).a > 128 for y in range(height) for x in range(width)]


def difference(one: pygame.Surface, other: pygame.Surface) -> float:
    """The share of pixels that one outline has and the other has not."""
    pairs = list(zip(outline(one), outline(other), strict=True))
    return sum(a != b for a, b in pairs) / sum(a or b for a, b in pairs)


def test_no_two_badges_have_the_same_shape() -> None:
    shapes = [badge(seat, 32, (0, 0, 0)) for seat in range(len(SHAPES))]
    assert len(shapes) >= len(SEATS)
    for one, other in itertools.combinations(shapes, 2):
        assert difference(one, other) > 0.1


@pytest.mark.parametrize("side", ["front", "back", "left", "right"])
def test_no_two_robots_wear_the_same_hat(side: str) -> None:
    world = World("multi_agent/07")
    art = rendering_of(world.task)
    resolver = AppearanceResolver(world.task.domain, art)
    sprites = Sprites(art.folders(world.task.folder), Typesetter())
    size = 96
    hats = []
    for seat in range(4):
        picture = sprites.of(resolver.player("robot", seat, side), size)
        hats.append(picture.subsurface((0, 0, size, round(HAT * size))))
    for hat in hats:
        rows = [any(hat.get_at((x, y)).a > 128 for x in range(size)) for y in range(hat.height)]
        assert sum(rows) >= size / 5
    for one, other in itertools.combinations(hats, 2):
        assert difference(one, other) > 0.15


def test_what_is_held_is_seen_from_behind() -> None:
    """It is drawn over the hat."""
    world = World(load_task("multi_agent/07", seats=4))
    folder = load_task("multi_agent/07").folder
    state = world.initial
    for joint in list(read_plan((folder / PLAN).read_text(), world))[:20]:
        state = state.step(list(joint)).state
    painter, size = Painter(), (1280, 720)
    stage, layout = painter.stage(state), painter.layout(size, world)
    pose = painter._poses(View(world, state))["robot1"]
    assert pose.facing == "back"
    (pot,) = stage.piles["robot1"]
    spot = hands(layout, pose)
    surface = pygame.Surface(size)
    painter.paint(surface, View(world, state, step=20))
    sprite = painter._sprites.of(pot.appearance, round(pot.scale * spot.tile))
    drawn = surface.get_at((round(spot.x), round(spot.y)))
    middle = sprite.get_at((sprite.get_width() // 2, sprite.get_height() // 2))
    assert math.dist(drawn[:3], middle[:3]) < 40


def test_players_walk_on_their_feet(play) -> None:
    world = World("multi_agent/07")
    first, second = play(world, f"move {free_station(world)}")
    painter, pictures = Painter(), set()
    for phase in (0.1, 0.3, 0.5):
        surface = pygame.Surface((640, 400))
        painter.paint(surface, View(world, second, first, 1, phase=phase))
        pictures.add(pygame.image.tobytes(surface, "RGB"))
    assert len(pictures) == 3


def free_station(world: World) -> str:
    moves = (a for a in world.initial.actions("robot1") if a.name == "move")
    action = next(iter(moves))
    return next(n for n in action.arguments if n not in ("robot1", at(world)))


def at(world: World) -> str | None:
    return Painter().stage(world.initial).placed["robot1"].at


def test_a_card_says_who_is_waited_for_and_who_stands_in_the_way() -> None:
    world = World("multi_agent/01")
    ada, bot = SeatView("robot1", "ada"), SeatView("robot2", "otter", "bot")
    view = View(world, world.initial, seats=(ada, bot), me="robot1")

    def words(**changed: object) -> list[str]:
        now = dataclasses.replace(view, **changed)
        return [status(seat, now)[0] for seat in now.seats]

    assert words() == ["robot1 · human", "robot2 · bot"]
    assert words(waits_for=("robot1", "robot2")) == ["your turn", "thinks"]
    assert words(me=None, waits_for=("robot1",)) == ["is waited for", "robot2 · bot"]
    blocked = (("robot2", "stove1", "robot1"),)
    assert words(blocked=blocked) == ["stands in otter's way", "waits for you"]
    assert words(me=None, blocked=blocked)[1] == "waits for ada"
    asked = (("robot2", "", "robot1"),)
    assert words(blocked=asked) == ["is waited for", "waits for you"]


def test_what_a_card_says_moves_nothing_below_it() -> None:
    world = World("multi_agent/01")
    seats = (SeatView("robot1", "ada"), SeatView("robot2", "otter", "bot"))
    view = View(world, world.initial, seats=seats, me="robot1")
    painter = Painter()
    place = painter.layout((800, 500), world)
    cards = SeatCards(
        AppearanceResolver(world.task.domain, rendering_of(world.task)),
        Sprites((), Typesetter()),
        Typesetter(),
    )
    ends = {
        cards.draw(pygame.Surface((800, 500)), pygame.Rect(0, 0, 250, 400), place, shown)
        for shown in (view, dataclasses.replace(view, waits_for=("robot2",)))
    }
    assert len(ends) == 1


@pytest.mark.parametrize("size", [(320, 240), (480, 360), (1280, 720)])
def test_a_card_says_how_far_away_somebody_is_who_is_slow(size: tuple[int, int]) -> None:
    world, painter = World("multi_agent/01"), Painter()

    def card(milliseconds: int) -> bytes:
        seat = SeatView("robot1", "ada" * 9, latency_ms=milliseconds)
        surface = pygame.Surface(size)
        painter.paint(surface, View(world, world.initial, seats=(seat,), me="robot1"))
        return pygame.image.tobytes(surface, "RGB")

    near, slow, slower = map(card, (0, 200, 1500))
    assert card(100) == near
    assert len({near, slow, slower}) == 3


def test_latency_is_told_in_few_letters() -> None:
    assert [latency_words(each) for each in (150, 950, 1000, 12_450)] == [
        "150 ms", "950 ms", "1.0 s", "12.4 s",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "count", "words"),
    [
        ([], 2, "2 watching"),
        (["Ada"], 1, "Ada is watching"),
        (["Ada", "Ben"], 2, "Ada and Ben are watching"),
        (["Ada", "Ben", "Cleo"], 7, "Ada, Ben, Cleo and 4 more are watching"),
        (["Ada"], 2, "Ada and 1 more are watching"),
    ],
)
def test_who_watches_is_named(names: list[str], count: int, words: str) -> None:
    assert watching_words(names, count) == words


def test_the_panel_shows_who_watches() -> None:
    world = World("multi_agent/01")
    one, other = (
        View(world, world.initial, watching=1, spectator_names=names) for names in (("Ada",), ())
    )
    pictures = []
    for view in (one, other):
        surface = pygame.Surface((640, 480))
        Painter().paint(surface, view)
        pictures.append(pygame.image.tobytes(surface, "RGB"))
    assert pictures[0] != pictures[1]


def test_no_more_names_are_read_than_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    world, asked = World("multi_agent/01"), list[str]()
    reads = Typesetter.reads
    monkeypatch.setattr(Typesetter, "reads", lambda *a: (asked.append(a[1]), reads(*a))[1])
    names = ("\ue000", "Ada", "Ben", "Cleo", "Dan", "Eve", "Fay", "Gil")
    view = View(world, world.initial, watching=8, spectator_names=names)
    Painter().paint(pygame.Surface((640, 480)), view)
    assert [name for name in asked if name in names] == list(names[:4])


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (2560, 1440)])
def test_an_order_of_two_dishes_leaves_room_for_all_seats(
    size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    world = World("multi_agent/10@4")
    drawn = []
    card = SeatCards._card
    monkeypatch.setattr(SeatCards, "_card", lambda *a: (drawn.append(a[3].player), card(*a)))
    seats = tuple(SeatView(player, player.title()) for player in world.players)
    Painter().paint(pygame.Surface(size), View(world, world.initial, seats=seats, max_steps=90))
    assert drawn == list(world.players)
