"""Lint findings, each in the smallest file that has it."""

import json
from pathlib import Path
from typing import Any

import pytest

from robotouille import GroundAction, World
from robotouille.domain.json_files import read_json
from robotouille.domain.schema import DomainFile
from robotouille.errors import Fault
from robotouille.installation import data_folder
from robotouille.world.lint import MAX_CHECKED, lint_domain, lint_problem_file, lint_task
from tests.support.broken_files import DOMAIN, PROBLEM, build, changed
from tests.world.kitchens import kitchen


def findings(**fields: Any) -> list[str]:
    return [f"{f.severity}: {f}" for f in lint_task(kitchen(**fields).task)]


def term(predicate: str, *pairs: tuple[str, int | str]) -> dict[str, Any]:
    return {
        "predicate": predicate,
        "args": [kind for kind, _ in pairs],
        "ids": [identifier for _, identifier in pairs],
    }


def item(name: str, x: int, y: int = 0, level: int = 0, *predicates: str) -> dict[str, Any]:
    return {"name": name, "x": x, "y": y, "stack-level": level, "predicates": list(predicates)}


def robot(x: int, y: int, direction: list[int] | None = None) -> dict[str, Any]:
    return {"name": "robot", "x": x, "y": y, "direction": direction or [0, -1]}


CLEAR = [term("clear", ("bread", 1))]
BREAD = [item("bread", 1)]
SOUND: dict[str, Any] = {"items": BREAD, "goal": CLEAR}


def test_players_of_larger_teams_are_checked(tmp_path: Path) -> None:
    problem = read_json(data_folder("problems") / "shifts/05_clean_plates.json")
    problem["objects"]["player"][2]["x"] = 3
    path = tmp_path / "kitchen.json"
    path.write_text(json.dumps(problem), encoding="utf-8")
    (fault,) = lint_problem_file(path)
    assert fault.path == "objects.player[2]"
    assert "faces (3, 6), where there is no station" in fault.message
    assert fault.message.endswith("(3 seats)")


def test_valid_problem_has_no_findings() -> None:
    assert findings(**SOUND) == []


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"goal": [term("clear", ("bread", n)) for n in (1, 2)]},
            "error: goal: needs 2 bread, but the problem has 1",
        ),
        (
            {"goal": [term("iscut", ("lettuce", 1))]},
            "error: goal: there is no lettuce, and none can be made",
        ),
        (
            {"goal": [term("iscut", ("bread", 1))]},
            "error: goal[0]: iscut(bread) can never become true in this problem",
        ),
        (
            {"goal": [term("in", ("water", 1), ("pot", 2))]},
            "error: goal: there is no pot, and none can be made",
        ),
        (
            {"goal": [term("iscuttable", ("bread", 1))]},
            "error: goal: no choice of objects can meet all its predicates",
        ),
        (
            {"goal": [*CLEAR, term("item_on", ("cheese", 1), ("table", 2))]},
            "warning: goal[1].args[0]: the object 1 is 'bread' in an earlier term "
            "and 'cheese' here; "
            "the earlier kind is used",
        ),
        (
            {"stations": [{"name": n, "x": 1, "y": 0} for n in ("table", "stove")]},
            "error: objects.station[0]: table1 stands on the same tile (1, 0) as stove1",
        ),
        (
            {"items": [*BREAD, item("bread", 3, 3)]},
            "error: objects.item[1]: bread2 lies on the floor at (3, 3): no station is there",
        ),
        (
            {"containers": [{"name": "pot", "x": 2, "y": 3}]},
            "error: objects.container[0]: pot1 lies on the floor at (2, 3): no station is there",
        ),
        (
            {"items": [*BREAD, item("lettuce", 1)]},
            "error: objects.item[1]: lettuce1 is on the same tile (1, 0) and level as bread1",
        ),
        (
            {"players": [robot(0, 3, [0, 1])]},
            "error: objects.player[0]: robot1 faces (0, 4), where there is no station; "
            "players start at a station",
        ),
        (
            {"players": [robot(1, 0, [1, 0])]},
            "error: objects.player[0]: robot1 stands inside table2 at (1, 0)",
        ),
        (
            {"players": [robot(0, 1), robot(0, 1)]},
            "error: objects.player[1]: robot2 faces the same station as robot1",
        ),
    ],
)
def test_problem_has_finding(fields: dict[str, Any], message: str) -> None:
    assert message in findings(**{**SOUND, **fields})


def test_goal_without_its_tool() -> None:
    fields = {
        "items": [item("lettuce", 0, 0, 0, "iscuttable")],
        "goal": [term("iscut", ("lettuce", 1))],
    }
    assert findings(**fields) == []
    tables = [{"name": "table", "x": x, "y": 0} for x in (0, 1)]
    assert findings(**fields, stations=tables) == [
        "error: goal[0]: iscut(lettuce) can never become true in this problem",
        "error: goal: no choice of objects can meet all its predicates",
    ]


def test_creatable_objects_count() -> None:
    fields = {
        "containers": [{"name": "pot", "x": 0, "y": 0}, {"name": "pot", "x": 1, "y": 0}],
        "goal": [term("in", ("water", n), ("pot", 10 + n)) for n in (1, 2)],
    }
    assert findings(**fields) == []


