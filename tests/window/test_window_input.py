"""Keyboard and mouse control: walking, the use key, the action list and the queue."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pygame
import pytest
from tests.support.samples import quick_sample_of_pairs
from tests.support.scripted import BOILING
from tests.support.window_play import (
    ARROWS,
    SIZE,
    Script,
    Timer,
    click,
    goes_to,
    headless_window,
    press,
    way,
)

from robotouille import GroundAction, State, Timing, World, load_task, task_names
from robotouille.certification.certificate import load_certificate
from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.rendering import rendering_of
from robotouille.domain.schema import InputFile
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.presentation.work import work_in_progress
from robotouille.world.scene import scene
from robotouille_client.window.drawing.window_layout import ActionMark
from robotouille_client.window.input.action_queue import (
    CHANGED,
    GUARD_SECONDS,
    PATIENCE_SECONDS,
    QUICK_SECONDS,
    STILL_OCCUPIED,
    UNREACHED,
)
from robotouille_client.window.input.commands import DIRECTIONS, Command, KeyMap
from robotouille_client.window.input.controls import Controls, possible, towards
from robotouille_client.window.input.input_controller import CONFIRM_SECONDS
from robotouille_client.window.input.play_input import READ_SECONDS
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import Bubble, LobbyView, PauseView


class Table:
    """Window with a game and a manual clock."""

    def __init__(self, source: Script, **options: object) -> None:
        self.timer = Timer()
        self.source = source
        self.window = headless_window(SIZE, clock=self.timer, **options)
        self.window.frame(source)

    def press(self, *keys: int, mod: int = 0) -> list[str]:
        press(self.window, self.source, *keys, mod=mod)
        return [action.name for action in self.source.acted]

    def click(self, station: str, button: int = 1) -> None:
        click(self.window, self.source, station, button)

    def overlay(self):
        return self.window.overlay(self.source.view())

    def possible(self) -> tuple[GroundAction, ...]:
        """Return the actions of the list, in its order."""
        return possible(self.source.state, self.source.me)

    def here(self) -> str | None:
        return scene(self.source.state)[self.source.me].at

    def step(self) -> None:
        self.source.step()
        self.window.frame(self.source)


@pytest.fixture
def table() -> Table:
    return Table(Script(World("training/01")))


@pytest.fixture
def slow() -> Table:
    return Table(Script(World("training/01"), slow=True))


@pytest.mark.parametrize(
    ("task", "device"), quick_sample_of_pairs(["training/01", "synchronous/01"], ["mouse", "keys"])
)
def test_a_whole_task_by_one_device(task: str, device: str) -> None:
    table = Table(Script(World(task)))
    for line in load_certificate(load_task(task)).plan or ():
        action = table.source.world.parse(table.source.state, table.source.me, line)
        station = goes_to(action)
        before = len(table.source.acted)
        table.timer.now += GUARD_SECONDS
        if device == "mouse":
            table.click(station or table.here() or "", 1 if station else 3)
        elif station is None:
            table.press(pygame.K_e)
        else:
            table.press(*[ARROWS[c] for c in way(table.source.state, table.source.me, station)])
        if station is None:
            assert [str(a) for a in table.source.acted[before:]] == [str(action)]
        else:
            assert table.here() == station
    assert table.source.finished


@pytest.mark.slow
def test_the_arrows_reach_every_station_of_every_task() -> None:
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


def test_a_direction_leads_ahead_and_not_around_the_corner() -> None:
    state = World("multi_agent/01").initial
    for key, station in ((Command.RIGHT, "table7"), (Command.UP, "stove1")):
        action = towards(state, "robot2", [DIRECTIONS[key]], scene(state))
        assert action is not None
        assert (scene(state)["robot2"].at, action.destination) == ("table1", station)


def test_directions_pressed_during_a_walk_become_one_walk_without_stops() -> None:
    table = Table(Script(World("multi_agent/01"), slow=True))
    assert table.here() == "table2"
    table.press(pygame.K_RIGHT)
    for key in (pygame.K_RIGHT, pygame.K_RIGHT, pygame.K_UP):
        table.press(key)
    assert table.overlay().queued == ("Right Right Up",)
    while table.overlay().queued or table.source.state.busy_steps(table.source.me):
        table.step()
    table.step()
    assert [action.destination for action in table.source.acted] == ["table3", "table6"]


def test_a_notice_without_a_station_that_way(table: Table) -> None:
    assert table.press(pygame.K_RIGHT) == []
    assert table.overlay().prompt == "There is no free station that way"
    assert ("H", "help") in table.overlay().keys, "help stays findable"


def test_bindings_of_the_domain_come_first() -> None:
    world = World("training/01")
    bound = bindings_of(world.task).model_dump()
    bound["keyboard_actions"][-1]["input_instructions"]["key"] = "d"
    look = KitchenLook(rendering_of(world.task), InputFile.model_validate(bound), Path())
    table = Table(Script(world), look=look)
    assert table.press(pygame.K_d) == ["wait"]
    assert table.press(pygame.K_a, pygame.K_RIGHT)[-1] == "move"
    assert ("Arrows", "walk") in table.overlay().keys


def test_a_held_key_keeps_walking(table: Table) -> None:
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


def test_one_press_too_many_does_not_undo_the_work() -> None:
    table = Table(Script(World("training/01")))
    for line in load_certificate("training/01").plan or ():
        action = table.source.world.parse(table.source.state, table.source.me, line)
        if (station := goes_to(action)) is not None:
            table.click(station)
            continue
        before = list(table.press(pygame.K_e))
        assert before[-1] == action.name
        if before.count("cut") == 3:
            break
    assert table.press(pygame.K_e) == before, "the tomato stays on the board"
    assert "wait a second" in table.overlay().prompt
    table.timer.now += QUICK_SECONDS
    assert table.press(pygame.K_e) == [*before, "pick-up-item"], "the work is done, so take it"
    assert len(table.press(pygame.K_e)) == len(before) + 1, "nor is it put back at once"
    table.timer.now += GUARD_SECONDS
    assert table.press(pygame.K_e)[-1] == "pick-up-item", "nothing is left to do with it there"
    for action in ("place-item", "pick-up-item"):
        table.click(table.here() or "")
        assert table.press()[-1] == action, "a click is not guarded"


def test_a_single_press_takes_no_dish_apart() -> None:
    table = Table(Script(World("synchronous/01")))
    for line in load_certificate("synchronous/01").plan or ():
        action = table.source.world.parse(table.source.state, table.source.me, line)
        table.click(goes_to(action) or table.here() or "")
        if action.name == "stack":
            break
    dish, built = table.here() or "", len(table.source.acted)
    table.timer.now += 10.0
    assert len(table.press(pygame.K_e)) == built, "the cheese stays on the bread"
    assert "press again to take it off" in table.overlay().prompt
    table.timer.now += CONFIRM_SECONDS
    assert len(table.press(pygame.K_e)) == built, "the first press was too long ago"
    table.timer.now += QUICK_SECONDS
    assert table.press(pygame.K_e)[built:] == ["unstack"]
    table.timer.now += 10.0
    assert table.press(pygame.K_e)[-1] == "stack"
    table.timer.now += 10.0
    table.click(dish)
    assert table.press()[-1] == "unstack", "a click needs no second one"


def test_what_was_filled_can_be_taken_up_at_once() -> None:
    table = Table(Script(World("asynchronous/07")))
    plan = load_certificate("asynchronous/07").plan or ()
    added = next(number for number, line in enumerate(plan) if line.startswith("add-to"))
    for line in plan[: added + 1]:
        state, me = table.source.state, table.source.me
        action = table.source.world.parse(state, me, line)
        table.source.states.append(state.step(action).state)
        while table.source.state.busy_steps(me):
            table.source.states.append(table.source.state.step([]).state)
    before = table.source.states[-2]
    table.source.states[-1:] = []
    assert table.source.state == before
    assert table.press(pygame.K_e) == ["add-to"]
    table.timer.now += QUICK_SECONDS
    assert table.press(pygame.K_e) == ["add-to", "pick-up-container"], "that undoes nothing"


def test_a_notice_goes_soon_after_an_input_that_works() -> None:
    table = Table(Script(World("synchronous/01")))
    assert table.press(pygame.K_e) == []
    assert table.overlay().prompt
    table.press(pygame.K_RIGHT)
    assert table.overlay().prompt, "the player may read it while walking"
    table.timer.now += READ_SECONDS
    assert not table.overlay().prompt


def test_the_use_key_does_not_interrupt_cooking() -> None:
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


def test_the_list_has_all_actions_and_digits_pick_one(table: Table) -> None:
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


def test_an_action_chosen_twice_is_done_once(slow: Table) -> None:
    slow.press(pygame.K_UP)
    slow.step()
    slow.timer.now += 1.0
    for _ in range(2):
        slow.press(pygame.K_TAB, pygame.K_1)
        assert slow.overlay().queued == ()
    slow.step()
    slow.window.frame(slow.source)
    assert [action.name for action in slow.source.acted] == ["move", "pick-up-item"]


def test_the_list_by_arrows_and_enter(table: Table) -> None:
    table.press(pygame.K_TAB, pygame.K_DOWN, pygame.K_DOWN, pygame.K_UP)
    wanted = table.possible()[1]
    assert table.overlay().chosen == 1
    assert table.overlay().marks[0].station == goes_to(wanted), "where it leads is seen"
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


def test_three_actions_queue_and_escape_clears_them(slow: Table) -> None:
    slow.press(pygame.K_LEFT, pygame.K_e, pygame.K_DOWN, pygame.K_e)
    assert len(slow.source.acted) == 1
    assert slow.overlay().queued == ("E", "Down", "E")
    slow.press(pygame.K_e)
    assert slow.overlay().prompt == "3 actions are queued already"
    slow.step()
    assert len(slow.source.acted) == 2
    slow.press(pygame.K_ESCAPE)
    slow.step()
    assert slow.overlay().queued == ()
    assert len(slow.source.acted) == 2


def test_actions_before_the_start_run_at_the_start(
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


def test_no_actions_in_the_lobby(table: Table, monkeypatch: pytest.MonkeyPatch) -> None:
    waiting = dataclasses.replace(table.source.view(), lobby=LobbyView((), ready=True))
    monkeypatch.setattr(table.source, "view", lambda: waiting)
    table.press(pygame.K_LEFT)
    assert table.source.acted == []
    assert table.overlay().prompt == "The game hasn't started yet"
    assert table.overlay().marks == ()


def test_a_slow_action_is_replaced_by_the_next(slow: Table) -> None:
    slow.press(pygame.K_LEFT)
    slow.timer.now += 1.0
    slow.press(pygame.K_DOWN)
    assert len(slow.source.acted) == 2


def test_an_action_after_a_walk_waits_for_it(slow: Table) -> None:
    slow.press(pygame.K_LEFT)
    slow.timer.now += 1.0
    slow.press(pygame.K_e)
    assert len(slow.source.acted) == 1
    assert slow.overlay().queued == ("E",)
    slow.step()
    assert len(slow.source.acted) == 2


def test_an_action_is_marked_at_once_and_confirmed(slow: Table) -> None:
    slow.press(pygame.K_LEFT)
    (mark,) = slow.overlay().marks
    assert (mark.station, mark.fate) == (goes_to(slow.source.acted[0]), "asked")
    slow.step()
    assert slow.overlay().marks[0].fate == "done"
    slow.timer.now += 1.0
    assert slow.overlay().marks == ()


def test_a_rejection_marks_the_station_and_clears_the_queue(slow: Table) -> None:
    slow.press(pygame.K_LEFT, pygame.K_e)
    slow.source.bubbles = (Bubble("robot1", "Needs: something."),)
    slow.window.frame(slow.source)
    assert slow.overlay().marks[0].fate == "rejected"
    assert slow.overlay().queued == ()


def test_the_strip_shows_the_keys(table: Table) -> None:
    table.press(*[ARROWS[c] for c in way(table.source.state, "robot1", "table1")])
    assert [key for key, _ in table.overlay().hints] == ["E"]
    table.press(pygame.K_e)
    table.press(*[ARROWS[c] for c in way(table.source.state, "robot1", "board1")])
    (_, why), (key, words) = table.overlay().hints
    assert "cannot be cut" in why
    assert (key, words.partition(" the ")[0]) == ("Click", "Put down")


def test_no_walk_while_busy() -> None:
    table = Table(Script(World(load_task("training/01", timing=Timing.PEOPLE))))
    table.press(pygame.K_LEFT, pygame.K_e)
    assert table.overlay().hints == ()
    assert table.overlay().queued == ("E",)


def test_changed_keys_have_one_command_each() -> None:
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


def test_alt_enter_does_not_open_the_chat(table: Table) -> None:
    table.press(pygame.K_RETURN, mod=pygame.KMOD_LALT)
    assert table.window._display.fullscreen
    assert table.overlay().typing is None
    table.press(pygame.K_F11)
    assert not table.window._display.fullscreen
    assert pygame.display.get_surface().get_size() == SIZE


@pytest.fixture
def team() -> Table:
    return Table(Script(World("multi_agent/02@3")))


def test_signals_point_at_what_is_under_the_mouse(team: Table) -> None:
    team.click("stove1", 2)
    team.press(pygame.K_1, pygame.K_2, pygame.K_3, pygame.K_4, pygame.K_5)
    assert team.source.signals == [
        Signal(Intent.LOOK, "stove1"),
        Signal(Intent.NEED, "stove1"),
        Signal(Intent.YOURS, "stove1"),
        Signal(Intent.LOOK, "stove1"),
        Signal(Intent.WAIT),
        Signal(Intent.THANKS),
    ]


def test_a_signal_at_a_table_means_what_lies_on_it(team: Table) -> None:
    placed = scene(team.source.state)
    table, item = next(
        (each.host, name) for name, each in placed.items()
        if each.host in team.source.world.floor.plain and each.level == 0
        and not any(other.host == each.host and other.level > 0 for other in placed.values())
    )  # fmt: skip
    team.click(table or "", 2)
    assert team.source.signals == [Signal(Intent.LOOK, item)]


def test_signals_without_a_mouse_are_about_the_own_place(team: Table) -> None:
    team.press(pygame.K_2)
    assert team.source.signals == [Signal(Intent.YOURS, team.here() or "")]
    team.press(pygame.K_1)
    assert team.overlay().prompt == "Point at what you need, then press the key again"
    # A player whose way is blocked means the blocked station.
    team.source.blocked = ((team.source.me, "stove1", "robot2"),)
    team.press(pygame.K_1)
    assert team.source.signals[1:] == [Signal(Intent.NEED, "stove1")]


@pytest.mark.parametrize(
    ("button", "intent"),
    [
        (pygame.CONTROLLER_BUTTON_LEFTSHOULDER, Intent.YOURS),
        (pygame.CONTROLLER_BUTTON_BACK, Intent.LOOK),
        (pygame.CONTROLLER_BUTTON_LEFTSTICK, Intent.WAIT),
        (pygame.CONTROLLER_BUTTON_RIGHTSTICK, Intent.THANKS),
    ],
)
def test_a_gamepad_sends_signals(team: Table, button: int, intent: Intent) -> None:
    pygame.event.post(pygame.Event(pygame.CONTROLLERBUTTONDOWN, button=button, instance_id=0))
    team.window.frame(team.source)
    assert [signal.intent for signal in team.source.signals] == [intent]


def test_nobody_signals_alone(table: Table) -> None:
    table.press(pygame.K_1, pygame.K_4)
    assert table.source.signals == []


def test_a_mark_may_expire_during_a_frame(slow: Table) -> None:
    slow.press(pygame.K_LEFT)
    slow.step()

    slow.timer.pace = 0.03
    marks = [slow.overlay().marks for _ in range(60)]
    assert marks[0]
    assert not marks[-1]


def test_a_hint_warns_before_interrupting_work() -> None:
    opened = Table(Script(World("asynchronous/06")))
    source, me = opened.source, opened.source.me
    for line in load_certificate(source.world.task).plan or ():
        source.act(source.world.parse(source.state, me, line))
        if line.startswith("boil-water"):
            break
    hints = dict(opened.overlay().hints)
    assert hints["E"] == "Wait until it is done"
    assert hints["Click"].endswith("before it is done")
    opened.press(pygame.K_TAB)
    rows = opened.overlay().choices
    assert sum(row.endswith("before it is done") for row in rows) == 1


@pytest.mark.parametrize("goes", [True, False])
def test_a_walk_to_an_occupied_station_is_retried(blocked: Table, goes: bool) -> None:
    assert blocked.overlay().queued
    taken = goes_to(blocked.source.acted[0])
    if goes:
        make_way(blocked)
    else:
        blocked.timer.now += PATIENCE_SECONDS + 1.0
    for _ in range(2):
        blocked.window.frame(blocked.source)
    assert [goes_to(action) for action in blocked.source.acted] == [taken] * (1 + goes)
    blocked.step()
    assert not blocked.overlay().queued


def test_a_walk_waits_for_another_player_to_finish_visibly(blocked: Table) -> None:
    taken = goes_to(blocked.source.acted[0]) or ""
    # Another player takes this long to cut something and to leave.
    for _ in range(50):
        blocked.timer.now += 0.1
        blocked.window.frame(blocked.source)
    assert blocked.overlay().marks == (ActionMark(taken, "asked"),)
    (label,) = blocked.overlay().queued
    assert label.endswith("(occupied)")
    make_way(blocked)
    blocked.window.frame(blocked.source)
    blocked.step()
    assert blocked.here() == taken


def test_a_press_for_the_end_of_a_failed_walk_confirms_nothing() -> None:
    table = Table(Script(World("synchronous/01"), slow=True))

    def settle() -> None:
        for _ in range(8):
            table.step()
        table.timer.now += 10.0
        table.window.frame(table.source)

    for line in load_certificate("synchronous/01").plan or ():
        action = table.source.world.parse(table.source.state, table.source.me, line)
        table.click(goes_to(action) or table.here() or "")
        settle()
        if action.name == "stack":
            break
    dish = table.here() or ""
    table.click(next(filter(None, map(goes_to, table.source.state.actions(table.source.me)))))
    settle()
    table.click(dish)
    table.press(pygame.K_e)
    reject(table)
    table.timer.now += 1.2
    table.window.frame(table.source)
    table.click(dish)
    while table.here() != dish:
        table.step()
    table.timer.now += 0.5
    table.window.frame(table.source)
    before = len(table.source.acted)
    table.press(pygame.K_e)
    assert len(table.source.acted) == before, "no earlier press was declined"
    assert "press again to take it off" in table.overlay().prompt


def test_a_walk_that_gives_up_says_so(blocked: Table) -> None:
    blocked.timer.now += PATIENCE_SECONDS + 0.1
    blocked.window.frame(blocked.source)
    assert blocked.overlay().prompt == STILL_OCCUPIED
    assert blocked.overlay().queued == ()
    assert blocked.overlay().marks == ()


def test_news_waits_until_the_last_notice_has_been_read(blocked: Table) -> None:
    blocked.timer.now += PATIENCE_SECONDS - 0.1
    pygame.event.post(pygame.Event(pygame.WINDOWLEAVE))
    blocked.press(pygame.K_1)
    asked = blocked.overlay().prompt
    assert asked.startswith("Point at what you need")
    blocked.timer.now += 0.2
    blocked.window.frame(blocked.source)
    assert blocked.overlay().prompt == asked
    blocked.timer.now += READ_SECONDS
    blocked.window.frame(blocked.source)
    assert blocked.overlay().prompt == STILL_OCCUPIED


def test_escape_forgets_a_rejected_walk(blocked: Table) -> None:
    blocked.press(pygame.K_ESCAPE)
    assert not blocked.overlay().queued


@pytest.fixture
def blocked() -> Table:
    """Ask with `click` for a walk to the other player's station, and have it rejected."""
    world = World("multi_agent/01")
    me, other = world.players
    opened = Table(Script(world, me, slow=True))
    taken = scene(world.initial)[other].at
    opened.click(taken)
    reject(opened)
    return opened


