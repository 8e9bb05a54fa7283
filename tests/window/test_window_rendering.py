"""Rendering files: both dialects load, faults are named, and every picture exists."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pygame
import pytest

from robotouille import FileError, World, load_task
from robotouille.domain.companions import other_renderings
from robotouille.domain.files import read_model, validate
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille.errors import RobotouilleError
from robotouille.resources import data_folder

PUBLISHED = Path(__file__).parents[3] / "shared/compat/upstream/rendering/robotouille_config.json"
OURS = data_folder("renderings") / "robotouille.json"


def ours() -> RenderingFile:
    return read_model(OURS, RenderingFile)


def test_ours_names_no_missing_and_no_superfluous_picture() -> None:
    rendering = ours()
    folder = data_folder("assets") / rendering.assets
    assert {path.name for path in folder.iterdir()} == rendering.files()


def test_the_diner_has_pictures_of_its_own_and_those_of_the_kitchen() -> None:
    rendering = rendering_of(load_task("examples/pancakes"))
    own, kitchen = rendering.folders(None)
    assert (own.name, kitchen.name) == ("diner", "kitchen")
    assert rendering.files() - ours().files() == {path.name for path in own.iterdir()}
    assert ours().files() <= rendering.files()
    assert rendering.item.entities["bread"] == ours().item.entities["bread"]


PICTURES = [p for name in ("kitchen", "diner") for p in (data_folder("assets") / name).iterdir()]


@pytest.mark.parametrize("path", sorted(PICTURES), ids=lambda p: p.name)
def test_every_picture_can_be_drawn(path: Path) -> None:
    picture = pygame.image.load_sized_svg(path, (32, 32))
    assert picture.get_size() == (32, 32)
    assert pygame.mask.from_surface(picture, 10).count() > 60


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
        (("item", "constants", "SCAL"), 1, "item.constants.SCAL: unknown field 'SCAL'"),
        (("item", "constants", "SCALE"), float("nan"), "item.constants.SCALE"),
        (("item", "entities", "onion", "assets"), {}, "item.entities.onion.assets: needs"),
        (("item", "entities", "onion", "assets", "cut"), 3, "item.entities.onion.assets.cut"),
        (
            ("item", "entities", "onion", "assets", "cut"),
            {"predicates": ["iscut"]},
            "item.entities.onion.assets.cut: 'predicates' needs an 'asset' beside it",
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


def test_the_picture_with_the_most_predicates_wins() -> None:
    chicken = ours().item.entities["chicken"].assets
    assert chicken.choose(()) == "chicken.svg"
    assert chicken.choose({"iscooked", "isfried"}) == "chicken_fried.svg"


def test_a_domain_without_a_rendering_has_the_kitchens_floor() -> None:
    task = load_task("workshop/01")
    domain = task.domain.model_copy(update={"rendering_json": "none.json"})
    rendering = rendering_of(dataclasses.replace(task, domain=domain))
    assert rendering.floor.default == "floor_tile.svg"
    assert rendering.group_of("gear") is None


def test_a_domain_cannot_name_a_file_elsewhere() -> None:
    task = load_task("workshop/01")
    elsewhere = {"rendering_json": "/etc/../renderings/robotouille.json"}
    domain = task.domain.model_copy(update=elsewhere)
    assert rendering_of(dataclasses.replace(task, domain=domain)) == ours()


def test_a_rendering_is_chosen_for_the_domains_whose_own_it_extends_or_redraws() -> None:
    kitchen, workshop = load_task("asynchronous/10"), load_task("workshop/01")
    assert rendering_of(kitchen, "chalk").assets == "chalk"
    assert rendering_of(kitchen, "robotouille") == ours()
    assert rendering_of(workshop, "robotouille") == rendering_of(workshop)
    drawn = rendering_of(workshop, "chalk")
    assert (drawn.assets, drawn.inherited_assets) == ("chalk", ("workshop", "kitchen"))
    assert drawn.station == rendering_of(workshop).station
    assert other_renderings() == ["chalk"]
    with pytest.raises(RobotouilleError, match="no rendering 'chalky'; did you mean 'chalk'"):
        rendering_of(kitchen, "chalky")


def test_chalk_says_nothing_but_where_its_pictures_are_and_has_all_of_them() -> None:
    chalk, own = rendering_of(load_task("asynchronous/10"), "chalk"), ours()
    places = {"assets": "kitchen", "inherited_assets": (), "redraws": ()}
    assert chalk.model_copy(update=places) == own.model_copy(update=places)
    folder = chalk.folders(None)[0]
    assert {path.name for path in folder.iterdir()} >= own.files()


@pytest.mark.parametrize("name", ["examples/pancakes", "workshop/02"])
def test_chalk_has_all_pictures_of_other_domains(name: str) -> None:
    rendering = rendering_of(load_task(name), "chalk")
    folder = rendering.folders(None)[0]
    assert folder.name == "chalk"
    assert rendering.files() <= {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("name", ["workshop/01", "workshop/02"])
def test_nothing_in_the_workshop_is_drawn_by_a_tile(name: str) -> None:
    world = World(name)
    rendering = rendering_of(world.task)
    kinds = {"bolt", *(thing.kind for thing in world.initial.objects)}
    assert [kind for kind in sorted(kinds) if not rendering.shows(kind)] == []
