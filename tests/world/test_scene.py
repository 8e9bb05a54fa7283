"""Where everything is drawn: hosts, levels, tiles and the ways players look."""

from robotouille import State
from robotouille.world.scene import Placed, scene
from tests.world.kitchens import act, full_pot, kitchen, play, waiting


def place(state: State, name: str) -> tuple[object, ...]:
    placed = scene(state)[name]
    return placed.host, placed.tile, placed.level


def item(name: str, x: int, y: int = 0, level: int = 0) -> dict[str, object]:
    return {"name": name, "x": x, "y": y, "stack-level": level}


def test_stacks_are_on_their_station_level_by_level() -> None:
    items = [item("bread", 1), item("cheese", 1, level=1), item("lettuce", 1, level=2)]
    state = kitchen(items=items).initial
    assert place(state, "bread1") == ("table2", (1, 0), 0)
    assert place(state, "cheese1") == ("table2", (1, 0), 1)
    assert place(state, "lettuce1") == ("table2", (1, 0), 2)
    assert place(state, "table2") == (None, (1, 0), 0)


def test_what_is_held_is_where_its_player_is() -> None:
    world = kitchen(items=[item("bread", 0)])
    state = act(world.initial, "pick-up-item", "robot1", "bread1", "table1")
    assert place(state, "bread1") == ("robot1", (0, 1), 0)
    state = act(state, "move", "robot1", "table1", "stove2")
    assert place(state, "bread1") == ("robot1", (4, 1), 0)


def test_what_is_inside_a_container_is_where_that_is() -> None:
    state = full_pot()
    assert place(state, "water1") == ("pot1", (1, 4), 0)
    assert place(state, "pot1") == ("sink1", (1, 4), 0)
    state = play(state, "Pick up pot1 at sink1 with robot1")
    assert place(state, "pot1") == ("robot1", (1, 3), 0)
    assert place(state, "water1") == ("pot1", (1, 3), 0)
    assert "iswater" in scene(state)["water1"].facts


def test_what_was_added_to_a_meal_is_its_content() -> None:
    state = play(
        full_pot(),
        "Move robot1 from sink1 to table4",
        "Pick up potato1 at table4 with robot1",
        "Move robot1 from table4 to sink1",
        "Add potato1 to water1 in pot1 at sink1 with robot1",
    )
    assert scene(state)["water1"].contents == ("potato1",)
    assert place(state, "potato1") == (None, None, 0)


def test_players_stand_beside_their_station_and_look_at_it() -> None:
    state = kitchen().initial
    assert described(scene(state)["robot1"]) == ((0, 1), (0, -1), "table1")
    across = [{"name": "table", "x": 2, "y": 4}, {"name": "table", "x": 0, "y": 0}]
    world = kitchen(stations=across)
    state = act(world.initial, "move", "robot1", "table1", "table2")
    assert described(scene(state)["robot1"]) == ((2, 3), (0, 1), "table2")


def test_a_station_in_a_corner_is_used_from_the_side() -> None:
    corner = [
        {"name": "table", "x": 0, "y": 0},
        {"name": "stove", "x": 0, "y": 1},
        {"name": "sink", "x": 2, "y": 0},
    ]
    world = kitchen(
        stations=corner, players=[{"name": "robot", "x": 2, "y": 1, "direction": [0, -1]}]
    )
    state = act(world.initial, "move", "robot1", "sink1", "table1")
    assert described(scene(state)["robot1"]) == ((1, 0), (-1, 0), "table1")


def test_two_players_at_one_corner_tile_stand_apart_where_there_is_room() -> None:
    """Both stations are used from (1, 1) first; whoever comes second takes another tile."""
    corner = [
        {"name": "table", "x": 1, "y": 2},
        {"name": "stove", "x": 2, "y": 1},
        {"name": "board", "x": 2, "y": 0},
        {"name": "board", "x": 2, "y": 2},
        {"name": "sink", "x": 4, "y": 4},
    ]
    players = [
        {"name": "robot", "x": 1, "y": 1, "direction": [0, 1]},
        {"name": "robot", "x": 4, "y": 3, "direction": [0, 1]},
    ]
    world = kitchen(stations=corner, players=players)
    state = act(world.initial, "move", "robot2", "sink1", "stove1")
    one, two = scene(state)["robot1"], scene(state)["robot2"]
    assert described(one) == ((1, 1), (0, 1), "table1")
    assert described(two) == ((3, 1), (-1, 0), "stove1")
    alone = kitchen(stations=corner, players=players[1:]).initial
    alone = act(alone, "move", "robot1", "sink1", "stove1")
    assert described(scene(alone)["robot1"]) == ((1, 1), (1, 0), "stove1")


def test_two_players_share_a_tile_where_there_is_no_other() -> None:
    """One walkable tile among three stations."""
    walls = [
        {"name": "table", "x": 0, "y": 1},
        {"name": "stove", "x": 1, "y": 0},
        {"name": "sink", "x": 2, "y": 1},
        {"name": "board", "x": 1, "y": 2},
    ]
    players = [
        {"name": "robot", "x": 1, "y": 1, "direction": [-1, 0]},
        {"name": "robot", "x": 1, "y": 1, "direction": [1, 0]},
    ]
    state = kitchen(width=3, height=3, stations=walls, players=players).initial
    placed = scene(state)
    assert described(placed["robot1"]) == ((1, 1), (-1, 0), "table1")
    assert described(placed["robot2"]) == ((1, 1), (1, 0), "sink1")


def test_every_existing_object_is_in_the_scene_and_no_other() -> None:
    state = full_pot()
    assert set(scene(state)) == {thing.name for thing in state.objects}
    assert "water1" not in scene(state.world.initial)


def test_a_scene_shows_what_is_true_of_each_thing() -> None:
    lettuce = {"name": "lettuce", "x": 2, "y": 0, "predicates": ["iscuttable"]}
    players = [{"name": "robot", "x": 2, "y": 1, "direction": [0, -1]}]
    state = kitchen(items=[lettuce], players=players, config={"num_cuts": {"default": 1}}).initial
    assert scene(state)["lettuce1"].facts == {"islettuce", "iscuttable", "clear"}
    state = waiting(act(state, "cut", "robot1", "lettuce1", "board1"), 1)
    assert scene(state)["lettuce1"].facts == {"islettuce", "iscuttable", "iscut", "clear"}


def described(placed: Placed) -> tuple[object, ...]:
    return placed.tile, placed.facing, placed.at
