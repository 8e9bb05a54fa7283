"""Labels never cover each other, nor what they must not, nor leave the window."""

from __future__ import annotations

import itertools

import pygame
from hypothesis import given
from hypothesis import strategies as st

from robotouille_client.window.drawing.words.placement import Label, Place, place_labels

AREA = pygame.Rect(10, 20, 300, 200)

corners = st.tuples(st.integers(-50, 350), st.integers(-50, 250))
rects = st.builds(
    pygame.Rect, st.integers(0, 300), st.integers(0, 200), st.integers(1, 90), st.integers(1, 60)
)
labels = st.builds(
    Label,
    key=st.integers(0, 1_000_000),
    size=st.tuples(st.integers(1, 160), st.integers(1, 90)),
    choices=st.lists(corners, min_size=1, max_size=4).map(tuple),
    importance=st.integers(0, 3),
    reach=st.none(),
    stays=st.just(value=True),
)
many = st.lists(labels, max_size=8, unique_by=lambda label: label.key)


@given(many, st.lists(rects, max_size=8), st.lists(rects, max_size=4))
def test_nothing_is_covered(labels, blocked, avoided) -> None:
    places = place_labels(labels, AREA, blocked, avoided)
    sizes = {label.key: label.size for label in labels}
    for key, place in places.items():
        assert place.area.size == sizes[key]
        assert AREA.contains(place.area)
        assert place.area.collidelist(blocked) < 0
    for one, other in itertools.combinations(places.values(), 2):
        assert not one.area.colliderect(other.area)
    assert places == place_labels(labels, AREA, blocked, avoided)


@given(many, st.lists(rects, max_size=5))
def test_what_is_left_out_fits_nowhere_beside_the_more_important(labels, blocked) -> None:
    places = place_labels(labels, AREA, blocked)
    order = sorted(labels, key=lambda label: -label.importance)
    for label in labels:
        if label.key in places:
            continue
        before = order[: order.index(label)]
        taken = [*blocked, *(places[x.key].area for x in before if x.key in places)]
        width, height = label.size
        for x in range(AREA.left, AREA.right - width + 1, 7):
            for y in range(AREA.top, AREA.bottom - height + 1, 7):
                assert pygame.Rect(x, y, width, height).collidelist(taken) >= 0


@given(many, st.lists(rects, max_size=5), st.tuples(st.integers(-2, 2), st.integers(-2, 2)))
def test_a_frame_later_everything_is_where_it_was(labels, blocked, moved) -> None:
    first = place_labels(labels, AREA, blocked)
    again = place_labels(labels, AREA, blocked, before=first)
    assert {k: p.area for k, p in again.items()} == {k: p.area for k, p in first.items()}
    follows = Label("a", (40, 20), ((100, 100), (100, 150)))
    held = {"a": Place(pygame.Rect(100, 150, 40, 20), (0, 50))}
    x, y = moved
    later = Label("a", (40, 20), ((100 + x, 100 + y), (100 + x, 150 + y)))
    assert place_labels([follows], AREA, before=held)["a"].area.topleft == (100, 150)
    assert place_labels([later], AREA, before=held)["a"].area.topleft == (100 + x, 150 + y)


def test_the_best_choice_that_is_free_is_taken() -> None:
    label = Label("a", (40, 20), ((100, 100), (200, 100), (200, 150)))
    assert place_labels([label], AREA)["a"].area.topleft == (100, 100)
    there = pygame.Rect(90, 90, 20, 20)
    assert place_labels([label], AREA, [there])["a"].area.topleft == (200, 100)
    soft = pygame.Rect(190, 90, 20, 20)
    assert place_labels([label], AREA, [there], [soft])["a"].area.topleft == (200, 150)
    both = [soft, pygame.Rect(190, 140, 30, 30)]
    assert place_labels([label], AREA, [there], both)["a"].area.topleft == (200, 100)
    assert place_labels([label], AREA, [there, *both])["a"].area.topleft == (100, 110)


def test_a_label_is_not_moved_beyond_its_reach() -> None:
    wall = [pygame.Rect(60, 60, 120, 120)]
    near = Label("a", (40, 20), ((100, 100),), reach=30)
    assert place_labels([near], AREA, wall) == {}
    assert "a" in place_labels([Label("a", (40, 20), ((100, 100),), reach=90)], AREA, wall)


def test_what_does_not_stay_goes_back_to_its_best_choice() -> None:
    held = {"a": Place(pygame.Rect(100, 150, 40, 20), (0, 50))}
    for stays, top in ((True, 150), (False, 100)):
        label = Label("a", (40, 20), ((100, 100), (100, 150)), stays=stays)
        assert place_labels([label], AREA, before=held)["a"].area.topleft == (100, top)


def test_what_is_spared_is_covered_only_where_there_is_no_other_place_within_reach() -> None:
    machine = pygame.Rect(80, 80, 60, 60)
    near = Label("a", (20, 20), ((100, 100),), reach=60)
    place = place_labels([near], AREA, spared=[machine])["a"].area
    assert not place.colliderect(machine)
    far = pygame.Rect(0, 0, 400, 400)
    assert place_labels([near], AREA, spared=[far])["a"].area.topleft == (100, 100)