def reject(table: Table) -> None:
    """Reject the last action without a step."""
    table.source.bubbles = (Bubble(table.source.me, "Somebody stands there."),)
    table.source._asked = None
    table.window.frame(table.source)


def make_way(table: Table) -> str:
    """Move the other player away; return where they were."""
    other, state = table.source.world.players[1], table.source.state
    left = scene(state)[other].at
    assert left is not None
    away = next(a for a in state.actions(other) if goes_to(a))
    table.source.states.append(state.step(away).state)
    table.window.frame(table.source)
    return left


@pytest.mark.parametrize("early", [True, False])
def test_actions_queued_after_a_retried_walk_run_there(blocked: Table, early: bool) -> None:
    if early:
        blocked.click(goes_to(blocked.source.acted[0]) or "")
        blocked.press(pygame.K_e)
        reject(blocked)
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


def test_actions_queued_after_a_walk_are_dropped_with_it(blocked: Table) -> None:
    blocked.press(pygame.K_e)
    blocked.timer.now += PATIENCE_SECONDS + 1.0
    for _ in range(3):
        blocked.window.frame(blocked.source)
    assert len(blocked.source.acted) == 1
    assert blocked.overlay().queued == ()
    assert blocked.overlay().prompt == UNREACHED
    blocked.press(pygame.K_e)
    assert len(blocked.source.acted) == 1, "a late press does nothing where the player stands"
    blocked.timer.now += GUARD_SECONDS + 0.1
    blocked.press(pygame.K_e)
    assert len(blocked.source.acted) == 2


