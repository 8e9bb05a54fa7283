"""Cards: input that belongs to the game or the chat, and cards that fit into any window."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cache

import pygame
import pytest
from tests.support.samples import quick_sample
from tests.support.window_play import SIZE, Script, Timer, at, headless_window, press

from robotouille import World, load_task
from robotouille.certification import step_limit
from robotouille.certification.stars import StarLimits, limits_of
from robotouille.domain.task import Task
from robotouille.episode.rules import Clock
from robotouille_client.window.app.game_cards import (
    LEAVE_BUTTONS,
    REVIEW_BUTTONS,
    GameCards,
    SeatShare,
    StarsRow,
    best_words,
    end_card,
)
from robotouille_client.window.app.local_game import GameSetup, LocalGame
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.forms.card_slot import QUIET_SECONDS
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import text_size
from robotouille_client.window.input.commands import Command
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT
from robotouille_client.window.view import SeatView, View

BUTTONS = (("Play again", "again"), ("Next task", "next"), *REVIEW_BUTTONS, *LEAVE_BUTTONS)


class Ending(Script):
    """Game that ends when the test says so."""

    over = False

    @property
    def finished(self) -> bool:
        return self.over

    def view(self) -> View:
        view = super().view()
        return dataclasses.replace(view, outcome="Out of steps") if self.over else view


class Seat:
    """Window with such a game, and input for it."""

    def __init__(self) -> None:
        self.timer = Timer()
        self.source = Ending(World("training/01"))
        cards = GameCards(lambda: None, lambda: BUTTONS)
        self.window = headless_window(SIZE, clock=self.timer, cards=cards)
        self.frame()

    def frame(self, *events: pygame.Event) -> None:
        for event in events:
            pygame.event.post(event)
        self.window.frame(self.source)

    def end(self) -> None:
        self.source.over = True
        self.frame()
        assert self.window.card is not None

    def later(self, seconds: float = QUIET_SECONDS) -> None:
        self.timer.now += seconds
        self.frame()

    def down(self, key: int, text: str = "") -> None:
        typed = [pygame.Event(pygame.TEXTINPUT, text=text)] if text else []
        self.frame(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=text), *typed)

    def up(self, key: int) -> None:
        self.frame(pygame.Event(pygame.KEYUP, key=key, mod=0))

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
        self.frame(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(0, 0, 0)))

    def click(self, pos: tuple[int, int]) -> None:
        self.move(pos)
        self.frame(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1))

    def push(self, button: int) -> None:
        kinds = (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP)
        self.frame(*(pygame.Event(kind, button=button, instance_id=0) for kind in kinds))

    def place(self, label: str) -> tuple[int, int]:
        """Return where a button of the card is."""
        card = self.window.card
        return card.place_of(next(row for row in card.rows if row.label == label)).center

    def pixels(self) -> bytes:
        return pygame.image.tobytes(self.window._display.surface, "RGB")

    @property
    def overlay(self):
        return self.window.overlay(self.source.view())


@pytest.fixture
def seat() -> Seat:
    return Seat()


def answer(seat: Seat, keys: Sequence[int] = (pygame.K_RETURN,)) -> object:
    seat.press(*keys)
    return seat.window.answer


@pytest.mark.parametrize("key", [pygame.K_RETURN, pygame.K_ESCAPE, pygame.K_e, pygame.K_SPACE])
def test_a_key_pressed_as_the_game_ends_does_not_answer(seat: Seat, key: int) -> None:
    seat.end()
    for _ in range(3):
        seat.press(key)
        seat.later(0.2)
    assert seat.window.answer is None
    seat.later()
    assert answer(seat) == "again"


def test_keys_of_the_game_never_answer(seat: Seat) -> None:
    seat.end()
    for key in (pygame.K_e, pygame.K_SPACE, pygame.K_1, pygame.K_w) * 3:
        seat.later(1.0)
        seat.press(key)
    seat.type("that was nice")
    seat.press(pygame.K_RETURN)
    assert seat.window.answer is None
    seat.later()
    assert answer(seat) == "again", "nor do they move the focus"


def test_keys_of_the_game_do_not_leave_it(seat: Seat) -> None:
    seat.press(pygame.K_ESCAPE)
    assert seat.window.card is not None
    seat.press(pygame.K_s, pygame.K_e, pygame.K_SPACE, pygame.K_1)
    assert seat.window.answer is None
    seat.press(pygame.K_RETURN)
    assert seat.window.card is None, "Keep playing"


def test_a_gamepad_answers_after_a_pause(seat: Seat) -> None:
    seat.end()
    for _ in range(20):
        seat.push(pygame.CONTROLLER_BUTTON_A)
        seat.later(0.3)
    assert seat.window.answer is None
    seat.later()
    seat.push(pygame.CONTROLLER_BUTTON_DPAD_DOWN)
    seat.push(pygame.CONTROLLER_BUTTON_A)
    assert seat.window.answer == "next"


def test_a_key_held_since_before_the_card_does_not_count(seat: Seat) -> None:
    seat.down(pygame.K_DOWN)
    seat.end()
    for _ in range(5):
        seat.later()
        seat.down(pygame.K_DOWN)
    seat.up(pygame.K_DOWN)
    assert answer(seat) == "again"


def test_the_focus_shows_when_the_card_accepts_keys(seat: Seat) -> None:
    seat.end()
    before = seat.pixels()
    assert not seat.window.card.listens
    seat.later()
    assert seat.window.card.listens
    assert seat.pixels() != before


def test_clicks_answer_after_a_moment(seat: Seat) -> None:
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


def test_typing_as_the_game_ends_stays_chat(seat: Seat) -> None:
    seat.press(pygame.K_t)
    seat.type("see ")
    seat.end()
    seat.type("you all", every=1.0)
    assert seat.overlay.typing == "see you all"
    assert not seat.window.card.listens, "no row is marked"
    seat.press(pygame.K_RETURN)
    assert seat.overlay.typing is None
    assert seat.source.said == []
    assert seat.overlay.prompt == "Not sent, the game is over: see you all"
    seat.press(pygame.K_RETURN)
    assert seat.window.answer is None
    seat.later()
    assert seat.window.card.listens
    assert answer(seat) == "again"


def test_window_keys_always_work(seat: Seat) -> None:
    seat.end()
    seat.press(pygame.K_F11)
    assert seat.window._display.fullscreen
    seat.press(pygame.K_F11)


def test_help_and_list_close_at_the_end(seat: Seat) -> None:
    seat.press(pygame.K_h)
    assert seat.overlay.help
    seat.end()
    assert not seat.overlay.help


def test_no_mark_in_the_kitchen_after_a_card(seat: Seat) -> None:
    seat.click(at(seat.source.world, "board1"))
    assert seat.overlay.tips
    without = len(seat.source.acted)
    seat.press(pygame.K_ESCAPE)
    assert seat.window.card is not None
    seat.click(seat.place("Keep playing"))
    assert seat.window.card is None
    assert not seat.overlay.tips
    assert len(seat.source.acted) == without


def test_a_direction_released_during_a_card_is_released(seat: Seat) -> None:
    seat.down(pygame.K_LEFT)
    walked = len(seat.source.acted)
    seat.press(pygame.K_ESCAPE)
    seat.up(pygame.K_LEFT)
    seat.press(pygame.K_ESCAPE)
    assert seat.window.card is None
    for _ in range(5):
        seat.later()
    assert len(seat.source.acted) == walked


def test_gamepad_b_closes_chat_and_help_before_it_asks(seat: Seat) -> None:
    seat.press(pygame.K_t)
    seat.push(pygame.CONTROLLER_BUTTON_B)
    assert seat.overlay.typing is None
    assert seat.window.card is None
    seat.press(pygame.K_h)
    seat.push(pygame.CONTROLLER_BUTTON_START)
    assert seat.window.card is not None
    assert not seat.overlay.help


SAVED = "Video saved: ~/.local/share/robotouille/recordings/20261122T210000Z_10_1234.mp4"


@cache
def crowded_world(seats: int) -> World:
    return World(load_task("multi_agent/10", seats=seats, timing="people"))


def card(seats: int) -> Form:
    world = crowded_world(seats)
    row = {"acted": 120, "busy": 300, "waiting": 12, "idle": 40, "away": 3, "substituted": 7}
    outcome = {
        "reason": "step_limit",
        "steps": 482,
        "seats": [{"player": player, **row} for player in world.players],
    }
    names = tuple(SeatView(player, f"Benedikta the {player}") for player in world.players)
    return end_card(View(world, world.initial, seats=names, me=world.players[0]), outcome, BUTTONS)


def panel(size: tuple[int, int]) -> tuple[pygame.Rect, int]:
    """Return a card next to a kitchen."""
    found = layout(size, 10, 9)
    return found.panel, max(11, found.text - 2)


def screen(size: tuple[int, int]) -> tuple[pygame.Rect, int]:
    """Return a card in an otherwise empty window."""
    letters = text_size(size, 1.0)
    area = pygame.Rect(0, 0, min(size[0] - letters, 40 * letters), size[1] - 5 * letters)
    area.midbottom = (size[0] // 2, size[1] - letters)
    return area, letters


@pytest.mark.parametrize("place", [panel, screen])
@pytest.mark.parametrize(
    "size",
    quick_sample((size,) for size in [(640, 480), (1120, 630), (1280, 720), (3840, 2160)]),
)
@pytest.mark.parametrize("seats", quick_sample([4, 2]))
@pytest.mark.parametrize("message", quick_sample([SAVED, ""]))
def test_all_buttons_are_visible(place, size, seats: int, message: str) -> None:
    form = card(seats)
    form.message = message
    area, letters = place(size)
    form.draw(pygame.Surface(size), area, Typesetter(), letters)
    for row in form.rows:
        place = form.place_of(row)
        assert place is not None, row.label
        assert area.contains(place), row.label
    assert not form.scroll_bar.width, "nothing has to be scrolled to"


@pytest.mark.parametrize("timing", ["people", "benchmark"])
def test_a_task_from_a_server_has_its_plan_length(
    monkeypatch: pytest.MonkeyPatch, timing: str
) -> None:
    task = load_task("synchronous/01", timing=timing)
    sent = Task.from_json(task.to_json())
    monkeypatch.setattr(step_limit, "_lengths", {})
    words = best_words(sent)
    assert words.startswith({"people": "Best known", "benchmark": "Best possible"}[timing])
    monkeypatch.setattr(step_limit, "_lengths", {})
    assert words == best_words(task)


@pytest.mark.parametrize(
    ("points", "stars", "words"),
    [
        (86, 0, "One star needs 87 points."), (87, 1, "Two stars need 175 points."),
        (175, 2, "Three stars need 264 points."), (264, 3, "Three stars need 264 points."),
    ],
)  # fmt: skip
def test_stars_of_a_shift_depend_on_points(points: int, stars: int, words: str) -> None:
    world = World(load_task("shifts/01_sandwich_bar", seats=1, timing="people"))
    view = View(
        world, world.initial, won=True, me="robot1",
        seats=(SeatView("robot1", "ada", "human", True),),
    )  # fmt: skip
    score = {"points": points, "served": 3, "expired": 0}
    form = end_card(view, {"reason": "shift_over", "steps": 900, "score": score}, BUTTONS)
    (row,) = [row for row in form.rows if isinstance(row, StarsRow)]
    assert (row.stars, row.label) == (stars, words)
    assert form.title == ("Shift over", "Good start!", "Well done!", "Excellent!")[stars]


@pytest.mark.parametrize(
    ("timing", "words"),
    [
        ("benchmark", "Best known: 314 points."),
        ("people", "Best known: 368 points."),
        ("unknown", "No more than 379 points are possible."),
    ],
)
def test_the_card_after_a_shift_has_the_best_result(timing: str, words: str) -> None:
    known = timing != "unknown"
    task = load_task("shifts/01_sandwich_bar", seats=1, timing=timing if known else "people")
    if not known:
        shift = task.problem.shift.model_copy(update={"planner_people": {}})
        task = dataclasses.replace(task, problem=task.problem.model_copy(update={"shift": shift}))
    world = World(task)
    seats = (SeatView("robot1", "ada", "human", True),)
    view = View(world, world.initial, won=True, me="robot1", seats=seats)
    score = {"points": 100, "served": 3, "expired": 0}
    form = end_card(view, {"reason": "shift_over", "steps": 180, "score": score}, BUTTONS)
    assert words in [row.label for row in form.rows]


@pytest.mark.parametrize(
    ("tally", "words"),
    [
        ({"acted": 150, "busy": 237, "idle": 513}, "busy 43% of the time"),
        (
            {"acted": 10, "waiting": 5, "away": 5},
            "busy 50% of the time, waiting for others 25%, away 25%",
        ),
        ({"idle": 7}, "did nothing"),
        ({"acted": -5, "idle": 0}, "did nothing"),
    ],
)
def test_the_end_card_tells_how_busy_a_player_was(tally: dict[str, int], words: str) -> None:
    assert SeatShare.of("ada", tally).words == words


@pytest.mark.parametrize(("acted", "stars"), [(0, 0), (1, 3)])
def test_a_player_who_did_nothing_earns_no_stars(acted: int, stars: int) -> None:
    world = World(load_task("multi_agent/07", seats=3, timing="people"))
    view = View(world, world.initial, me="robot1", won=True, step_seconds=0.2)
    tallies = [{"player": "robot1", "acted": acted}, {"player": "robot2", "acted": 60}]
    outcome = {"reason": "goal", "steps": 130, "seconds": 26.0, "seats": tallies}
    form = end_card(view, outcome, BUTTONS)
    (row,) = [row for row in form.rows if isinstance(row, StarsRow)]
    assert row.stars == stars
    assert row.label.startswith("Three stars" if acted else "You only watched")
    assert form.title == ("Excellent!" if acted else "The others did it!")


@pytest.mark.parametrize(("steps", "stars"), [(72, 3), (73, 2), (89, 2), (90, 1), (500, 1)])
def test_stars_follow_from_the_known_plan(steps: int, stars: int) -> None:
    world = World(load_task("synchronous/01", timing="people"))
    assert limits_of(11, 5.0) == StarLimits(72, 89)
    view = View(world, world.initial, me="robot1", won=True, step_seconds=0.2)
    form = end_card(view, {"reason": "goal", "steps": steps, "seconds": 9.0, "seats": []}, BUTTONS)
    assert form.title == ("You did it!", "Well done!", "Excellent!")[stars - 1]
    (row,) = [row for row in form.rows if isinstance(row, StarsRow)]
    most = {1: "Two stars need at most 89 steps."}.get(stars, "Three stars need at most 72 steps.")
    assert (row.stars, row.label) == (stars, most)
    lost = end_card(dataclasses.replace(view, won=False), None, BUTTONS)
    assert not [row for row in lost.rows if isinstance(row, StarsRow)]


def test_a_tiny_window_has_a_scroll_bar() -> None:
    form = card(4)
    area, letters = panel((320, 240))
    for _ in BUTTONS:
        form.draw(pygame.Surface((320, 240)), area, Typesetter(), letters)
        assert form.scroll_bar.width
        assert form.focused is not None
        place = form.place_of(form.focused)
        assert area.contains(place)
        form.command(Command.DOWN)


SETUP = GameSetup("training/01", clock=Clock.REALTIME, rate=10.0, countdown=0.0)


@pytest.mark.parametrize("close", [pygame.K_h, pygame.K_ESCAPE])
def test_a_local_game_pauses_during_help(close: int) -> None:
    timer = Timer()
    game = LocalGame(SETUP, "Ada", timer, None)
    source = game.source
    cards = GameCards(lambda: source.outcome, tuple, source.pause)
    window = headless_window((800, 600), clock=timer, cards=cards)
    try:
        window.frame(source)
        press(window, source, pygame.K_h)
        step = source.view().step
        timer.now += 9.0
        assert (source.view().step, source.view().frozen) == (step, True)
        press(window, source, close)
        timer.now += 1.0
        assert not source.view().frozen
        assert source.view().step > step
        press(window, source, pygame.K_h)
        press(window, source, pygame.K_h)
        assert not source.view().frozen
        press(window, source, pygame.K_ESCAPE)
        assert source.view().frozen
    finally:
        game.finish(ended=False)


@pytest.mark.parametrize("task", ["multi_agent/07", "asynchronous/10", "training/01"])
def test_the_help_uses_no_action_identifiers(task: str) -> None:
    source = Script(World(task))
    window = headless_window((800, 600), clock=Timer())
    window.frame(source)
    press(window, source, pygame.K_h)
    rows = window.overlay(source.view()).help
    said = " ".join(words for _, words in rows)
    assert "Esc" in dict(rows)
    for schema in source.world.schemas:
        name = schema.name.replace("-", " ")
        assert " " not in name or f"{name}," not in said, name


@pytest.mark.parametrize("size", [(320, 240), (640, 360), (1280, 720)])
def test_the_help_fits_the_window(size: tuple[int, int]) -> None:
    source = Script(World("asynchronous/06"))
    window = headless_window(size, clock=Timer())
    window.frame(source)
    press(window, source, pygame.K_h)
    picture = pygame.display.get_surface()
    middle = range(size[0] // 3, 2 * size[0] // 3)
    frame = [y for y in range(size[1]) if all(picture.get_at((x, y)) == ACCENT for x in middle)]
    assert frame[-1] - frame[0] > size[1] // 3  # Its upper and its lower edge.
