"""Lanes: colours and heights of activities, marks and the scale."""

from __future__ import annotations

import pygame
import pytest
from tests.support.colours import colour_distance

from robotouille.episode.tallies import Activity
from robotouille.replay.recording import Recording
from robotouille_client.window.pictures.theme import DICHROMACIES, Colour, contrast, simulated
from robotouille_client.window.replay.histories.history import MARKED, EntryKind
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory
from robotouille_client.window.replay.timeline.lanes import Lanes, Scale
from robotouille_client.window.replay.timeline.legend import (
    ACTIVITY_LOOKS,
    MARK_COLOURS,
    MARK_WORDS,
    TRACK,
)

ROWS, HEAD, WIDTH = 40, 20, 800


@pytest.fixture(scope="module")
def history(recording: Recording) -> RecordedHistory:
    return RecordedHistory(recording)


def drawn(history: RecordedHistory, width: int, followed: int | None = None) -> pygame.Surface:
    scale = Scale()
    scale.place(0, width, 0, history.length)
    surface = pygame.Surface((width, HEAD + ROWS * len(history.lanes)))
    Lanes(history).draw(surface, surface.get_rect(), scale, ROWS, HEAD, followed)
    return surface


def height(surface: pygame.Surface, x: int, bottom: int, colours: set[Colour]) -> int:
    """Return the height of the block in some colours above a pixel."""
    high = 0
    while tuple(surface.get_at((x, bottom - high))[:3]) in colours:
        high += 1
    return high


def test_each_step_has_the_look_of_its_activity(history: RecordedHistory) -> None:
    surface = drawn(history, WIDTH)
    lane = ROWS - ROWS * 2 // 5 - 2
    for place, player in enumerate(history.world.players):
        bottom = HEAD + (place + 1) * ROWS - 3
        for step in range(1, history.length + 1):
            activity = history.activity(player, step)
            look = ACTIVITY_LOOKS[activity]
            x = round((step - 0.5) / history.length * WIDTH)
            colours = {look.colour, look.darker}
            found = height(surface, x, bottom, colours)
            assert found == pytest.approx(max(2, lane * look.height), abs=1)


def test_activities_differ_in_height_or_pattern() -> None:
    looks = list(ACTIVITY_LOOKS.values())
    for one, look in enumerate(looks):
        for other in looks[:one]:
            assert abs(look.height - other.height) >= 0.1 or look.pattern != other.pattern


@pytest.mark.parametrize("kind", [None, *DICHROMACIES])
def test_activity_colours_differ_for_colour_blind_people(kind: str | None) -> None:
    """Check the distance of all pairs (CIE 1976), and the contrast with the ground."""
    colours = [TRACK, *(look.colour for look in ACTIVITY_LOOKS.values())]
    seen = [colour if kind is None else simulated(colour, kind) for colour in colours]
    for one, colour in enumerate(seen):
        for other in seen[:one]:
            if TRACK not in (colours[one], colours[seen.index(other)]):
                assert colour_distance(colour, other) > 25, (colour, other)
    assert all(contrast(colour, seen[0]) > 1.2 for colour in seen[1:])


def test_every_kind_has_a_word_and_a_colour() -> None:
    assert set(ACTIVITY_LOOKS) == set(Activity)
    assert set(MARK_WORDS) == set(MARK_COLOURS) == MARKED
    words = [*MARK_WORDS.values(), *(look.words for look in ACTIVITY_LOOKS.values())]
    assert len(set(words)) == len(words)


def test_several_steps_a_pixel_share_the_height(history: RecordedHistory) -> None:
    surface = drawn(history, 20)
    bottom = HEAD + ROWS - 3
    found = {
        tuple(surface.get_at((x, y))[:3]) for x in range(20) for y in range(bottom - 20, bottom)
    }
    for step in range(1, history.length + 1):
        activity = history.activity("robot1", step)
        assert ACTIVITY_LOOKS[activity].colour in found
    assert found - {TRACK}


def test_marks_are_above_their_lane(history: RecordedHistory) -> None:
    surface = drawn(history, WIDTH)
    for mark in history.marks:
        if mark.kind is EntryKind.ENDED:
            continue
        top = 1 if not mark.player else HEAD + 2
        x = round(mark.step / history.length * WIDTH)
        around = {
            tuple(surface.get_at((x + dx, top + dy))[:3])
            for dx in range(-8, 30)
            for dy in range(16)
        }
        assert MARK_COLOURS[mark.kind] in around, mark


def test_other_lanes_are_faded_while_following(history: RecordedHistory) -> None:
    whole, followed = drawn(history, WIDTH), drawn(history, WIDTH, followed=1)
    first, second = HEAD + ROWS - 3, HEAD + 2 * ROWS - 3
    assert whole.get_at((10, first)) != followed.get_at((10, first))
    assert whole.get_at((10, second)) == followed.get_at((10, second))


def test_zooming_in_and_out_restores_the_scale() -> None:
    scale = Scale()
    scale.place(100, 850, 0, 10_000)
    assert (scale.x(0), scale.x(10_000)) == (100, 950)
    assert (scale.step(0), scale.step(2000)) == (0, 10_000)
    for _ in range(100):
        before = scale.step(500)
        scale.zoom(500, 0.8)
        assert abs(scale.step(500) - before) <= scale.shown / 850 + 1
    assert scale.shown == 10
    scale.reveal(9_999)
    assert scale.first <= 9_999 <= scale.last <= 10_000
    scale.reveal(0)
    assert scale.first == 0
    for _ in range(100):
        scale.zoom(100, 1.25)
    assert (scale.first, scale.last) == (0, 10_000)


def test_the_scale_of_a_game_without_steps() -> None:
    scale = Scale()
    scale.place(0, 100, 0, 0)
    assert scale.step(50) == 0
    assert scale.x(0) == 0
    scale.zoom(50, 0.5)
    scale.reveal(0)