def test_the_news_of_a_failed_walk_ends_with_the_next_input(blocked: Table) -> None:
    blocked.press(pygame.K_e)
    blocked.timer.now += PATIENCE_SECONDS + 1.0
    for _ in range(3):
        blocked.window.frame(blocked.source)
    assert blocked.overlay().prompt == UNREACHED
    free = next(a for a in blocked.source.state.actions(blocked.source.me) if goes_to(a))
    blocked.click(goes_to(free) or "")
    assert len(blocked.source.acted) == 2
    assert blocked.overlay().prompt == ""


def test_a_pause_does_not_use_up_the_patience(
    blocked: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = blocked.source.view
    paused = dataclasses.replace(view(), pause=PauseView("Paused", "Take your time."))
    blocked.press(pygame.K_e)
    monkeypatch.setattr(blocked.source, "view", lambda: paused)
    for _ in range(3):
        blocked.timer.now += PATIENCE_SECONDS
        blocked.window.frame(blocked.source)
    monkeypatch.setattr(blocked.source, "view", view)
    blocked.timer.now += PATIENCE_SECONDS - 1.0
    blocked.window.frame(blocked.source)
    assert blocked.overlay().queued[1:] == ("E",)
    assert blocked.overlay().prompt != UNREACHED


@pytest.mark.parametrize(
    ("before", "meanwhile", "done"),
    [
        (("me", "pick-up-item", "patty1"), ("other", "pick-up-item", "table6"), None),
        (("me", "pick-up-item", "patty1"), None, "stack"),
        (("other", "stack", "patty1"), ("other", "unstack", "patty1"), None),
    ],
    ids=["stack on what is gone", "stack", "take what is gone off a dish"],
)
def test_a_waiting_key_does_only_what_it_meant(
    before: tuple[str, str, str], meanwhile: tuple[str, str, str] | None, done: str | None
) -> None:
    world = World("multi_agent/01")
    me, other = world.players
    table = Table(Script(world, me, slow=True))

    def act(who: str, name: str, thing: str) -> None:
        state = table.source.state
        actions = state.actions(me if who == "me" else other)
        named = (a for a in actions if a.name == name and thing in a.arguments)
        table.source.states.append(state.step(next(named)).state)
        table.window.frame(table.source)

    if before[0] == "other":
        act("other", "move", "table4")
        act("other", "pick-up-item", "patty1")
        act("other", "move", "table6")
        act(*before)
    else:
        act("me", "move", "table4")
        act(*before)
        act("other", "move", "table6")
    table.click("table6")
    reject(table)
    table.timer.now += 1.0
    table.press(pygame.K_e)
    if meanwhile is not None:
        act(*meanwhile)
    act("other", "move", "table7")
    table.window.frame(table.source)
    table.step()
    assert table.here() == "table6"
    table.window.frame(table.source)
    assert [action.name for action in table.source.acted[2:]] == ([done] if done else [])
    assert table.overlay().prompt == ("" if done else CHANGED.format("E"))


def test_an_action_after_a_walk_that_lost_a_race_waits_for_it() -> None:
    world = World("multi_agent/01")
    me, other = world.players
    table = Table(Script(world, me, slow=True))
    station = contested(world.initial, me, other)
    table.click(station)
    walk = next(a for a in world.initial.actions(other) if goes_to(a) == station)
    table.source.states.append(world.initial.step(walk).state)
    table.window.frame(table.source)
    table.press(pygame.K_e)
    assert [goes_to(action) for action in table.source.acted] == [station]
    assert table.overlay().queued[1:] == ("E",)
    while table.source.state.busy_steps(other):
        table.step()
    make_way(table)
    table.window.frame(table.source)
    table.step()
    assert table.here() == station


def test_an_action_waits_for_a_queued_walk_to_an_occupied_station() -> None:
    world = World("multi_agent/01")
    me, other = world.players
    table = Table(Script(world, me, slow=True))
    taken = scene(world.initial)[other].at or ""
    table.click(contested(world.initial, me, other))
    table.click(taken)
    table.press(pygame.K_e)
    table.step()
    while table.source.state.busy_steps(me):
        table.step()
    assert goes_to(table.source.acted[-1]) == taken
    reject(table)
    assert table.overlay().queued[1:] == ("E",), "E is meant for the occupied station"


def test_a_walk_is_retried_if_the_station_became_free_in_the_meantime(blocked: Table) -> None:
    blocked.press(pygame.K_ESCAPE)
    taken = goes_to(blocked.source.acted[0]) or ""
    blocked.click(taken)
    blocked.press(pygame.K_e)
    left = next(a for a in blocked.source.state.actions(blocked.source.world.players[1]))
    assert goes_to(left)
    blocked.source.states.append(blocked.source.state.step(left).state)
    reject(blocked)
    blocked.window.frame(blocked.source)
    blocked.step()
    assert blocked.here() == taken


def contested(state: State, me: str, other: str) -> str:
    """Return a free station to which both players can walk."""
    reached = [{goes_to(a) for a in state.actions(player)} for player in (me, other)]
    return min(name for name in reached[0] & reached[1] if name)


@pytest.mark.parametrize("by", ["arrow", "click"])
def test_another_walk_replaces_a_retried_one(blocked: Table, by: str) -> None:
    blocked.press(pygame.K_e)
    if by == "arrow":
        state, me = blocked.source.state, blocked.source.me
        directions = ARROWS.items()
        key = next(k for c, k in directions if towards(state, me, [DIRECTIONS[c]], scene(state)))
        blocked.press(key)
    else:
        free = next(a for a in blocked.source.state.actions(blocked.source.me) if goes_to(a))
        blocked.click(goes_to(free) or "")
    assert len(blocked.source.acted) == 2
    assert blocked.overlay().queued == (), "what was to be done there is forgotten"


def test_actions_here_do_not_wait_for_a_retried_walk(blocked: Table) -> None:
    assert blocked.press(pygame.K_SPACE)[-1] == "wait"


def test_a_click_where_the_player_stands_adds_to_a_boiling_pot() -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    state, me = world.initial, world.players[0]
    for line in (*BOILING, "move table9", "pick-up-item tomato1", "move stove1"):
        while line != "-" and (state.busy_steps(me) or _is_filling(state)):
            state = state.step([]).state
        word, *arguments = line.split()
        actions = [a for a in state.actions(me) if a.name == word]
        state = state.step([a for a in actions if {*arguments} <= {*a.arguments}][:1]).state
    while state.busy_steps(me):
        state = state.step([]).state
    assert work_in_progress(state)
    resolved = Controls(state.world).click(state, me, scene(state)[me].at or "")
    assert resolved.valid
    assert resolved.action is not None
    assert resolved.action.name == "add-to"


def _is_filling(state: State) -> bool:
    return any(row.action == "fill-pot" for row in work_in_progress(state))
