"""Rendering files, and the pictures of objects in each state."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from tests.support.window_play import world_of

from robotouille import FileError, load_task
from robotouille.domain.json_files import read_model, validate
from robotouille.domain.related_files import other_renderings
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille.errors import RobotouilleError
from robotouille.installation import data_folder
from robotouille.world.world import State
from robotouille_client.window.pictures.appearance import AppearanceResolver, SceneSprites

PUBLISHED = Path(__file__).parents[3] / "shared/compat/upstream/rendering/robotouille_config.json"
OURS = data_folder("renderings") / "robotouille.json"


def ours() -> RenderingFile:
    return read_model(OURS, RenderingFile)


def test_the_shipped_rendering_uses_exactly_its_pictures() -> None:
    rendering = ours()
    folder = data_folder("assets") / rendering.assets
    assert {path.name for path in folder.iterdir()} == rendering.files()


def test_the_diner_adds_pictures_to_the_kitchens() -> None:
    rendering = rendering_of(load_task("examples/pancakes"))
    own, kitchen = rendering.folders(None)
    assert (own.name, kitchen.name) == ("diner", "kitchen")
    assert rendering.files() - ours().files() == {path.name for path in own.iterdir()}
    assert ours().files() <= rendering.files()
    assert rendering.item.entities["bread"] == ours().item.entities["bread"]


@pytest.mark.skipif(not PUBLISHED.is_file(), reason="the published files are not here")
def test_the_published_dialect_loads() -> None:
    rendering = read_model(PUBLISHED, RenderingFile)
    assert rendering.version == "1.0.0"
    assert rendering.player["robot"][0].front == "robot_front.png"
    assert rendering.station.entities["table"].assets.tile == "T"
    assert rendering.item.entities["cheese"].constants.stack_offset == -0.05
    onion = rendering.item.entities["onion"].assets
    assert onion.choose({"iscut", "isfried"}) == "friedonion.png"
    pot = rendering.container.entities["pot"].assets.named["water"]
    soup = {("isboiling", "water"), ("addedto", "onion", "water")}
    assert pot.choose((), soup) == "pot_soup.png"


def changed(*path: str, to: Any) -> RenderingFile:
    raw: dict[str, Any] = {
        "item": {"constants": {}, "entities": {"onion": {"assets": {"default": "onion.svg"}}}},
        "player": {"robot": {s: f"{s}.svg" for s in ("front", "back", "left", "right")}},
    }
    place = raw
    for part in path[:-1]:
        place = place.setdefault(part, {})
    place[path[-1]] = to
    return validate(raw, RenderingFile, "r.json")


@pytest.mark.parametrize(
    ("path", "value", "fault"),
    [
        (("floors",), {}, "unknown field 'floors'; did you mean 'floor'?"),
        (("assets",), "../secret", "assets: string should match pattern"),
        (("icons",), {"app": "/etc/passwd"}, "icons.app: string should match pattern"),
        (("inherited_assets",), [".."], "inherited_assets[0]: string should match pattern"),
        (("item", "constants", "SCAL"), 1, "item.constants.SCAL: unknown field 'SCAL'"),
        (("item", "constants", "SCALE"), float("nan"), "item.constants.SCALE"),
        (("item", "entities", "onion", "assets"), {}, "item.entities.onion.assets: needs"),
        (("item", "entities", "onion", "assets", "cut"), 3, "item.entities.onion.assets.cut"),
        (
            ("item", "entities", "onion", "assets", "cut"),
            {"predicates": ["iscut"]},
            "item.entities.onion.assets.cut: 'predicates' needs an 'asset' next to it",
        ),
        (
            ("item", "entities", "onion", "assets", "cut"),
            {"asset": "a.svg", "predicates": [{"nam": "iscut"}]},
            "item.entities.onion.assets.cut.predicates[0].name",
        ),
        (
            ("item", "entities", "onion", "assets", "cut"),
            {"asset": "a.svg", "other": "b.svg"},
            "cannot hold others (other)",
        ),
        (("player", "robot"), {"front": "a.svg"}, "player.robot[0].back"),
        (("player", "robot"), [], "player.robot"),
        (("floor",), {"tiles": {"CC": "a.svg"}}, "floor.tiles.CC"),
    ],
)
def test_faults_are_named(path: tuple[str, ...], value: Any, fault: str) -> None:
    with pytest.raises(FileError) as caught:
        changed(*path, to=value)
    assert fault in str(caught.value)


def test_a_domain_without_a_rendering_gets_the_kitchens_floor() -> None:
    task = load_task("workshop/01")
    domain = task.domain.model_copy(update={"rendering_json": "none.json"})
    rendering = rendering_of(dataclasses.replace(task, domain=domain))
    assert rendering.floor.default == "floor_tile.svg"
    assert rendering.group_of("gear") is None


def test_a_domain_cannot_name_a_file_in_another_folder() -> None:
    task = load_task("workshop/01")
    elsewhere = {"rendering_json": "/etc/../renderings/robotouille.json"}
    domain = task.domain.model_copy(update=elsewhere)
    assert rendering_of(dataclasses.replace(task, domain=domain)) == ours()


def test_a_chosen_rendering_applies_to_the_domains_it_extends_or_redraws() -> None:
    kitchen, workshop = load_task("asynchronous/10"), load_task("workshop/01")
    assert rendering_of(kitchen, "chalk").assets == "chalk"
    assert rendering_of(kitchen, "robotouille") == ours()
    assert rendering_of(workshop, "robotouille") == rendering_of(workshop)
    drawn = rendering_of(workshop, "chalk")
    assert (drawn.assets, drawn.inherited_assets) == ("chalk", ("workshop", "kitchen"))
    assert drawn.station == rendering_of(workshop).station
    assert other_renderings() == ["chalk"]
    with pytest.raises(RobotouilleError, match="unknown rendering 'chalky'; did you mean 'chalk'"):
        rendering_of(kitchen, "chalky")


def test_chalk_replaces_all_pictures_and_nothing_else() -> None:
    chalk, own = rendering_of(load_task("asynchronous/10"), "chalk"), ours()
    places = {"assets": "kitchen", "inherited_assets": (), "redraws": ()}
    assert chalk.model_copy(update=places) == own.model_copy(update=places)
    folder = chalk.folders(None)[0]
    assert {path.name for path in folder.iterdir()} >= own.files()


FOODS = {
    ("synchronous/02", "lettuce1"): {"": "lettuce", "iscut": "lettuce_cut"},
    ("asynchronous/09", "tomato1"): {"": "tomato", "iscut": "tomato_cut"},
    ("asynchronous/05", "onion1"): {
        "": "onion", "iscut": "onion_cut", "isfried": "onion_fried", "iscut isfried": "onion_fried",
    },
    ("asynchronous/06", "potato1"): {
        "": "potato", "iscut": "potato_cut", "iscut isfried": "potato_fried",
    },
    ("multi_agent/09", "patty1"): {"": "patty", "iscooked": "patty_cooked"},
    ("asynchronous/09", "chicken1"): {
        "": "chicken", "iscooked": "chicken_cooked", "isfried": "chicken_fried",
        "iscooked isfried": "chicken_fried",
    },
}  # fmt: skip


def stage_of(state: State) -> SceneSprites:
    task = state.world.task
    return AppearanceResolver(task.domain, rendering_of(task)).stage(state)


def with_facts(state: State, *atoms: tuple[str, ...]) -> State:
    table = state.world.table
    return State(state.world, state.facts | table.mask(atoms), state.timers)


def shown(state: State, name: str) -> str | None:
    pieces = [p for pile in stage_of(state).piles.values() for p in pile if p.name == name]
    assert len(pieces) == 1
    return pieces[0].appearance.asset


@pytest.mark.parametrize(("task", "name"), FOODS)
def test_foods(task: str, name: str) -> None:
    world = world_of(task)
    for facts, picture in FOODS[task, name].items():
        state = with_facts(world.initial, *((fact, name) for fact in facts.split()))
        assert shown(state, name) == f"{picture}.svg"


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
    state = play(world_of("asynchronous/09"), *lines)[-1]
    assert shown(state, container) == asset


def test_a_pot_shows_its_contents(play) -> None:
    state = play(world_of("asynchronous/09"), *SOUP, *ONION)[-1]
    (pot,) = stage_of(state).piles["stove1"]
    assert [appearance.asset for appearance in pot.contents] == ["onion.svg"]
    assert all(piece.name != "water1" for pile in stage_of(state).piles.values() for piece in pile)


def test_piles_rise_by_the_height_of_each_object(play) -> None:
    world = world_of("asynchronous/09")
    lines = ["move table11", "pick-up-item chicken1", "move table3", "stack", "move table10"]
    state = play(world, *lines, "pick-up-item onion1", "move table3", "stack")[-1]
    pile = stage_of(state).piles["table3"]
    assert [piece.name for piece in pile] == ["bread1", "chicken1", "onion1"]
    assert [round(piece.rise, 3) for piece in pile] == [0, 0.1, 0.22]
    assert stage_of(state).bases["table3"] == 0.16


def test_held_objects_are_piled_on_the_player(play) -> None:
    state = play(world_of("asynchronous/09"), "move table11", "pick-up-item chicken1")[-1]
    assert [piece.name for piece in stage_of(state).piles["robot1"]] == ["chicken1"]


def test_tiles_show_the_state_in_words(play) -> None:
    world = world_of("workshop/01")
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
    world = world_of("workshop/02")
    kitchen = rendering_of(load_task("synchronous/01"))
    resolver = AppearanceResolver(world.task.domain, kitchen)
    assert resolver.player("fitter", 0, "left").asset == "robot1_left.svg"
    assert resolver.player("fitter", 5, "back").asset == "robot2_back.svg"
