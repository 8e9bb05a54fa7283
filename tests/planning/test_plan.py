"""Bad plan files are refused with the line, what was wrong, and the nearest name."""

from __future__ import annotations

import pytest

from robotouille import FileError, World
from robotouille.planning.plan import read_plan

WORLD = World("synchronous/01")
FIRST = str(WORLD.initial.actions("robot1")[0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mvoe(robot1, table1, table2)", "did you mean 'move'"),
        ("move(robot1, table1)", "takes"),
        ("move(robot1, tabel1, table2)", "did you mean 'table1'"),
        ("move(table1, table1, table2)", "is a station"),
        ("move robot1 table1 table2", "expected an action like"),
        (f"{FIRST}\n\n{FIRST}; jump()", "line 3"),
        ("# task: synchronous/02_lettuce_sandwich@1\n-", "synchronous/02"),
    ],
)
def test_what_is_wrong_is_named(text: str, words: str) -> None:
    with pytest.raises(FileError) as error:
        read_plan(text, WORLD, "my.plan")
    assert words in str(error.value)
    assert "my.plan" in str(error.value)


def test_a_dash_is_a_step_in_which_nobody_acts() -> None:
    plan = read_plan(f"-\n{FIRST}\n-\n", WORLD)
    assert [len(step) for step in plan] == [0, 1, 0]
