"""Clicks and keys resolve to the actions of the input file, with hints."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from tests.support.golden_hints import GOLDEN, KITCHENS, hints
from tests.support.scripted import BOILING, after

from robotouille import Timing, World, load_task
from robotouille.domain.input_bindings import WINDOW_KEYS, bindings_of, made_up_keys
from robotouille.domain.json_files import read_model
from robotouille.domain.rendering import language_of
from robotouille.domain.schema import InputFile
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from robotouille.world.presentation.wording import Wording
from robotouille.world.scene import scene
from robotouille_client.window.input.commands import DEFAULT_KEYS, KeyMap
from robotouille_client.window.input.controls import Controls, use
from robotouille_client.window.input.hints import tips_about
from robotouille_client.window.input.input_controller import InputController
from robotouille_client.window.view import View

PUBLISHED = Path(__file__).parents[3] / "shared/compat/upstream/domain/input.json"
POT = ["move table2", "pick-up-container pot1", "move sink1", "place-container"]
FULL = [*POT, "fill-pot", "-", "-", "-", "pick-up-container pot1", "move stove1", "place-container"]
ONION = ["move table10", "pick-up-item onion1", "move stove1"]
CHICKEN = ["move table11", "pick-up-item chicken1", "move stove1", "place-item"]
TOMATO = ["move table9", "pick-up-item", "move board1", "place-item"]

KITCHEN = [
    ([], "table3", "move(robot1, table8, table3)"),
    (["move table11"], "table11", "pick-up-item(robot1, table11, chicken1)"),
    (CHICKEN[:3], "stove1", "place-item(robot1, stove1, chicken1)"),
    ([*CHICKEN[:2], "move table3"], "table3", "stack(robot1, table3, chicken1, bread1)"),
    (
        [*CHICKEN[:2], "move table3", "stack"],
        "table3",
        "unstack(robot1, table3, chicken1, bread1)",
    ),
    (["move table2"], "table2", "pick-up-container(robot1, table2, pot1)"),
    (POT[:3], "sink1", "place-container(robot1, sink1, pot1)"),
    (TOMATO, "key e", "cut(robot1, board1, tomato1)"),
    (CHICKEN, "key e", "cook(robot1, stove1, chicken1)"),
    (POT, "key e", "fill-pot(robot1, sink1, pot1)"),
    (FULL, "key e", "boil-water(robot1, stove1, pot1, water1)"),
    ([*FULL, *ONION], "key e", "add-to(robot1, stove1, onion1, pot1, water1)"),
    ([*FULL, "pick-up-container", "move table1"], "key e",
     "fill-bowl(robot1, pot1, water1, bowl1, table1)"),
    ([], "key space", "wait()"),
]  # fmt: skip


def meaning(controls: Controls, state, player: str, what: str):
    word, _, key = what.partition(" ")
    return controls.key(state, player, key) if key else controls.click(state, player, word)


def assert_same(action, expected: str) -> None:
    name, _, arguments = expected.rstrip(")").partition("(")
    assert action.name == name
    assert set(action.arguments) == set(filter(None, arguments.split(", ")))


@pytest.mark.parametrize(("lines", "what", "expected"), KITCHEN)
def test_the_kitchen(play, lines: list[str], what: str, expected: str) -> None:
    world = World("asynchronous/09")
    state = play(world, *lines)[-1]
    found = meaning(Controls(world), state, "robot1", what)
    assert found.valid
    assert found.hint[0].isupper()
    assert not any(character.isdigit() for character in found.hint)
    assert_same(found.action, expected)


def test_fry(play) -> None:
    world = World("asynchronous/03")
    fryer = next(o.name for o in world.placed if o.kind == "fryer")
    chicken = next(o.name for o in world.placed if o.kind == "chicken")
    table = scene(world.initial)[chicken].host
    state = play(world, f"move {table}", "pick-up-item", f"move {fryer}", "place-item")[-1]
    found = Controls(world).key(state, "robot1", "e")
    assert found.valid
    assert found.action.name == "fry"


WORKSHOP = [
    ([], "anvil1", "walk(fitter1, trestle2, anvil1)"),
    ([], "trestle2", "grab(fitter1, trestle2, gear1)"),
    (["grab gear1", "walk anvil1"], "anvil1", "drop(fitter1, anvil1, gear1)"),
    (["grab gear1", "walk anvil1", "drop"], "key r", "hammer(fitter1, anvil1, gear1)"),
    (["walk booth1"], "key r", "paint(fitter1, booth1, offcut1)"),
    (["walk dispenser1"], "key r", "dispense(fitter1, dispenser1)"),
    (
        ["walk dispenser1", "dispense", "-", "-", "grab bolt1", "walk trestle2"],
        "key f",
        "bolt-on(fitter1, trestle2, bolt1, gear1)",
    ),
    (["grab gear1", "walk trestle3"], "key f", "pack(fitter1, trestle3, gear1, box1)"),
    (["walk booth1", "grab", "walk bin1"], "key f", "recycle(fitter1, bin1, offcut1)"),
    ([], "key space", "rest()"),
]


@pytest.mark.parametrize(("lines", "what", "expected"), WORKSHOP)
def test_the_workshop(play, lines: list[str], what: str, expected: str) -> None:
    world = World("workshop/01")
    state = play(world, *lines)[-1]
    found = meaning(Controls(world), state, "fitter1", what)
    assert found.valid
    assert_same(found.action, expected)


@pytest.mark.parametrize(
    ("lines", "what", "action", "reason"),
    [
        ([*CHICKEN, "cook"], "key e", "cook", "Cook the chicken? The chicken is already cooking"),
        ([], "table8", None, "nothing to do at the table"),
        ([*CHICKEN[:2], "move table2"], "table2", "place-item", "There is no room on the table"),
        ([], "key e", None, "nothing to do at the table"),
        ([*TOMATO, "cut", "cut", "cut"], "key e", None, "nothing to do at the board"),
        (["move table11", "pick-up-item", "move table8", "place-item"], "key r", None, ""),
        ([], "key q", None, ""),
    ],
)
def test_impossible_input_is_tried_or_explained(
    play, lines: list[str], what: str, action: str | None, reason: str
) -> None:
    world = World("asynchronous/09")
    state = play(world, *lines)[-1]
    found = meaning(Controls(world), state, "robot1", what)
    assert not found.valid
    assert (found.action.name if found.action else None) == action
    assert reason in found.hint
    if found.action is not None:
        assert world.unmet(state, found.action)


@pytest.mark.parametrize(
    ("lines", "what", "advice"),
    [
        (ONION, "stove1", "needs a board"),
        (["move table11", "pick-up-item", "move board1"], "board1", "the chicken cannot be cut"),
        (["move table2", "pick-up-container", "move stove1"], "stove1", "fill the pot with water"),
        (
            [*CHICKEN, *["cook", *"-" * 3], "pick-up-item"],
            "stove1",
            "nothing to do with the cooked chicken here",
        ),
        (
            [*CHICKEN, "move table12", "pick-up-item", "move stove1"],
            "stove1",
            "one chicken at a time",
        ),
    ],
)
def test_the_use_key_puts_nothing_where_it_is_of_no_use(
    play, lines: list[str], what: str, advice: str
) -> None:
    world = World("asynchronous/09")
    state = play(world, *lines)[-1]
    controls = Controls(world)
    for found in (use(controls, state, "robot1"), use(controls, state, "robot1", "e")):
        assert found.action is None
        assert advice in found.hint.lower()
    assert controls.click(state, "robot1", what).valid
    rows = InputController(KeyMap(), lambda: 0.0).hints(controls, state, "robot1")
    assert [key for key, _ in rows] == ["", "Click"]


@pytest.mark.parametrize(
    "lines",
    [CHICKEN[:3], POT[:3], FULL[:-1], TOMATO[:3], [*CHICKEN[:2], "move table3"]],
)
def test_the_use_key_puts_things_where_they_are_worked_on_and_on_tables(
    play, lines: list[str]
) -> None:
    state = play(World("asynchronous/09"), *lines)[-1]
    found = use(Controls(state.world), state, "robot1", "e")
    assert found.valid
    assert found.action is not None


def test_a_key_falls_back_to_the_click(play) -> None:
    world = World("asynchronous/09")
    for lines, name in ((CHICKEN[:3], "place-item"), (["move table9"], "pick-up-item")):
        state = play(world, *lines)[-1]
        at = scene(state)["robot1"].at
        clicked, pressed = (meaning(Controls(world), state, "robot1", w) for w in (at, "key e"))
        assert clicked == pressed
        assert clicked.action.name == name


@pytest.mark.parametrize(
    ("lines", "action"),
    [
        ([*TOMATO, "cut", "cut", "cut"], "cut"),
        ([*CHICKEN, "cook", "-", "-", "-", "-"], "cook"),
        ([*POT, "fill-pot"], "fill-pot"),
        ([*FULL, "boil-water", "-", "-", "-", "-"], "boil-water"),
    ],
)
def test_work_that_changes_nothing_is_not_offered(play, lines: list[str], action: str) -> None:
    world = World("asynchronous/09")
    state = play(world, *lines)[-1]
    assert action in [each.name for each in state.actions("robot1")]
    controls = Controls(world)
    assert controls.options(state, "robot1") == ()
    found = controls.key(state, "robot1", "e")
    assert not found.valid
    assert found.action is None


def test_a_walk_to_an_occupied_station_is_tried(play) -> None:
    world = World("multi_agent/09")
    other = scene(world.initial)[world.players[1]].at
    controls = Controls(world)
    found = controls.click(world.initial, world.players[0], other)
    assert found.action.name == "move"
    assert found.hint == "Robot 2 stands at the second table at the bottom"
    controls.names = {world.players[0]: "Ada", world.players[1]: "Ben"}
    found = controls.click(world.initial, world.players[0], other)
    assert found.hint == "Ben stands at the second table at the bottom"


def test_an_occupied_station_is_explained_before_its_contents(play) -> None:
    world = World("multi_agent/07@4")
    lines = ("move table2", "pick-up-item onion1", "move board1", "place-item")
    state = play(world, *lines)[-1]
    controls = Controls(world)
    controls.names = {"robot1": "Ben"}
    found = controls.click(state, "robot2", "board1")
    assert found.hint == "Ben stands at the board with the onion"
    assert found.action == world.action("move", "robot2", "table3", "board1")


def test_a_busy_player_does_nothing(play) -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    state = play(world, "move table2")[-1]
    found = Controls(world).click(state, "robot1", "table3")
    assert found.action is None
    assert found.hint.startswith("you are busy for")


def test_help_lists_every_binding() -> None:
    rows = dict(Controls(World("workshop/01")).help())
    assert rows == {
        "Left click": "walk, grab, drop",
        "F": "bolt on, pack, recycle",
        "R": "paint, hammer, dispense",
        "Space": "rest",
    }


@pytest.mark.skipif(not PUBLISHED.is_file(), reason="the published files are not here")
def test_the_paper_input_file_works() -> None:
    world = World("asynchronous/09")
    controls = Controls(world, read_model(PUBLISHED, InputFile))
    assert controls.click(world.initial, "robot1", "table3").action.name == "move"


def test_a_domain_without_an_input_file_gets_default_keys() -> None:
    task = World("workshop/01").task
    domain = task.domain.model_copy(update={"input_json": "none.json"})
    bindings = bindings_of(dataclasses.replace(task, domain=domain))
    clicks = [b.name for b in bindings.mouse_click_actions]
    keys = {b.name: b.input_instructions.at for b in bindings.keyboard_actions}
    assert clicks == ["walk"]
    assert keys["hammer"] == "b1"
    assert keys["rest"] is None


def test_an_unbound_action_gets_a_key_and_a_help_row() -> None:
    task = load_task("examples/pancakes")
    domain = task.domain.model_copy(update={"input_json": "robotouille.input.json"})
    controls = Controls(World(dataclasses.replace(task, domain=domain)))
    rows = dict(controls.help())
    assert (rows["B"], rows["P"]) == ("bake", "pour syrup")
    assert "bake" not in rows["E"]


def test_the_shipped_keys_can_make_the_pancakes(play) -> None:
    world = World("examples/pancakes")
    plan = read_plan((data_folder("problems") / "examples/pancakes.plan").read_text(), world)
    controls, state = Controls(world), world.initial
    for joint in plan:
        for action in joint:
            binding = action.schema.bind(action.arguments)
            keyed = action.name in ("bake", "pour-syrup")
            what = "key e" if keyed else binding["s2" if action.name == "move" else "s1"]
            assert meaning(controls, state, "robot1", what).action == action
        state = state.step(joint).state
    assert state.goal_reached


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            ("move table1", "pick-up-container bowl1", "move stove1"),
            "Fill the bowl from the pot? Put the bowl down, and bring the pot to it",
        ),
        (("move table10", "pick-up-item onion1", "move stove1"), "Add the onion to the water"),
    ],
)
def test_at_the_pot_key_and_click_agree(lines: tuple[str, ...], message: str) -> None:
    state = after("asynchronous/09", *BOILING, *lines)
    controls = Controls(state.world)
    pressed = use(controls, state, "robot1", "e")
    assert pressed.hint == message
    assert pressed == controls.click(state, "robot1", "stove1")


def test_with_full_hands_key_and_click_agree(play) -> None:
    world = World("multi_agent/07")
    fetch = ("move table2", "pick-up-item onion1", "move board1", "place-item", "cut")
    hand = ("move table7", "pick-up-item potato1", "move board1")
    state = play(world, *fetch, *hand)[-1]
    controls = Controls(world)
    clicked = controls.click(state, "robot1", "board1")
    assert clicked.hint == "Put the potato on the onion"
    assert use(controls, state, "robot1", "e") == clicked


@pytest.mark.parametrize("kitchen", KITCHENS)
def test_hints_match_the_golden_files(kitchen: str) -> None:
    """Update with `python -m tests.support.golden_hints`, and review the changes."""
    assert hints(kitchen) == (GOLDEN / f"{kitchen}.txt").read_text().splitlines()


POTATO_AT_THE_POT = ["move table4", "pick-up-item potato1", "move table2"]


def test_an_empty_pot_advises_to_fill_it() -> None:
    state = after("asynchronous/06", *POTATO_AT_THE_POT)
    controls, me = Controls(state.world), state.world.players[0]
    message = "Fill the pot with water first, at the sink"
    for meaning in (controls.key(state, me, "e"), controls.click(state, me, "table2")):
        assert (meaning.action, meaning.hint, meaning.advice) == (None, message, True)
    hands = InputController(KeyMap(), lambda: 0.0)
    assert hands.hints(controls, state, me) == (("", message),)


def test_a_tip_says_what_an_empty_station_is_for() -> None:
    world = World("shifts/01@1")
    at_hatch = world.initial.step("Move robot1 from table1 to hatch1").state
    view = View(world, at_hatch, me="robot1")
    told = tips_about(Controls(world), view, "hatch1")
    assert told == ("The hatch", "Build dishes here; a complete dish is served")


def test_an_unmet_condition_names_the_missing_work() -> None:
    world = World("asynchronous/04")
    wording = Wording(world, language_of(world.task), "robot1")
    fry = world.action("fry", "robot1", "potato1", "fryer1")
    (unmet,) = (u for u in world.unmet(world.initial, fry) if u.predicate == "isfryable")
    assert wording.reason(unmet, world.initial) == "cut the potato first, at the board"
    patty = world.action("fry", "robot1", "patty1", "fryer1")
    (unmet,) = (u for u in world.unmet(world.initial, patty) if u.predicate == "isfryable")
    assert wording.reason(unmet, world.initial) == "the patty cannot be fried as it is"


def test_actions_without_a_key_get_none_of_the_windows_own() -> None:
    """A key of an action wins over the window's, so that A would no longer walk to the left."""
    own = {key for keys in DEFAULT_KEYS.values() for key in keys}
    assert {key for key in own if len(key) == 1} == WINDOW_KEYS
    kitchen = World("synchronous/01").task.domain
    given = made_up_keys(InputFile(), kitchen)
    assert len(given) > 10 and not own & set(given.values())
