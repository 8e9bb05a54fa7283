"""The list of tasks, and what is asked before a game here, by posted events."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Sequence

import pygame
import pytest
from tests.support.forms import drawn
from tests.support.window_play import follow, post

from robotouille import State, load_task
from robotouille.domain.loading import task_names
from robotouille.domain.rendering import Language
from robotouille.planning.policies import RandomPolicy
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille_client.bots.partners import PromptPartners
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.picker import PickerEntry, Told
from robotouille_client.window.forms.widgets import Choice, Words
from robotouille_client.window.hands.commands import Command
from robotouille_client.window.shell.games.local_game import LocalGame
from robotouille_client.window.shell.screens import task_picker, thumbnails
from robotouille_client.window.shell.screens.play_menu import PlayMenu
from robotouille_client.window.shell.screens.task_picker import TaskPicker
from robotouille_client.window.shell.screens.thumbnails import Thumbnails
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.sources.task_titles import dish_title, task_title

BURGER = "multi_agent/01_lettuce_burger"


@pytest.fixture(autouse=True)
def no_kitchen_is_drawn_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of kitchens are kept as long as a process lasts, for other tests, too."""
    monkeypatch.setattr(thumbnails, "_kitchens", OrderedDict())


def test_a_task_is_found_by_typing_and_taken_by_enter(display: Display) -> None:
    form = TaskPicker(Settings(), "synchronous/01_cheese_sandwich").form
    assert len(form.entries) == len(task_names())
    assert form.focused is not None
    assert form.focused.answer == "synchronous/01_cheese_sandwich"
    post("Lettuce bur")
    follow(form)
    found = [row.answer for row in form.rows if isinstance(row, PickerEntry)]
    assert BURGER in found
    assert len(found) < 10
    post("ger multi")
    follow(form)
    assert form.focused.answer == BURGER
    post(pygame.K_RETURN)
    follow(form)
    assert form.result == BURGER


def test_titles_that_are_what_was_typed_come_first(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/01_chicken_burger").form
    post("LETTUCE  burger")
    follow(form)
    titles = [row.told().title for row in form.rows if isinstance(row, PickerEntry)]
    exact = [title for title in titles if title.partition(" ")[2] == "Lettuce burger"]
    assert exact == titles[:1]
    assert len(titles) > 3
    assert form.focused is next(row for row in form.rows if isinstance(row, PickerEntry))


def test_each_family_has_one_heading_whatever_is_typed(display: Display) -> None:
    form = TaskPicker(Settings(), BURGER).form
    post("lettuce burger")
    follow(form)
    headings = [row.label for row in form.rows if isinstance(row, Words)]
    assert "Multi agent" in headings
    assert len(set(headings)) == len(headings)


def test_what_is_typed_is_erased_and_escape_forgets_it_first(display: Display) -> None:
    form = TaskPicker(Settings(), BURGER).form
    post("soup zz")
    follow(form)
    assert form.focused is form.rows[-1], "nothing is found: only the way back"
    post(pygame.K_BACKSPACE, pygame.K_BACKSPACE)
    follow(form)
    assert form.typed == "soup "
    post(pygame.K_ESCAPE)
    follow(form)
    assert (form.typed, form.result) == ("", None)
    assert sum(isinstance(row, PickerEntry) for row in form.rows) == len(task_names())
    post(pygame.K_ESCAPE)
    follow(form)
    assert form.result == "back"


def test_letters_that_mean_something_else_are_typed(display: Display) -> None:
    form = TaskPicker(Settings(), BURGER).form
    for letter in "we":
        key = pygame.key.key_code(letter)
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=letter))
        pygame.event.post(pygame.Event(pygame.TEXTINPUT, text=letter))
    follow(form)
    assert (form.typed, form.result) == ("we", None)


def test_families_by_the_sides_pages_ends_and_the_wheel(display: Display) -> None:
    form = TaskPicker(Settings(), "training/01_synchronous").form
    drawn(form, (800, 600))

    def at() -> object:
        assert form.focused is not None
        return form.focused.answer

    seen = []
    for _ in range(4):
        post(pygame.K_RIGHT)
        follow(form)
        seen.append(str(at()).partition("/")[0])
    assert seen[:3] == ["synchronous", "asynchronous", "multi_agent"]
    form.command(Command.LEFT)
    assert str(at()) == BURGER
    post(pygame.K_HOME)
    follow(form)
    assert at() == "training/01_synchronous"
    post(pygame.K_PAGEDOWN)
    follow(form)
    assert str(at()).startswith("synchronous/0")
    pygame.event.post(pygame.Event(pygame.MOUSEWHEEL, y=1))
    before = at()
    follow(form)
    assert at() != before
    post(pygame.K_END)
    follow(form)
    assert at() == "back"
    pygame.event.post(pygame.Event(pygame.MOUSEWHEEL, y=-1))
    follow(form)
    assert at() == "back", "the wheel does not go round"


