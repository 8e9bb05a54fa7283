"""Which picture shows a thing in each of its states, and how things pile up."""

from __future__ import annotations

import pytest

from robotouille import World, load_task
from robotouille.domain.rendering import rendering_of
from robotouille.world.world import State
from robotouille_client.window.pictures.appearance import AppearanceResolver, Stage

FOODS = [
    ("lettuce1", (), "lettuce.svg"),
    ("lettuce1", ("iscut",), "lettuce_cut.svg"),
    ("tomato1", (), "tomato.svg"),
    ("tomato1", ("iscut",), "tomato_cut.svg"),
    ("onion1", (), "onion.svg"),
    ("onion1", ("iscut",), "onion_cut.svg"),
    ("onion1", ("iscut", "isfried"), "onion_fried.svg"),
    ("onion1", ("isfried",), "onion_fried.svg"),
    ("potato1", (), "potato.svg"),
    ("potato1", ("iscut",), "potato_cut.svg"),
    ("potato1", ("iscut", "isfried"), "potato_fried.svg"),
    ("patty1", (), "patty.svg"),
    ("patty1", ("iscooked",), "patty_cooked.svg"),
    ("chicken1", (), "chicken.svg"),
    ("chicken1", ("iscooked",), "chicken_cooked.svg"),
    ("chicken1", ("isfried",), "chicken_fried.svg"),
]
TASKS = {
    "lettuce1": "synchronous/02",
    "tomato1": "asynchronous/09",
    "onion1": "asynchronous/05",
    "potato1": "asynchronous/06",
    "patty1": "multi_agent/09",
    "chicken1": "asynchronous/09",
}


def stage_of(state: State) -> Stage:
    task = state.world.task
    return AppearanceResolver(task.domain, rendering_of(task)).stage(state)


def with_facts(state: State, *atoms: tuple[str, ...]) -> State:
    table = state.world.table
    return State(state.world, state.facts | table.mask(atoms), state.timers)


def shown(state: State, name: str) -> str | None:
    pieces = [p for pile in stage_of(state).piles.values() for p in pile if p.name == name]
    assert len(pieces) == 1
    return pieces[0].appearance.asset


@pytest.mark.parametrize(("name", "facts", "asset"), FOODS)
def test_foods(name: str, facts: tuple[str, ...], asset: str) -> None:
    world = World(TASKS[name])
    state = with_facts(world.initial, *((fact, name) for fact in facts))
    assert shown(state, name) == asset


SOUP = ["move table2", "pick-up-container pot1", "move sink1", "place-container", "fill-pot",
        "-", "-", "-", "pick-up-container pot1", "move stove1", "place-container"]  # fmt: skip
ONION = ["move table10", "pick-up-item onion1", "move stove1", "add-to"]
BOIL = ["boil-water", "-", "-", "-"]
SERVE = ["pick-up-container pot1", "move table1", "fill-bowl"]


@pytest.mark.parametrize(
    ("lines", "container", "asset"),
    [
        ([], "pot1", "pot.svg"),
        ([], "bowl1", "bowl.svg"),
        (SOUP, "pot1", "pot_water.svg"),
        ([*SOUP, *BOIL], "pot1", "pot_boiling.svg"),
        ([*SOUP, *ONION], "pot1", "pot_soup_cold.svg"),
        ([*SOUP, *BOIL, *ONION], "pot1", "pot_soup.svg"),
        ([*SOUP, *SERVE], "bowl1", "bowl_water.svg"),
        ([*SOUP, *SERVE], "pot1", "pot.svg"),
        ([*SOUP, *ONION, *SERVE], "bowl1", "bowl_soup_cold.svg"),
        ([*SOUP, *BOIL, *ONION, *SERVE], "bowl1", "bowl_soup.svg"),
    ],
)
def test_containers(play, lines: list[str], container: str, asset: str) -> None:
    state = play(World("asynchronous/09"), *lines)[-1]
    assert shown(state, container) == asset


def test_a_pot_shows_what_was_added(play) -> None:
    state = play(World("asynchronous/09"), *SOUP, *ONION)[-1]
    (pot,) = stage_of(state).piles["stove1"]
    assert [appearance.asset for appearance in pot.contents] == ["onion.svg"]
    assert all(piece.name != "water1" for pile in stage_of(state).piles.values() for piece in pile)


def test_a_pile_rises_by_the_heights_of_what_is_below(play) -> None:
    world = World("asynchronous/09")
    lines = ["move table11", "pick-up-item chicken1", "move table3", "stack", "move table10"]
    state = play(world, *lines, "pick-up-item onion1", "move table3", "stack")[-1]
    pile = stage_of(state).piles["table3"]
    assert [piece.name for piece in pile] == ["bread1", "chicken1", "onion1"]
    assert [round(piece.rise, 3) for piece in pile] == [0, 0.1, 0.22]
    assert stage_of(state).bases["table3"] == 0.16


def test_what_is_held_is_piled_on_the_player(play) -> None:
    state = play(World("asynchronous/09"), "move table11", "pick-up-item chicken1")[-1]
    assert [piece.name for piece in stage_of(state).piles["robot1"]] == ["chicken1"]


def test_the_facts_of_a_kind_without_pictures_are_words(play) -> None:
    world = World("workshop/01")
    lines = ["grab gear1", "walk anvil1", "drop gear1", "hammer", "hammer"]
    state = play(world, *lines)[-1]
    kitchen = rendering_of(load_task("synchronous/01"))
    stage = AppearanceResolver(world.task.domain, kitchen).stage(state)
    (gear,) = stage.piles["anvil1"]
    assert (gear.appearance.asset, gear.appearance.kind, gear.appearance.words) == (
        None,
        "gear",
        "flat",
    )


def test_players_without_pictures_borrow_some() -> None:
    world = World("workshop/02")
    kitchen = rendering_of(load_task("synchronous/01"))
    resolver = AppearanceResolver(world.task.domain, kitchen)
    assert resolver.player("fitter", 0, "left").asset == "robot1_left.svg"
    assert resolver.player("fitter", 5, "back").asset == "robot2_back.svg"
