"""Wrong arguments raise errors of one family, with suggestions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import robotouille
from robotouille import RobotouilleError, UnknownNameError, WrongArgumentError, WrongWorldError
from robotouille.world.world import World

WORLD = World("multi_agent/01@2")
STATE = WORLD.initial
SYNCHRONOUS = World("synchronous/01")
ELSEWHERE = SYNCHRONOUS.action("move", "robot1", "table3", "table1")
HERE = STATE.actions("robot1")[0]
ROW = ("cook", 0, ("patty1", "stove1"), (0, 0))

NAMES: list[tuple[Callable[[], Any], str]] = [
    (lambda: STATE.step("Move robot1 from table2 to tabel1"), "did you mean 'Move robot1 from"),
    (lambda: STATE.step([None, "Dance"]), "no valid action 'Dance'"),
    (lambda: STATE.step({"robot3": HERE}), "no player 'robot3'; did you mean 'robot"),
    (lambda: STATE.step({"robot2": HERE.sentence}), "no valid action"),
    (lambda: WORLD.parse(STATE, "robot1", "Dance"), "no valid action 'Dance'"),
    (lambda: WORLD.parse(STATE, "robot9", "Dance"), "no player 'robot9'"),
    (lambda: STATE.actions("robt1"), "no player 'robt1'; did you mean 'robot1'"),
    (lambda: STATE.actions("bob"), "no player 'bob'; players: robot1, robot2"),
    (lambda: STATE.step("jump"), f"no valid action 'jump'; valid are '{HERE.sentence}', .* more"),
    (lambda: STATE.actions(["robot1"]), "no player"),
    (lambda: STATE.actions(1), "no player 1"),
    (lambda: STATE.text("robt1"), "did you mean 'robot1'"),
    (lambda: STATE.holds("lok", "robot1", "table1"), "no predicate .lok.; did you mean .loc."),
    (lambda: WORLD.thing("tabel1"), "no object 'tabel1'; did you mean 'table1'"),
    (lambda: WORLD.thing(3), "no object 3"),
    (lambda: WORLD.action("mov"), "no action 'mov'; did you mean 'move'"),
    (lambda: WORLD.action(["move"]), "no action"),
    (lambda: WORLD.action("move", "robot1"), "takes .*found 1"),
    (lambda: WORLD.action("move", "robot1", "table1", ["table2"]), "no object"),
    (lambda: WORLD.action("move", "robot1", "table1", "lettuce1"), "'lettuce1' is an item"),
    (lambda: WORLD.admit([3]), "no object 3"),
    (lambda: WORLD.restore(0, [("dance", *ROW[1:])]), "no action 'dance'"),
    (lambda: WORLD.restore(0, [("cook", 0, ("patty1", "oven1"), (0, 0))]), "no object 'oven1'"),
    (lambda: WORLD.restore(0, [("cook", 0, ("patty1", "patty1"), (0, 0))]), "'cook.0' takes a st"),
]

ARGUMENTS: list[tuple[Callable[[], Any], str]] = [
    (lambda: STATE.step(3), "expected an action .*found 3"),
    (lambda: STATE.step([3]), "expected an action .*found 3"),
    (lambda: STATE.step({"robot1": 3}), "expected an action .*found 3"),
    (lambda: STATE.step([HERE, object()]), "expected an action .*found <object"),
    (lambda: WORLD.parse(STATE, "robot1", 3), "sentence of an action, found 3"),
    (lambda: WORLD.successor(STATE, "move"), "expected an action.*found 'move'"),
    (lambda: WORLD.applicable(STATE, None), "expected an action.*found None"),
    (lambda: WORLD.unmet(STATE, 7), "expected an action.*found 7"),
    (lambda: STATE.holds("loc", "robot1"), "loc takes 2 names"),
    (lambda: STATE.holds("loc", ["robot1"]), "expected names"),
    (lambda: WORLD.restore("facts", []), "as an integer, found 'facts'"),
    (lambda: WORLD.restore(0, 3), "rows of a state's timers"),
    (lambda: WORLD.restore(0, [3]), "rows of a state's timers"),
    (lambda: WORLD.restore(0, [], 3), "rows of a state's timers"),
    (lambda: World(3), "name of a task or a path, found 3"),
    (lambda: robotouille.load_task(None), "name of a task or a path, found None"),
    (lambda: robotouille.load_task("synchronous/01", domain=3), "expected a domain.*found 3"),
    (lambda: robotouille.load_task("synchronous/01", seed="x"), "integer as seed"),
]

FOREIGN: list[tuple[Callable[[], Any], str]] = [
    (lambda: STATE.step(ELSEWHERE), "another task, synchronous/01.*world.action"),
    (lambda: WORLD.step(SYNCHRONOUS.initial, []), "another task, synchronous/01"),
    (lambda: WORLD.restore(-1, []), "another world"),
    (lambda: WORLD.restore(1 << 10_000, []), "another world"),
    (lambda: WORLD.restore(0, [("cook", 99, *ROW[2:])]), "effects, found number 99"),
    (lambda: WORLD.restore(0, [("cook", 0, ("patty1",), (0, 0))]), "takes"),
    (lambda: WORLD.restore(0, [ROW[:3]]), "rows of 4 values"),
    (lambda: WORLD.restore(0, [], [("robot1",)]), "rows of 2 values"),
    (lambda: WORLD.admit(["water501"]), "limit of 500 objects"),
]

TASKS = [
    lambda: robotouille.load_task("synchronous/01", seats="two"),
    lambda: robotouille.load_task("synchronous/01", timing=[]),
    lambda: robotouille.load_task("synchronous/01", domain="nowhere"),
]


@pytest.mark.parametrize(("call", "said"), NAMES)
def test_unknown_names_raise(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(UnknownNameError, match=said) as error:
        call()
    assert isinstance(error.value, RobotouilleError)
    assert isinstance(error.value, KeyError)


@pytest.mark.parametrize(("call", "said"), ARGUMENTS)
def test_wrong_arguments_raise(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(WrongArgumentError, match=said) as error:
        call()
    assert isinstance(error.value, RobotouilleError)
    assert isinstance(error.value, TypeError)


@pytest.mark.parametrize(("call", "said"), FOREIGN)
def test_values_of_another_world_raise(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(WrongWorldError, match=said) as error:
        call()
    assert isinstance(error.value, RobotouilleError)
    assert isinstance(error.value, ValueError)


@pytest.mark.parametrize("call", TASKS)
def test_unknown_tasks_raise(call: Callable[[], Any]) -> None:
    with pytest.raises(RobotouilleError):
        call()


def test_errors_change_nothing() -> None:
    world = World("asynchronous/06")
    before = (world.table_sizes, world.initial.digest)
    for call in (lambda: world.initial.step([3]), lambda: world.admit(["water501"])):
        with pytest.raises(RobotouilleError):
            call()
    assert (world.table_sizes, world.initial.digest) == before