def test_a_task_by_mouse(display: Display) -> None:
    form = TaskPicker(Settings(), "training/01_synchronous").form
    drawn(form, (800, 600))
    row = form.rows[2]
    place = form.place_of(row)
    assert place is not None
    pos = place.center
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1))
    follow(form)
    assert form.result == row.answer


def test_pictures_and_lengths_come_when_nobody_types(
    display: Display, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = tuple(name for name in task_names() if name.startswith(("training/", BURGER)))
    monkeypatch.setattr(task_picker, "task_names", lambda: some)
    best = {f"{BURGER}@2": 44, f"{BURGER}@3": 40}
    form = TaskPicker(Settings(best=best), BURGER).form
    drawn(form, (800, 600))
    row = form.focused
    assert isinstance(row, PickerEntry)
    assert row.picture is not None
    assert row.picture((200, 200)) is None, "no key has to wait for it"
    assert row.told() == Told("01 Lettuce burger", "for 2 to 4 · done in 40")
    for _ in range(2 * len(some)):
        if row.picture((200, 200)) is not None:
            break
        form.idle()
    while form.idle():
        pass
    assert "steps · done in 40" in row.told().detail
    assert "Your best game took 40 steps." in row.about()


def test_the_task_that_is_looked_at_has_its_length_first(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/07_onion_soup").form
    row = form.focused
    assert isinstance(row, PickerEntry)
    drawn(form, (1280, 720))
    assert form.idle()
    assert "89 steps" in row.told().detail
    assert "A very good game takes 89 steps." in row.about()


def test_every_certified_task_comes_to_its_length(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/07_onion_soup").form
    certified = [
        name for name in task_names() if any(load_task(name).folder.glob("*.certificate.json"))
    ]
    while form.idle():
        pass
    told = {row.answer: row.told().detail for row in form.entries}
    assert [name for name in certified if "steps" not in told[name]] == []


def test_forty_quick_presses_are_forty_and_wait_for_no_picture(
    display: Display, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(*_: object) -> None:
        raise AssertionError("a picture of a task is drawn in between")

    monkeypatch.setattr(thumbnails, "_drawn", draw)
    form = PlayMenu(Settings(task="training/01")).form
    task = form.rows[1]
    assert isinstance(task, Choice)
    form.focus(task)
    for _ in range(len(task.options) + 3):
        post(pygame.K_RIGHT)
        follow(form)
        drawn(form, (640, 480))
    assert task.index == 3


async def test_who_plays_alone_is_not_asked_about_partners() -> None:
    settings = Settings(task="synchronous/01")
    asking = PlayMenu(settings)
    answers: list[Callable[[Form], object]] = []
    seen: list[list[str]] = []

    async def ask(form: Form) -> object:
        seen.append([row.label for row in form.rows])
        return answers.pop(0)(form)

    answers += [lambda form: "task", lambda form: BURGER, lambda form: "start"]
    setup = await asking.ask(ask)
    assert setup is not None
    assert (setup.task, setup.seats) == (BURGER, 2)
    assert settings.task == BURGER
    assert "Partners" not in seen[0]
    assert "Players" not in seen[0]
    assert {"Partners", "Players"} <= set(seen[2])


def random_partners(
    start: State, kind: str, seed: int, players: Sequence[str], words: Language
) -> PromptPartners:
    """Bots that need not search for a plan first."""
    return PromptPartners({player: RandomPolicy(player, seed) for player in players})


def test_the_picture_marks_which_player_is_you(display: Display) -> None:
    """It is the one that is played, each time."""
    menu = PlayMenu(Settings(task=BURGER, seats=2))
    assert menu.form.picture is not None
    assert menu.form.picture((300, 200)) is None
    assert menu.form.idle()
    picture = menu.form.picture((300, 200))
    unmarked = Thumbnails()
    unmarked.at(BURGER, (300, 200))
    unmarked.load()
    other = unmarked.at(BURGER, (300, 200))
    assert picture is not None
    assert other is not None
    assert picture.get_size() == other.get_size()
    assert pygame.image.tobytes(picture, "RGB") != pygame.image.tobytes(other, "RGB")
    games = [LocalGame(menu.setup, "ada", time.monotonic, None, random_partners) for _ in "12"]
    seat = seat_out_of_the_way(games[0].world.initial)
    assert [game.source.view().me for game in games] == [seat, seat]


def test_titles_say_what_a_task_is() -> None:
    assert task_title(BURGER) == "Multi agent 01: lettuce burger"
    assert task_title(f"{BURGER}/free-42") == "Multi agent 01: lettuce burger, free-42"
    assert task_title("kitchen") == "Kitchen"
    assert "sandwich" in task_title("training/01_synchronous")
    assert dish_title("training/01_synchronous", "Make it.") == "Make it"
    assert dish_title(BURGER, "Make it.") == "Lettuce burger"
