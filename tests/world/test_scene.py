"""Places in a scene: hosts, levels, tiles and the directions of players."""

from robotouille import State
from robotouille.world.scene import Placed, scene
from tests.world.kitchens import act, full_pot, kitchen, play, waiting


def place(state: State, name: str) -> tuple[object, ...]:
    placed = scene(state)[name]
    return placed.host, placed.tile, placed.level


def item(name: str, x: int, y: int = 0, level: int = 0) -> dict[str, object]:
    return {"name": name, "x": x, "y": y, "stack-level": level}


def station(name: str, x: int, y: int) -> dict[str, object]:
    return {"name": name, "x": x, "y": y}


def robot(x: int, y: int, direction: list[int]) -> dict[str, object]:
    return {"name": "robot", "x": x, "y": y, "direction": direction}


def test_stacked_objects_have_ascending_levels() -> None:
    items = [item("bread", 1), item("cheese", 1, level=1), item("lettuce", 1, level=2)]
    state = kitchen(items=items).initial
    assert place(state, "bread1") == ("table2", (1, 0), 0)
    assert place(state, "cheese1") == ("table2", (1, 0), 1)
    assert place(state, "lettuce1") == ("table2", (1, 0), 2)
    assert place(state, "table2") == (None, (1, 0), 0)


def test_held_object_is_on_its_players_tile() -> None:
    world = kitchen(items=[item("bread", 0)])
    state = act(world.initial, "pick-up-item", "robot1", "bread1", "table1")
    assert place(state, "bread1") == ("robot1", (0, 1), 0)
    state = act(state, "move", "robot1", "table1", "stove2")
    assert place(state, "bread1") == ("robot1", (4, 1), 0)


def test_content_is_on_its_containers_tile() -> None:
    state = full_pot()
    assert place(state, "water1") == ("pot1", (1, 4), 0)
    assert place(state, "pot1") == ("sink1", (1, 4), 0)
    state = play(state, "Pick up pot1 at sink1 with robot1")
    assert place(state, "pot1") == ("robot1", (1, 3), 0)
    assert place(state, "water1") == ("pot1", (1, 3), 0)
    assert "iswater" in scene(state)["water1"].facts


def test_added_item_is_content_of_the_meal() -> None:
    state = play(
        full_pot(),
        "Move robot1 from sink1 to table4",
        "Pick up potato1 at table4 with robot1",
        "Move robot1 from table4 to sink1",
        "Add potato1 to water1 in pot1 at sink1 with robot1",
    )
    assert scene(state)["water1"].contents == ("potato1",)
    assert place(state, "potato1") == (None, None, 0)


def test_players_stand_next_to_their_station_and_face_it() -> None:
    state = kitchen().initial
    assert described(scene(state)["robot1"]) == ((0, 1), (0, -1), "table1")
    across = [station("table", 2, 4), station("table", 0, 0)]
    world = kitchen(stations=across)
    state = act(world.initial, "move", "robot1", "table1", "table2")
    assert described(scene(state)["robot1"]) == ((2, 3), (0, 1), "table2")


def test_corner_station_is_used_from_the_side() -> None:
    corner = [station("table", 0, 0), station("stove", 0, 1), station("sink", 2, 0)]
    world = kitchen(stations=corner, players=[robot(2, 1, [0, -1])])
    state = act(world.initial, "move", "robot1", "sink1", "table1")
    assert described(scene(state)["robot1"]) == ((1, 0), (-1, 0), "table1")


def test_two_players_use_different_tiles_if_possible() -> None:
    """Both stations are used from (1, 1) first; whoever comes second takes another tile."""
    corner = [
        station("table", 1, 2),
        station("stove", 2, 1),
        station("board", 2, 0),
        station("board", 2, 2),
        station("sink", 4, 4),
    ]
    players = [robot(1, 1, [0, 1]), robot(4, 3, [0, 1])]
    world = kitchen(stations=corner, players=players)
    state = act(world.initial, "move", "robot2", "sink1", "stove1")
    one, two = scene(state)["robot1"], scene(state)["robot2"]
    assert described(one) == ((1, 1), (0, 1), "table1")
    assert described(two) == ((3, 1), (-1, 0), "stove1")
    alone = kitchen(stations=corner, players=players[1:]).initial
    alone = act(alone, "move", "robot1", "sink1", "stove1")
    assert described(scene(alone)["robot1"]) == ((1, 1), (1, 0), "stove1")


def test_two_players_share_the_only_tile() -> None:
    """One walkable tile among three stations."""
    walls = [
        station("table", 0, 1),
        station("stove", 1, 0),
        station("sink", 2, 1),
        station("board", 1, 2),
    ]
    players = [robot(1, 1, [-1, 0]), robot(1, 1, [1, 0])]
    state = kitchen(width=3, height=3, stations=walls, players=players).initial
    placed = scene(state)
    assert described(placed["robot1"]) == ((1, 1), (-1, 0), "table1")
    assert described(placed["robot2"]) == ((1, 1), (1, 0), "sink1")


def test_scene_has_unary_facts_of_each_object() -> None:
    lettuce = {"name": "lettuce", "x": 2, "y": 0, "predicates": ["iscuttable"]}
    players = [robot(2, 1, [0, -1])]
    state = kitchen(items=[lettuce], players=players, config={"num_cuts": {"default": 1}}).initial
    assert scene(state)["lettuce1"].facts == {"islettuce", "iscuttable", "clear"}
    state = waiting(act(state, "cut", "robot1", "lettuce1", "board1"), 1)
    assert scene(state)["lettuce1"].facts == {"islettuce", "iscuttable", "iscut", "clear"}


def described(placed: Placed) -> tuple[object, ...]:
    return placed.tile, placed.facing, placed.at
