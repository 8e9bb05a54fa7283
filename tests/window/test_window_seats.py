"""Seats and keys: badges, hats, colours for every eye, cards and the key strip."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import replace

import pygame
import pytest
from tests.support.colours import colour_distance
from tests.support.samples import quick_sample
from tests.support.window_play import Script, world_of

from robotouille.domain.rendering import rendering_of
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.side_panel.seat_cards import (
    SeatCards,
    latency_words,
    status,
    watching_words,
)
from robotouille_client.window.drawing.window_layout import UiOverlay
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.shapes import SHAPES, badge
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import DICHROMACIES, SEATS, Colour, simulated
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import SeatView, View

HAT = 0.32
# Share of a robot's picture that its hat takes, from the top.


@pytest.mark.parametrize("eye", [None, *DICHROMACIES])
def test_seat_colours_differ_for_colour_blind_people(eye: str | None) -> None:
    def seen(colour: Colour) -> Colour:
        return simulated(colour, eye) if eye else colour

    for (i, one), (j, other) in itertools.combinations(enumerate(SEATS), 2):
        least = 30 if max(i, j) < 4 else 20
        assert colour_distance(seen(one), seen(other)) > least, (i, j, eye)


def outline(picture: pygame.Surface) -> list[bool]:
    width, height = picture.get_size()
    return [picture.get_at((x, y)).a > 128 for y in range(height) for x in range(width)]


def difference(one: pygame.Surface, other: pygame.Surface) -> float:
    """Return the share of pixels in which two outlines differ."""
    pairs = list(zip(outline(one), outline(other), strict=True))
    return sum(a != b for a, b in pairs) / sum(a or b for a, b in pairs)


def test_badges_differ_in_shape() -> None:
    shapes = [badge(seat, 32, (0, 0, 0)) for seat in range(len(SHAPES))]
    assert len(shapes) >= len(SEATS)
    for one, other in itertools.combinations(shapes, 2):
        assert difference(one, other) > 0.1


@pytest.mark.parametrize("side", ["front", "back", "left", "right"])
def test_robots_wear_different_hats(side: str) -> None:
    world = world_of("multi_agent/07")
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


def test_cards_name_waiting_and_blocking_players() -> None:
    world = world_of("multi_agent/01")
    ada, bot = SeatView("robot1", "ada"), SeatView("robot2", "otter", "bot")
    view = View(world, world.initial, seats=(ada, bot), me="robot1")

    def words(**changed: object) -> list[str]:
        now = dataclasses.replace(view, **changed)
        return [status(seat, now)[0] for seat in now.seats]

    assert words() == ["robot1 · person", "robot2 · bot"]
    assert words(waits_for=("robot1", "robot2")) == ["your turn", "thinking"]
    assert words(me=None, waits_for=("robot1",)) == ["deciding", "robot2 · bot"]
    blocked = (("robot2", "stove1", "robot1"),)
    assert words(blocked=blocked) == ["step aside for otter", "waiting for you"]
    assert words(me=None, blocked=blocked)[1] == "waiting for ada"
    asked = (("robot2", "", "robot1"),)
    assert words(blocked=asked) == ["do what otter asks", "waiting for you"]
    assert words(me="robot2", blocked=asked)[0] == "keeps you waiting"
    assert words(me=None, blocked=asked)[0] == "keeps otter waiting"


@pytest.mark.parametrize("size", [(320, 240), (480, 360), (1280, 720)])
def test_cards_show_a_high_latency(size: tuple[int, int]) -> None:
    world, painter = world_of("multi_agent/01"), Painter()

    def card(milliseconds: int) -> bytes:
        seat = SeatView("robot1", "ada" * 9, latency_ms=milliseconds)
        surface = pygame.Surface(size)
        painter.paint(surface, View(world, world.initial, seats=(seat,), me="robot1"))
        return pygame.image.tobytes(surface, "RGB")

    near, slow, slower = map(card, (0, 200, 1500))
    assert card(100) == near
    assert len({near, slow, slower}) == 3


@pytest.mark.parametrize(("me", "counts"), [("robot1", False), (None, True)])
def test_only_those_who_watch_see_rejected_actions(me: str | None, counts: bool) -> None:
    world, painter = world_of("multi_agent/01"), RecordingPainter(1.0)
    seat = SeatView("robot1", "ada", actions=9, rejected=3)
    painter.paint(pygame.Surface((1280, 720)), View(world, world.initial, seats=(seat,), me=me))
    assert "9 done" in painter.words
    assert ("3 rejected" in painter.words) is counts


def test_latency_words_are_short() -> None:
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
def test_spectators_in_words(names: list[str], count: int, words: str) -> None:
    assert watching_words(names, count) == words


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (2560, 1440)])
def test_a_ticket_of_two_dishes_leaves_room_for_all_seats(
    size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    world = world_of("multi_agent/10@4")
    drawn = []
    card = SeatCards._card
    monkeypatch.setattr(SeatCards, "_card", lambda *a: (drawn.append(a[3].player), card(*a)))
    seats = tuple(SeatView(player, player.title()) for player in world.players)
    Painter().paint(pygame.Surface(size), View(world, world.initial, seats=seats, max_steps=90))
    assert drawn == list(world.players)


SCALES = (1.0, 1.3, 1.5, 1.6)
SIZES = [(1280, 720), (800, 600), (640, 360)]
KEYS = (("Arrows", "walk"), ("Tab", "all actions"), ("Esc", "leave"), ("H", "help"))
SENTENCE = "Some places are for work: carry something there, put it down, and press E."


class RecordingPainter(Painter):
    """Painter that records the words of its newest picture."""

    def __init__(self, scale: float) -> None:
        super().__init__(preferences=Preferences(text_scale=scale))
        self.words: list[str] = []
        line = self.text.line

        def kept(text: str, *others: object) -> pygame.Surface:
            self.words.append(text)
            return line(text, *others)

        self.text.line = kept

    def tooltip(self, pointer: tuple[int, int] | None) -> tuple[str, ...]:
        return ()


def shown(view: View, overlay: UiOverlay, size: tuple[int, int], scale: float) -> str:
    painter = RecordingPainter(scale)
    painter.paint(pygame.Surface(size), view, overlay)
    return " ".join(painter.words)


@pytest.fixture(scope="module")
def view() -> View:
    return Script(world_of("training/01")).view()


@pytest.mark.parametrize("size", quick_sample((size,) for size in SIZES))
@pytest.mark.parametrize("scale", SCALES)
def test_the_main_key_is_always_shown(view: View, size: tuple[int, int], scale: float) -> None:
    hints = (("E", "Put down the bread"), ("Click", "Pick up the tomato"))
    painter, surface = RecordingPainter(scale), pygame.Surface(size)
    for prompt in ("", "Sound off", "There is no free station that way"):
        painter.words.clear()
        painter.paint(surface, view, UiOverlay(prompt=prompt, hints=hints, keys=KEYS))
        words = " ".join(painter.words)
        assert "Put down the bread" in words
        assert prompt in words


@pytest.mark.parametrize("scale", SCALES)
def test_the_last_permanent_keys_stay_longest(view: View, scale: float) -> None:
    hints = (("E", "Stack the cooked patty onto the lower half of the bun"),)
    words = shown(view, UiOverlay(hints=hints, keys=KEYS), (800, 600), scale).split()
    there = [key in words for key, _ in KEYS]
    assert there == sorted(there)


@pytest.mark.parametrize("size", quick_sample((size,) for size in SIZES))
@pytest.mark.parametrize("scale", SCALES)
def test_a_lesson_covers_only_the_wall(view: View, size: tuple[int, int], scale: float) -> None:
    painter, surface = Painter(preferences=Preferences(text_scale=scale)), pygame.Surface(size)
    before = painter.layout(size, view.world)
    for lesson in ("Short.", SENTENCE, SENTENCE * 2):
        received = replace(view, lesson=lesson)
        painter.paint(surface, received)
        place = painter.layout(size, view.world)
        shown = painter._interruptions.draw(surface, place, received)
        assert all(area.bottom <= place.top for area in shown)
        assert place.corner((0, 0))[1] + place.tile <= place.strip.top
        painter.paint(surface, view)
        assert painter.layout(size, view.world) == before


@pytest.mark.parametrize("size", SIZES)
def test_a_notice_moves_nothing(view: View, size: tuple[int, int]) -> None:
    painter, surface = Painter(), pygame.Surface(size)
    before = painter.layout(size, view.world)
    painter.paint(surface, replace(view, notice=SENTENCE))
    assert painter.layout(size, view.world) == before


def test_a_prompt_hides_the_equal_hint(view: View) -> None:
    advice = "Fill the pot with water first"
    for prompt in ("", advice):
        overlay = UiOverlay(hints=(("", advice),), prompt=prompt)
        assert shown(view, overlay, (800, 600), 1.0).split().count("Fill") == 1
