"""Players see a part of a state: up to a distance, and between stations."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from robotouille import Sight, State, UnknownNameError, World, WrongArgumentError, seen_by
from robotouille.certification.certificate import load_certificate
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from robotouille.world.scene import scene
from robotouille.world.sight import PART_OF_KITCHEN
from tests.support.samples import quick_sample

pytest.importorskip("numpy")

TASKS = quick_sample(["multi_agent/07@2", "multi_agent/01@3", "shifts/04"], 2)


def wandering(world: World, steps: int, seed: int = 1) -> list[State]:
    """Return the states of a random walk of all players."""
    rng = random.Random(seed)
    states = [world.initial]
    for _ in range(steps):
        state = states[-1]
        choices = [state.actions(player) for player in world.players]
        states.append(state.step([rng.choice(each) for each in choices if each]).state)
    return states


@pytest.mark.parametrize("name", TASKS)
def test_player_without_limits_sees_everything(name: str) -> None:
    world = World(name)
    for state in wandering(world, 15):
        for player in world.players:
            seen = seen_by(state, player, Sight())
            assert seen.state == state
            assert set(seen.actions) == set(state.actions(player))
            text = seen.text_view(player)
            assert f"{PART_OF_KITCHEN}\nOut of sight: nothing." in text
            # The order is another one, because that of a world shows where things were.
            text = text.replace(f"{PART_OF_KITCHEN}\nOut of sight: nothing.\n\n", "")
            assert sorted(text.split("\n")) == sorted(state.text_view(player).split("\n"))


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("sight", [Sight(2), Sight(blocked=True)], ids=str)
def test_things_out_of_sight_show_nothing_that_changes(name: str, sight: Sight) -> None:
    world = World(name)
    hidden_once = False
    for state in wandering(world, 15):
        for player in world.players:
            seen = seen_by(state, player, sight)
            hidden = {thing.name for thing in state.objects} - seen.things
            hidden_once |= bool(hidden)
            for atom in seen.state.atoms():
                assert hidden.isdisjoint(atom[1:]) or atom in world.table.static
            assert set(seen.state.fact_names()) <= set(state.fact_names())
            assert set(state.actions(player)) <= set(seen.actions)
            assert {scene(state)[player].at, player} <= seen.things
    assert hidden_once


def test_what_is_added_to_a_soup_is_as_far_away_as_the_soup() -> None:
    world, sight, added = World("multi_agent/07@2"), Sight(1, blocked=True), 0
    state = world.initial
    for joint in read_plan("\n".join(load_certificate("multi_agent/07@2").plan or ()), world):
        state = state.step(joint).state
        soups = [(a[1], a[2]) for a in state.atoms() if a[0] == "addedto"]
        for player in world.players:
            things = seen_by(state, player, sight).things
            assert all((item in things) == (soup in things) for item, soup in soups)
            added += sum(soup not in things for _, soup in soups)
    assert added, "no player was out of sight of the soup"


def test_a_player_that_the_domain_has_deleted_sees_nothing(tmp_path: Path) -> None:
    domain = json.loads((data_folder("domains") / "workshop.json").read_text())
    domain["name"] = "vanishing"
    domain["action_defs"].append({
        "name": "vanish",
        "language_description": "Vanish at {b1} with {w1}",
        "precons": [{"predicate": "works_at", "params": ["w1", "b1"]}],
        "immediate_fx": [],
        "sfx": [{"type": "deletion", "param": "w1"}],
    })  # fmt: skip
    (tmp_path / "vanishing.json").write_text(json.dumps(domain))
    shipped = data_folder("problems") / "workshop" / "01_painted_gear.json"
    problem = json.loads(shipped.read_text()) | {"domain": "vanishing"}
    (tmp_path / "problem.json").write_text(json.dumps(problem))
    world = World(f"{tmp_path / 'problem.json'}")
    me = world.players[0]
    vanish = next(a for a in world.initial.actions(me) if a.name == "vanish")
    seen = seen_by(world.initial.step(vanish).state, me, Sight(2))
    assert not seen.things


def test_players_are_offered_walks_to_hidden_stations_but_no_work_on_hidden_things() -> None:
    seen = seen_by(World("multi_agent/07@2").initial, "robot1", Sight(2))
    text = seen.text_view("robot1")
    assert {"potato1", "table8"} <= set(seen.hidden)
    assert "to table8" in text
    valid = {thing for action in seen.actions for thing in action.arguments}
    assert "potato1" not in valid


@pytest.mark.parametrize("name", TASKS)
def test_what_a_player_can_be_sure_of_is_true(name: str) -> None:
    world, sight = World(name), Sight(2, blocked=True)
    for state in wandering(world, 20, seed=2):
        for player in world.players:
            seen = seen_by(state, player, sight)
            assert (state.facts ^ seen.state.facts) & ~seen._doubtful == 0
            assert not any(seen.unmet(action) for action in seen.actions)


def test_several_players_see_what_any_of_them_sees() -> None:
    state = World("multi_agent/01@3").initial
    each = [seen_by(state, player, Sight(2)) for player in ("robot1", "robot3")]
    both = seen_by(state, ["robot1", "robot3"], Sight(2))
    assert both.things == each[0].things | each[1].things
    assert both.actions_of("robot3") and both.actions == both.actions_of("robot1")


def test_hidden_changes_do_not_change_what_is_seen() -> None:
    world, sight = World("multi_agent/01@3"), Sight(2)
    alike = 0
    for state in wandering(world, 30):
        before = seen_by(state, "robot1", sight)
        for action in state.actions("robot2"):
            after = seen_by(state.step(action).state, "robot1", sight)
            # An action from one hidden place to another must leave no trace.
            if {"robot2", *action.arguments}.isdisjoint(before.things | after.things):
                assert before.text_view("robot1") == after.text_view("robot1")
                assert before.state.vector().tolist() == after.state.vector().tolist()
                alike += 1
    assert alike > 10


@pytest.mark.parametrize(
    ("sight", "there", "seen"),
    [
        (Sight(), (9, 9), True),
        (Sight(2), (2, 2), True),
        (Sight(2), (3, 0), False),
        (Sight(blocked=True), (1, 0), True),
        (Sight(blocked=True), (2, 0), False),
        (Sight(blocked=True), (0, 4), True),
        (Sight(blocked=True), (2, 2), True),
        (Sight(blocked=True), (4, 2), False),
        (Sight(3, blocked=True), (0, 4), False),
    ],
)
def test_stations_and_distance_limit_the_sight(
    sight: Sight, there: tuple[int, int], seen: bool
) -> None:
    stations = frozenset({(1, 0), (2, 1)})
    assert sight.reaches((0, 0), there, stations) == seen


@pytest.mark.parametrize("distance", [0, -1, 1.5, True, "2"])
def test_distance_must_be_a_number_of_tiles(distance: object) -> None:
    with pytest.raises(WrongArgumentError, match="distance: expected"):
        Sight(distance)  # type: ignore[arg-type]


def test_unknown_player_is_named() -> None:
    with pytest.raises(UnknownNameError, match="no player 'robot9'"):
        seen_by(World("multi_agent/01@3").initial, "robot9", Sight())
