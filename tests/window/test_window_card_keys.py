"""Which keys and clicks are a card's, and which are still those of the game, or of the chat."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import pygame
import pytest
from tests.support.window_play import SIZE, Script, Timer, at

from robotouille import World
from robotouille_client.window.forms.shown_card import QUIET_SECONDS
from robotouille_client.window.shell.game_cards import LEAVE_BUTTONS, REVIEW_BUTTONS, GameCards
from robotouille_client.window.view import View
from robotouille_client.window.window import Window

BUTTONS = (("Play again", "again"), ("Next task", "next"), *REVIEW_BUTTONS, *LEAVE_BUTTONS)


class Ending(Script):
    """A game that is over when somebody says so."""

    over = False

    @property
    def finished(self) -> bool:
        return self.over

    def view(self) -> View:
        view = super().view()
        return dataclasses.replace(view, outcome="Out of steps") if self.over else view


class Seat:
    """A window on such a game, and who sits before it."""

    def __init__(self) -> None:
        self.timer = Timer()
        self.source = Ending(World("training/01"))
        self.window = Window(
            SIZE,
            headless=True,
            clock=self.timer,
            cards=GameCards(lambda: None, lambda: BUTTONS),
        )
        self.frame()

    def frame(self) -> None:
        self.window.frame(self.source)

    def end(self) -> None:
        self.source.over = True
        self.frame()
        assert self.window.card is not None

    def later(self, seconds: float = QUIET_SECONDS) -> None:
        self.timer.now += seconds
        self.frame()

    def down(self, key: int, text: str = "") -> None:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=text))
        if text:
            pygame.event.post(pygame.Event(pygame.TEXTINPUT, text=text))
        self.frame()

    def up(self, key: int) -> None:
        pygame.event.post(pygame.Event(pygame.KEYUP, key=key, mod=0))
        self.frame()

    def press(self, *keys: int) -> None:
        for key in keys:
            self.down(key)
            self.up(key)

    def type(self, words: str, every: float = 0.2) -> None:
        for letter in words:
            key = pygame.K_SPACE if letter == " " else pygame.key.key_code(letter)
            self.down(key, letter)
            self.up(key)
            self.later(every)

    def move(self, pos: tuple[int, int]) -> None:
        buttons = {"rel": (0, 0), "buttons": (0, 0, 0)}
        pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, **buttons))
        self.frame()

    def click(self, pos: tuple[int, int]) -> None:
        self.move(pos)
        pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1))
        self.frame()

    def push(self, button: int) -> None:
        for kind in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
            pygame.event.post(pygame.Event(kind, button=button, instance_id=0))
        self.frame()

    def place(self, label: str) -> tuple[int, int]:
        """Where a button of the card is."""
        card = self.window.card
        assert card is not None
        place = card.place_of(next(row for row in card.rows if row.label == label))
        assert place is not None, label
        return place.center

    @property
    def overlay(self):  # type: ignore[no-untyped-def]
        return self.window.overlay(self.source.view())


@pytest.fixture
def seat() -> Iterator[Seat]:
    sitting = Seat()
    yield sitting
    sitting.window.close()


def answer(seat: Seat, keys: Sequence[int] = (pygame.K_RETURN,)) -> object:
    seat.press(*keys)
    return seat.window.answer


@pytest.mark.parametrize("key", [pygame.K_RETURN, pygame.K_ESCAPE, pygame.K_e, pygame.K_SPACE])
def test_a_key_pressed_as_the_game_ends_is_no_answer(seat: Seat, key: int) -> None:
    seat.end()
    for _ in range(3):
        seat.press(key)
        seat.later(0.2)
    assert seat.window.answer is None
    seat.later()
    assert answer(seat) == "again"


@pytest.mark.parametrize("key", [pygame.K_e, pygame.K_SPACE, pygame.K_1, pygame.K_w])
def test_keys_of_the_game_are_never_an_answer(seat: Seat, key: int) -> None:
    seat.end()
    for _ in range(12):
        seat.later(1.0)
        seat.press(key)
    assert seat.window.answer is None
    seat.later()
    assert answer(seat) == "again", "nor do they move the focus"


def test_keys_of_the_game_do_not_leave_it(seat: Seat) -> None:
    """Who presses Esc to forget what waits, when nothing does any more, and plays on."""
    seat.press(pygame.K_ESCAPE)
    assert seat.window.card is not None
    seat.press(pygame.K_s, pygame.K_e, pygame.K_SPACE, pygame.K_1)
    assert seat.window.answer is None
    seat.press(pygame.K_RETURN)
    assert seat.window.card is None, "Go on"


def test_a_gamepad_is_heard_once_its_buttons_rest(seat: Seat) -> None:
    seat.end()
    for _ in range(20):
        seat.push(pygame.CONTROLLER_BUTTON_A)
        seat.later(0.3)
    assert seat.window.answer is None
    seat.later()
    seat.push(pygame.CONTROLLER_BUTTON_DPAD_DOWN)
    seat.push(pygame.CONTROLLER_BUTTON_A)
    assert seat.window.answer == "next"


def test_a_key_that_is_held_since_before_is_not_pressed(seat: Seat) -> None:
    seat.down(pygame.K_DOWN)
    seat.end()
    for _ in range(5):
        seat.later()
        seat.down(pygame.K_DOWN)
    seat.up(pygame.K_DOWN)
    assert answer(seat) == "again"


def test_one_sees_when_the_card_listens(seat: Seat) -> None:
    seat.end()
    assert seat.window.card is not None
    before = pygame.image.tobytes(seat.window._display.surface, "RGB")
    assert not seat.window.card.listens
    seat.later()
    assert seat.window.card.listens
    assert pygame.image.tobytes(seat.window._display.surface, "RGB") != before


def test_clicks_are_heard_once_the_card_has_been_there_for_a_moment(seat: Seat) -> None:
    seat.end()
    seat.click(seat.place("Menu"))
    assert seat.window.answer is None
    seat.later(0.5)
    seat.press(pygame.K_w)
    seat.later(0.3)
    seat.click(at(seat.source.world, "table1"))
    assert seat.window.answer is None
    seat.click(seat.place("Menu"))
    assert seat.window.answer == "menu"


def test_what_is_typed_as_the_game_ends_stays_a_line_of_chat(seat: Seat) -> None:
    seat.press(pygame.K_t)
    seat.type("see ")
    seat.end()
    seat.type("you all", every=1.0)
    assert seat.overlay.typing == "see you all"
    assert seat.window.card is not None
    assert not seat.window.card.listens, "no row is marked"
    seat.press(pygame.K_RETURN)
    assert seat.overlay.typing is None
    assert seat.source.said == []
    assert seat.overlay.prompt == "The game is over, nobody hears: see you all"
    seat.press(pygame.K_RETURN)
    assert seat.window.answer is None
    seat.later()
    assert seat.window.card.listens
    assert answer(seat) == "again"


def test_a_line_of_chat_is_not_in_the_way_of_the_mouse(seat: Seat) -> None:
    seat.press(pygame.K_t)
    seat.end()
    seat.later()
    seat.click(seat.place("Save a video"))
    assert seat.window.answer == "video"


def test_letters_typed_ahead_are_neither_an_answer_nor_before_one(seat: Seat) -> None:
    seat.end()
    seat.later(2.0)
    seat.type("that was nice")
    seat.press(pygame.K_RETURN)
    assert seat.window.answer is None


def test_the_keys_of_the_window_always_work(seat: Seat) -> None:
    seat.end()
    seat.press(pygame.K_F11)
    assert seat.window._display.fullscreen
    seat.press(pygame.K_F11)


def test_what_is_open_at_the_end_is_closed(seat: Seat) -> None:
    seat.press(pygame.K_h)
    assert seat.overlay.help
    seat.end()
    assert not seat.overlay.help


def test_nothing_of_the_kitchen_is_marked_after_a_card(seat: Seat) -> None:
    """The mouse was on a station, then on a button of the card, where it still is."""
    seat.click(at(seat.source.world, "board1"))
    assert seat.overlay.tips
    without = len(seat.source.acted)
    seat.press(pygame.K_ESCAPE)
    assert seat.window.card is not None
    seat.click(seat.place("Go on"))
    assert seat.window.card is None
    assert not seat.overlay.tips
    assert len(seat.source.acted) == without


def test_under_a_card_nothing_of_the_kitchen_is_marked(seat: Seat) -> None:
    seat.press(pygame.K_ESCAPE)
    seat.frame()
    plain = pygame.image.tobytes(seat.window._display.surface, "RGB")
    seat.move(at(seat.source.world, "board1"))
    seat.frame()
    assert pygame.image.tobytes(seat.window._display.surface, "RGB") == plain


def test_a_direction_let_go_under_a_card_is_not_held_any_more(seat: Seat) -> None:
    seat.down(pygame.K_LEFT)
    walked = len(seat.source.acted)
    seat.press(pygame.K_ESCAPE)
    seat.up(pygame.K_LEFT)
    seat.press(pygame.K_ESCAPE)
    assert seat.window.card is None
    for _ in range(5):
        seat.later()
    assert len(seat.source.acted) == walked


def test_a_gamepad_closes_the_chat_and_what_is_open_before_it_asks(seat: Seat) -> None:
    seat.press(pygame.K_t)
    seat.push(pygame.CONTROLLER_BUTTON_B)
    assert seat.overlay.typing is None
    assert seat.window.card is None
    seat.press(pygame.K_h)
    seat.push(pygame.CONTROLLER_BUTTON_START)
    assert seat.window.card is not None
    assert not seat.overlay.help
