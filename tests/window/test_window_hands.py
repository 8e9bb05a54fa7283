"""Walking by keys, the key that does what is useful, the list, and what waits to be done."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.window_play import ARROWS, SIZE, Script, Timer, click, goes_to, press, way

from robotouille import GroundAction, Timing, World, load_task, task_names
from robotouille.certification.certificate import load_certificate
from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.rendering import rendering_of
from robotouille.domain.schema import InputFile
from robotouille.world.scene import scene
from robotouille_client.window.hands.commands import DIRECTIONS, Command, KeyMap, key_words
from robotouille_client.window.hands.controls import Controls
from robotouille_client.window.hands.possible import possible
from robotouille_client.window.hands.walking import towards
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import Bubble, LobbyView
from robotouille_client.window.window import Window


class Table:
    """A window, its clock, and a game in it."""

    def __init__(self, source: Script, **options: object) -> None:
        self.timer = Timer()
        self.source = source
        self.window = Window(SIZE, headless=True, clock=self.timer, **options)  # type: ignore[arg-type]
        self.window.frame(source)

    def press(self, *keys: int, mod: int = 0) -> list[str]:
        press(self.window, self.source, *keys, mod=mod)
        return [action.name for action in self.source.acted]

    def click(self, station: str, button: int = 1) -> None:
        click(self.window, self.source, station, button)

    def overlay(self):  # type: ignore[no-untyped-def]
        return self.window.overlay(self.source.view())

    def possible(self) -> tuple[GroundAction, ...]:
        """What the list has, in its order."""
        return possible(self.source.state, self.source.me)

    def here(self) -> str | None:
        return scene(self.source.state)[self.source.me].at

    def step(self) -> None:
        self.source.step()
        self.window.frame(self.source)


@pytest.fixture
def table() -> Iterator[Table]:
    opened = Table(Script(World("training/01")))
    yield opened
    opened.window.close()


@pytest.fixture
def slow() -> Iterator[Table]:
    opened = Table(Script(World("training/01"), slow=True))
    yield opened
    opened.window.close()


def use_to_the_end(table: Table, task: str, walk, use) -> None:  # type: ignore[no-untyped-def]
    """Play the proven plan of a task, each action by what stands for it."""
    for line in load_certificate(load_task(task)).plan or ():
        action = table.source.world.parse(table.source.state, table.source.me, line)
        station = goes_to(action)
        if station is not None:
            walk(station)
            assert table.here() == station
            continue
        before = len(table.source.acted)
        use(action)
        assert [str(a) for a in table.source.acted[before:]] == [str(action)]
    assert table.source.finished


TASKS = ("synchronous/01", "training/01", "synchronous/06")


@pytest.mark.parametrize("task", TASKS)
def test_a_whole_task_by_keys_alone(task: str) -> None:
    table = Table(Script(World(task)))

    def walk(station: str) -> None:
        table.press(*[ARROWS[c] for c in way(table.source.state, table.source.me, station)])

    use_to_the_end(table, task, walk, lambda _: table.press(pygame.K_e))
    table.window.close()


@pytest.mark.parametrize("task", TASKS)
def test_a_whole_task_by_mouse_alone(task: str) -> None:
    table = Table(Script(World(task)))
    use_to_the_end(table, task, table.click, lambda _: table.click(table.here() or "", 3))
    table.window.close()


@pytest.mark.slow
def test_the_arrows_lead_to_every_station_of_every_task() -> None:
    for task in task_names():
        world = World(task)
        me = world.players[0]
        for action in world.initial.actions(me):
            station = goes_to(action)
            if station is not None:
                assert way(world.initial, me, station)


def test_letters_and_arrows_walk(table: Table) -> None:
    start = table.here()
    assert table.press(pygame.K_DOWN) == ["move"]
    below = table.here()
    assert below != start
    assert table.press(pygame.K_w) == ["move", "move"]
    assert table.here() != below


def test_where_there_is_nothing_a_line_says_so(table: Table) -> None:
    assert table.press(pygame.K_RIGHT) == []
    assert table.overlay().prompt == "There is no free place that way"
    assert ("H", "help") in table.overlay().keys, "help stays findable"


def test_a_letter_that_an_input_file_binds_is_the_files() -> None:
    world = World("training/01")
    bound = bindings_of(world.task).model_dump()
    bound["keyboard_actions"][-1]["input_instructions"]["key"] = "d"
    look = KitchenLook(rendering_of(world.task), InputFile.model_validate(bound), Path())
    table = Table(Script(world), look=look)
    assert table.press(pygame.K_d) == ["wait"]
    assert table.press(pygame.K_a, pygame.K_RIGHT)[-1] == "move"
    assert ("Arrows", "walk") in table.overlay().keys
    table.window.close()


def test_a_held_key_walks_on(table: Table) -> None:
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_LEFT, mod=0, unicode=""))
    for seconds in (0.0, 0.2, 0.2, 0.0):
        table.timer.now += seconds
        table.window.frame(table.source)
    assert len(table.source.acted) == 2
    pygame.event.post(pygame.Event(pygame.KEYUP, key=pygame.K_LEFT, mod=0))
    table.timer.now += 1.0
    table.window.frame(table.source)
    walked = len(table.source.acted)
    table.window.frame(table.source)
    assert len(table.source.acted) == walked


def test_what_cooks_by_itself_is_not_taken_by_the_same_key() -> None:
    table = Table(Script(World(load_task("asynchronous/01"))))
    world, me = table.source.world, table.source.me
    for kind in ("chicken", "stove"):
        thing = next(n for n, p in scene(world.initial).items() if p.thing.kind == kind)
        placed = scene(table.source.state)[thing]
        station = placed.host or thing
        table.press(*[ARROWS[c] for c in way(table.source.state, me, station)], pygame.K_e)
    assert table.press(pygame.K_e)[-1] == "cook"
    done = len(table.source.acted)
    table.source.step_seconds = 0.2
    assert len(table.press(pygame.K_e)) == done
    assert "wait until it is done" in table.overlay().prompt.lower()
    table.source.step_seconds = None  # Nothing goes on before one has decided.
    assert table.press(pygame.K_e)[-1] == "wait"


def test_the_list_has_all_actions_and_digits_pick(table: Table) -> None:
    table.press(pygame.K_TAB)
    choices = table.possible()
    assert set(choices) == set(table.source.state.actions("robot1"))
    assert len(table.overlay().choices) == len(choices)
    rows = table.overlay().choices
    assert len(set(rows)) == len(rows), "no two sound alike"
    assert "Go to the table with the cheese" in rows
    assert rows[-1] == "Wait"
    names = [action.name for action in choices]
    table.press(getattr(pygame, f"K_{names.index('wait') + 1}"))
    assert [a.name for a in table.source.acted] == ["wait"]
    assert table.overlay().choices is None


def test_the_list_by_arrows_and_enter(table: Table) -> None:
    table.press(pygame.K_TAB, pygame.K_DOWN, pygame.K_DOWN, pygame.K_UP)
    wanted = table.possible()[1]
    assert table.overlay().chosen == 1
    assert table.overlay().mark.station == goes_to(wanted), "where it leads is seen"
    table.press(pygame.K_RETURN)
    assert table.source.acted == [wanted]
    table.press(pygame.K_TAB, pygame.K_ESCAPE)
    assert table.overlay().choices is None


def test_the_strip_and_the_list_can_be_clicked(table: Table) -> None:
    def click(key: str) -> None:
        places = table.window._painter._key_strip._places
        area = next(area for area, name in places if name == key)
        pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=area.center, button=1))
        table.window.frame(table.source)

    table.press(*[ARROWS[c] for c in way(table.source.state, "robot1", "table1")])
    walked = len(table.source.acted)
    click("E")
    assert [a.name for a in table.source.acted[walked:]] == ["pick-up-item"]
    click("Tab")
    wanted = table.possible()[1]
    click("2")
    assert table.source.acted[-1] == wanted
    click("H")
    assert table.overlay().help


def test_three_things_wait_and_escape_forgets_them(slow: Table) -> None:
    slow.press(pygame.K_LEFT, pygame.K_e, pygame.K_DOWN, pygame.K_e)
    assert len(slow.source.acted) == 1
    assert slow.overlay().queued == ("E", "Down", "E")
    slow.press(pygame.K_e)
    assert slow.overlay().prompt == "3 things wait already"
    slow.step()
    assert len(slow.source.acted) == 2
    slow.press(pygame.K_ESCAPE)
    slow.step()
    assert slow.overlay().queued == ()
    assert len(slow.source.acted) == 2


def test_what_is_asked_before_the_game_begins_comes_when_it_does(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = table.source.view
    counting = dataclasses.replace(view(), starts_in=2.0)
    monkeypatch.setattr(table.source, "view", lambda: counting)
    table.press(pygame.K_LEFT)
    assert table.source.acted == []
    assert table.overlay().queued == ("Left",)
    monkeypatch.setattr(table.source, "view", view)
    table.window.frame(table.source)
    assert [action.name for action in table.source.acted] == ["move"]


def test_nothing_is_asked_for_while_others_are_waited_for(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    waiting = dataclasses.replace(table.source.view(), lobby=LobbyView((), ready=True))
    monkeypatch.setattr(table.source, "view", lambda: waiting)
    table.press(pygame.K_LEFT)
    assert table.source.acted == []
    assert table.overlay().prompt == "The game has not begun"
    assert table.overlay().mark is None


def test_what_waits_long_is_replaced_by_another_wish(slow: Table) -> None:
    slow.press(pygame.K_LEFT)
    slow.timer.now += 1.0
    slow.press(pygame.K_DOWN)
    assert len(slow.source.acted) == 2


def test_what_is_meant_for_where_one_walks_to_waits_for_the_walk(slow: Table) -> None:
    """However long that is not answered: others decide, or the steps are long."""
    slow.press(pygame.K_LEFT)
    slow.timer.now += 1.0
    slow.press(pygame.K_e)
    assert len(slow.source.acted) == 1
    assert slow.overlay().queued == ("E",)
    slow.step()
    assert len(slow.source.acted) == 2


def test_an_action_is_acknowledged_at_once_and_confirmed(slow: Table) -> None:
    slow.press(pygame.K_LEFT)
    mark = slow.overlay().mark
    assert (mark.station, mark.fate) == (goes_to(slow.source.acted[0]), "asked")
    slow.step()
    assert slow.overlay().mark.fate == "done"
    slow.timer.now += 1.0
    assert slow.overlay().mark is None


def test_a_refusal_marks_the_station_and_forgets_what_waits(slow: Table) -> None:
    slow.press(pygame.K_LEFT, pygame.K_e)
    slow.source.bubbles = (Bubble("robot1", "Needs: something."),)
    slow.window.frame(slow.source)
    assert slow.overlay().mark.fate == "refused"
    assert slow.overlay().queued == ()


def test_the_strip_says_what_the_keys_do_now(table: Table) -> None:
    table.press(*[ARROWS[c] for c in way(table.source.state, "robot1", "table1")])
    assert [key for key, _ in table.overlay().hints] == ["E"]
    table.press(pygame.K_e)
    table.press(*[ARROWS[c] for c in way(table.source.state, "robot1", "board1")])
    ((_, words),) = table.overlay().hints
    assert words.startswith("Put down")


def test_the_strip_says_what_to_do_where_nothing_can_be_done() -> None:
    """With something in hand at a place that is taken."""
    table = Table(Script(World("asynchronous/09")))
    for said in ("move(robot1, table8, table11)", "pick-up-item(", "move(robot1, table11, table2)"):
        actions = table.source.state.actions("robot1")
        table.source.act(next(each for each in actions if str(each).startswith(said)))
    assert table.here() == "table2"
    table.window.frame(table.source)
    said = "There is no room on the table: go to a free place"
    assert table.overlay().hints == (("E", f"Put down the chicken? {said}"),)
    table.window.close()


def test_nobody_walks_while_busy() -> None:
    table = Table(Script(World(load_task("training/01", timing=Timing.PEOPLE))))
    table.press(pygame.K_LEFT, pygame.K_e)
    assert table.overlay().hints == ()
    assert table.overlay().queued == ("E",)
    table.window.close()


def test_keys_can_be_changed_and_none_means_two_things() -> None:
    keys = KeyMap().with_key(Command.USE, "f").with_key(Command.LIST, "a")
    assert keys.command("f") is Command.USE
    assert keys.command("a") is Command.LIST
    assert keys.keys(Command.LEFT) == ()
    assert keys.command("left") is Command.LEFT, "arrows always walk"
    again = KeyMap(keys.changed)
    assert again.changed == keys.changed == {"left": [], "use": ["f"], "list": ["a"]}
    assert KeyMap({"nothing": ["x"], "use": ["return"]}).command("return") is Command.ENTER
    table = Table(Script(World("training/01")), preferences=Preferences(keys=keys.changed))
    table.press(pygame.K_a)
    assert table.overlay().choices
    table.window.close()


def test_help_says_what_the_keys_do_in_this_domain(table: Table) -> None:
    table.press(pygame.K_h)
    rows = dict(table.overlay().help)
    assert rows["E, right click"] == "what is most useful here"
    assert rows["Space"] == "wait"
    assert rows["H"] == "this help"


def test_keys_have_names() -> None:
    assert [key_words(k) for k in ("e", "tab", "space", "f11", "return", "left")] == [
        "E", "Tab", "Space", "F11", "Enter", "Left",
    ]  # fmt: skip


def test_alt_and_enter_fill_the_screen_and_do_not_open_the_chat(table: Table) -> None:
    table.press(pygame.K_RETURN, mod=pygame.KMOD_LALT)
    assert table.window._display.fullscreen
    assert table.overlay().typing is None
    table.press(pygame.K_F11)
    assert not table.window._display.fullscreen
    assert pygame.display.get_surface().get_size() == SIZE


def test_a_mark_may_end_while_a_picture_is_made(slow: Table) -> None:
    slow.press(pygame.K_LEFT)
    slow.step()

    slow.timer.pace = 0.03
    marks = [slow.overlay().mark for _ in range(60)]
    assert marks[0] is not None
    assert marks[-1] is None


def test_what_would_end_work_too_early_says_so() -> None:
    """A pot on the stove: what is in it is in progress, not the pot itself."""
    opened = Table(Script(World("asynchronous/06")))
    try:
        source, me = opened.source, opened.source.me
        for line in load_certificate(source.world.task).plan or ():
            source.act(source.world.parse(source.state, me, line))
            if line.startswith("boil-water"):
                break
        hints = dict(opened.overlay().hints)
        assert hints["E"] == "Wait until it is done"
        assert hints["Click"].endswith("before it is done")
        opened.press(pygame.K_TAB)
        early = [row for row in opened.overlay().choices if row.endswith("before it is done")]
        assert len(early) == 1
    finally:
        opened.window.close()


@pytest.mark.parametrize("goes", [True, False])
def test_a_walk_to_where_somebody_stands_is_tried_again_for_a_moment(goes: bool) -> None:
    world = World("multi_agent/01")
    me, other = world.players
    opened = Table(Script(world, me, slow=True))
    try:
        source, taken = opened.source, scene(world.initial)[other].at
        assert taken is not None
        opened.click(taken)
        assert [goes_to(action) for action in source.acted] == [taken]
        source.bubbles = (Bubble(me, "Somebody stands there."),)
        source._asked = None
        opened.step()
        assert opened.overlay().queued
        if goes:
            away = next(a for a in source.state.actions(other) if goes_to(a))
            source.states.append(source.state.step(away).state)
        else:
            opened.timer.now += 5.0
        opened.window.frame(source)
        opened.window.frame(source)
        assert [goes_to(action) for action in source.acted] == [taken] * (1 + goes)
        opened.step()
        assert not opened.overlay().queued
    finally:
        opened.window.close()


@pytest.fixture
def blocked() -> Iterator[Table]:
    """A walk to where the other player stands was asked for, by `click`, and refused."""
    world = World("multi_agent/01")
    me, other = world.players
    opened = Table(Script(world, me, slow=True))
    taken = scene(world.initial)[other].at
    assert taken is not None
    opened.click(taken)
    refuse(opened)
    yield opened
    opened.window.close()


def refuse(table: Table) -> None:
    """The newest action comes to nothing, and no step is taken."""
    table.source.bubbles = (Bubble(table.source.me, "Somebody stands there."),)
    table.source._asked = None
    table.window.frame(table.source)


def make_way(table: Table) -> str:
    """The other player goes; from where."""
    other, state = table.source.world.players[1], table.source.state
    left = scene(state)[other].at
    assert left is not None
    away = next(a for a in state.actions(other) if goes_to(a))
    table.source.states.append(state.step(away).state)
    table.window.frame(table.source)
    return left


@pytest.mark.parametrize("early", [True, False])
def test_what_is_asked_behind_a_walk_that_is_tried_again_is_done_there(
    blocked: Table, early: bool
) -> None:
    """Also where it was asked before the walk was refused."""
    if early:
        blocked.click(goes_to(blocked.source.acted[0]) or "")
        blocked.press(pygame.K_e)
        refuse(blocked)
    else:
        blocked.press(pygame.K_e)
    walks = len(blocked.source.acted)
    assert blocked.overlay().queued[1:] == ("E",), "not done where one stands"
    there = make_way(blocked)
    blocked.window.frame(blocked.source)
    assert [goes_to(action) for action in blocked.source.acted[walks:]] == [there]
    blocked.step()
    assert blocked.here() == there
    blocked.window.frame(blocked.source)
    assert blocked.overlay().prompt == "Nothing to do at the table", "at the one it came to"


def test_what_is_asked_behind_a_walk_is_given_up_with_it(blocked: Table) -> None:
    blocked.press(pygame.K_e)
    blocked.timer.now += 5.0
    for _ in range(3):
        blocked.window.frame(blocked.source)
    assert len(blocked.source.acted) == 1
    assert blocked.overlay().queued == ()
    assert blocked.overlay().prompt == "", "the walk was explained, once"


@pytest.mark.parametrize("by", ["arrow", "click"])
def test_another_walk_comes_in_place_of_one_that_is_tried_again(blocked: Table, by: str) -> None:
    blocked.press(pygame.K_e)
    if by == "arrow":
        state, me = blocked.source.state, blocked.source.me
        directions = ARROWS.items()
        key = next(k for c, k in directions if towards(state, me, DIRECTIONS[c], scene(state)))
        blocked.press(key)
    else:
        free = next(a for a in blocked.source.state.actions(blocked.source.me) if goes_to(a))
        blocked.click(goes_to(free) or "")
    assert len(blocked.source.acted) == 2
    assert blocked.overlay().queued == (), "what was to be done there is forgotten"


def test_who_waits_does_not_wait_for_a_walk_that_is_tried_again(blocked: Table) -> None:
    assert blocked.press(pygame.K_SPACE)[-1] == "wait"


def test_what_was_refused_is_forgotten_when_something_else_is_asked_for() -> None:
    world = World("multi_agent/01")
    me, other = world.players
    opened = Table(Script(world, me, slow=True))
    try:
        source, taken = opened.source, scene(world.initial)[other].at
        assert taken is not None
        opened.click(taken)
        source.bubbles = (Bubble(me, "Somebody stands there."),)
        source._asked = None
        opened.step()
        assert opened.overlay().queued
        opened.press(pygame.K_ESCAPE)
        assert not opened.overlay().queued
    finally:
        opened.window.close()


def test_a_click_on_oneself_does_not_speak_of_a_place_called_you() -> None:
    world = World("training/01")
    hint = Controls(world).click(world.initial, "robot1", "robot1").hint
    assert "you" not in hint.split()