def test_unreachable_station() -> None:
    walls = [(0, 2), (1, 2), (1, 1)]
    stations = [
        *({"name": "table", "x": x, "y": y} for x, y in walls),
        {"name": "stove", "x": 0, "y": 1},
    ]
    fields = {
        "stations": stations,
        "items": [item("bread", 1, 1)],
        "players": [robot(2, 1, [-1, 0])],
    }
    assert findings(**fields, goal=CLEAR) == []
    corner = [*stations, {"name": "sink", "x": 0, "y": 0}, {"name": "board", "x": 1, "y": 0}]
    found = findings(**{**fields, "stations": corner}, goal=CLEAR)
    assert found == [
        "error: objects.station[4]: sink1 cannot be reached: no walkable tile is next to (0, 0)",
        "error: objects.station[3]: stove1 cannot be reached: no walkable tile is next to (0, 1)",
    ]


# Domains


def domain_findings(*path: Any, to: Any) -> list[Fault]:
    return lint_domain(DomainFile.model_validate(changed(DOMAIN, *path, to=to)))


PRECONS = ("action_defs", 0, "precons")


def test_large_kitchens_are_not_searched_for_minutes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each robot can put any item onto any other one, at any table: 200,000 actions."""
    world = kitchen(
        width=50,
        stations=[{"name": "table", "x": x, "y": 0} for x in range(20)],
        items=[item("bread", x) for x in range(20)] + [item("bread", x, 0, 1) for x in range(14)],
        players=[robot(x, 1) for x in range(4)],
        goal=CLEAR,
    )
    grounded = 0
    ground = World.action

    def counted(self: World, name: str, *arguments: str) -> GroundAction:
        nonlocal grounded
        grounded += 1
        return ground(self, name, *arguments)

    monkeypatch.setattr(World, "action", counted)
    (finding,) = lint_task(world.task)
    assert grounded <= MAX_CHECKED
    assert str(finding) == (
        "goal: too many objects to check whether the goal can be reached: "
        "more than 100,000 possible actions"
    )


def test_valid_domain_has_no_findings() -> None:
    assert lint_domain(DomainFile.model_validate(DOMAIN)) == []
    assert lint_task(build()) == []


def test_contradictory_preconditions() -> None:
    opposite = {"predicate": "at", "params": ["i", "s"], "is_true": False}
    assert [str(f) for f in domain_findings(*PRECONS, 2, to=opposite)] == [
        "action_defs[0]: 'cut' can never apply: it needs 'at' both true and false"
    ]


def test_action_that_is_never_valid() -> None:
    domain = changed(DOMAIN, "predicate_defs", 5, to={"name": "near", "param_types": ["item"] * 2})
    domain = changed(domain, *PRECONS, 2, to={"predicate": "near", "params": ["i", "i"]})
    (fault,) = lint_domain(DomainFile.model_validate(domain))
    assert str(fault) == (
        "action_defs[0].precons[2]: 'cut' can never apply: nothing makes 'near' true"
    )
    assert fault in lint_task(build(domain, PROBLEM))


def test_goal_with_endless_choices_is_refused() -> None:
    """A goal can ask for a closed walk through a grid, for which no fast method is known."""
    domain: dict[str, Any] = {
        "name": "walks",
        "object_types": ["station", "arc", "player"],
        "player_types": ["player"],
        "station_types": ["station"],
        "predicate_defs": [
            {"name": "begins", "param_types": ["arc", "station"]},
            {"name": "ends", "param_types": ["arc", "station"]},
            {"name": "loc", "param_types": ["player", "station"]},
        ],
        "layout": [
            {"predicate": "begins", "when": "shares_tile"},
            {"predicate": "ends", "when": "faces"},
            {"predicate": "loc", "when": "faces"},
        ],
        "action_defs": [
            {
                "name": "move",
                "precons": [{"predicate": "loc", "params": ["p", "a"]}],
                "immediate_fx": [{"predicate": "loc", "params": ["p", "b"]}],
                "language_description": "Move {p} from {a} to {b}",
            }
        ],
    }
    tiles = [(x, y) for x in range(1, 8) for y in range(1, 8) if (x + 2 * y) % 5]
    steps = ((1, 0), (-1, 0), (0, 1), (0, -1))
    arcs = [
        {"name": "arc", "x": x, "y": y, "direction": [dx, dy], "stack-level": level}
        for x, y in tiles
        for level, (dx, dy) in enumerate(steps)
        if (x + dx, y + dy) in tiles
    ]
    length = 38
    goal = [
        term(name, ("arc", 1000 + number), ("tile", (number + shift) % length))
        for number in range(length)
        for name, shift in (("begins", 0), ("ends", 1))
    ]
    problem = {
        "version": "2.0",
        "width": 9,
        "height": 9,
        "objects": {
            "station": [{"name": "tile", "x": x, "y": y} for x, y in tiles],
            "arc": arcs,
            "player": [{"name": "robot", "x": 0, "y": tiles[0][1], "direction": [1, 0]}],
        },
        "goal_description": "Close the walk.",
        "goal": goal,
    }
    found = [str(f) for f in lint_task(build(domain, problem)) if f.path == "goal"]
    assert [words.partition(":")[2][:28] for words in found] == [" the goal is too hard to che"]
