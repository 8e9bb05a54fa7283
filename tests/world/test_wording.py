"""Objects, actions and reasons in plain words."""

from __future__ import annotations

import random

import pytest

from robotouille import State, World, load_task, task_names
from robotouille.domain.rendering import Language, language_of
from robotouille.world.presentation.wording import Wording
from robotouille.world.unmet import Unmet, UnmetKind, only_words
from tests.support.samples import quick_sample_per_folder
from tests.support.scripted import BOILING, after, planned

KITCHEN = World("asynchronous/09")
WORDS = Wording(KITCHEN, language_of(KITCHEN.task), "robot1")
START = KITCHEN.initial


def condition(predicate: str, *objects: str, expected: bool = True) -> Unmet:
    return Unmet(UnmetKind.CONDITION, "as the domain says it", predicate, objects, expected)


def test_stations_are_named_by_their_objects_or_places() -> None:
    assert WORDS.things(["table1", "pot1"], START) == {"table1": "the table", "pot1": "the pot"}
    both = WORDS.things(["table1", "table2"], START)
    assert both == {"table1": WORDS.place("table1", START), "table2": WORDS.place("table2", START)}
    assert WORDS.place("sink1", START) == "the sink"
    assert len(set(both.values())) == 2


@pytest.mark.parametrize(
    ("task", "place", "called"),
    [
        ("multi_agent/01", "table1", "the table on the left"),
        ("multi_agent/01", "table2", "the table with the bottom bun"),
        ("multi_agent/01", "table5", "the right table at the bottom"),
        ("multi_agent/01", "board1", "the board"),
        ("multi_agent/01", "table6", "the table with the lettuce"),
        ("multi_agent/10@4", "table3", "the top table on the left"),
        ("multi_agent/10@4", "stove1", "the left stove at the top"),
        ("multi_agent/10@4", "table8", "the right table in the middle"),
        ("multi_agent/10@4", "table12", "the table with the onion"),
        ("asynchronous/10", "table12", "the sixth table at the bottom"),
        ("asynchronous/10", "table4", "the left table in the middle"),
        ("workshop/02", "trestle1", "the bottom trestle on the left"),
        ("workshop/02", "anvil1", "the anvil"),
    ],
)
def test_places(task: str, place: str, called: str) -> None:
    world = World(task)
    assert Wording(world, language_of(world.task)).place(place, world.initial) == called


def test_names_describe_what_is_there() -> None:
    states = planned("multi_agent/01", 2)
    language = language_of(states[0].world.task)
    names = {state: Wording(state.world, language) for state in states}
    lettuce = list(dict.fromkeys(each.thing("lettuce1", s) for s, each in names.items()))
    patty = list(dict.fromkeys(each.thing("patty1", s) for s, each in names.items()))
    assert (lettuce, patty) == (
        ["the lettuce", "the cut lettuce"], ["the patty", "the cooked patty"],
    )  # fmt: skip
    places = list(dict.fromkeys(each.place("table2", s) for s, each in names.items()))
    assert places == [
        "the table with the bottom bun",
        "the table with the unfinished burger",
        "the table with the burger",
    ]


@pytest.mark.parametrize("task", quick_sample_per_folder(task_names()))
def test_place_names_and_walks_are_unique(task: str) -> None:
    world = World(task)
    for language in (language_of(world.task), Language()):
        wording = Wording(world, language)
        for state in (world.initial, *_later(world)):
            called = [*wording.places(state).values()]
            assert len(set(called)) == len(called)
            player = world.players[-1]
            walks = [a for a in state.actions(player) if a.destination]
            assert len({wording.action(walk, state) for walk in walks}) == len(walks)


def _later(world: World) -> list[State]:
    rng, state, states = random.Random(3), world.initial, []
    for _ in range(20):
        moves = [rng.choice(state.actions(p)) for p in world.players if not state.busy_steps(p)]
        state = state.step(moves).state
        states.append(state)
    return states[::5]


def test_places_in_another_language() -> None:
    """Words that would give two stations one name are not used."""
    places = {"with_things": "{noun} mit {things}", "one_of_few": "{noun} {side} {order}"}
    world = World("multi_agent/01")
    language = Language.model_validate({"places": {**places, "single": "{noun} {side}"}})
    wording = Wording(world, language)
    assert wording.place("table6", world.initial) == "table mit the lettuce"
    assert wording.place("table5", world.initial) == "table at the bottom right"
    language = Language.model_validate({"places": {"one_of_few": "there", "single": "{zucchini}"}})
    wording = Wording(world, language)
    assert wording.place("table5", world.initial) == "the right table at the bottom"


def test_the_second_of_two_equal_objects_is_the_other() -> None:
    called = WORDS.things(["onion1", "pot1"], START)
    assert called == {"onion1": "the onion", "pot1": "the pot"}
    world = World("synchronous/08")
    wording = Wording(world, language_of(world.task), "robot1")
    breads = ["bread1", "bread2"]
    assert [*wording.things(breads, world.initial).values()] == ["the bread", "the other bread"]
    stack = world.action("stack", "robot1", "bread2", "bread1", "table1")
    assert wording.action(stack, world.initial) == "put the bread on the table"


def test_reasons_name_the_blocking_player() -> None:
    world = World("multi_agent/01")
    language = language_of(world.task)
    unmet = condition("vacant", "table2")
    named = Wording(world, language, "robot2", {"robot1": "Ben"})
    assert named.reason(unmet, world.initial) == "Ben stands at the table with the bottom bun"
    nobody = Wording(world, language, "robot1")
    assert nobody.reason(unmet, world.initial).startswith("somebody stands at ")


def test_water_with_ingredients_is_soup() -> None:
    state = after("asynchronous/09", *BOILING)
    wording = Wording(state.world, language_of(state.world.task), "robot1")
    assert wording.thing("water1", state) == "the water"
    onion = ["move table10", "pick-up-item onion1", "move stove1", "add-to"]
    state = after("asynchronous/09", *BOILING, *onion)
    wording = Wording(state.world, language_of(state.world.task), "robot1")
    assert wording.thing("water1", state) == "the soup"


def test_players_are_you_or_have_names() -> None:
    world = World("multi_agent/01@3")
    wording = Wording(world, Language(), "robot1", {"robot2": "Ada"})
    called = wording.things(world.players, world.initial)
    assert [*called.values()] == ["you", "Ada", "robot 3"]


@pytest.mark.parametrize(
    ("unmet", "words"),
    [
        (condition("nothing", "robot1"), "needs empty hands"),
        (condition("loc", "robot1", "sink1"), "go to the sink first"),
        (condition("isboard", "table2"), "needs a board, which the table is not"),
        (condition("iscooking", "chicken1", expected=False), "the chicken is already cooking"),
        (condition("clear", "bread1", expected=False), "not while the bread has nothing on top"),
        (condition("isboiling", "water1"), "boil the water first, at the stove"),
        (condition("loc", "robot1", "moon"), "go to moon first"),
        (Unmet(UnmetKind.BUSY, "", objects=("robot1",)), "you are still busy"),
        (Unmet(UnmetKind.MISSING, "", objects=("water1",)), "the water is not there"),
        (only_words("too late")[0], "too late"),
    ],
)
def test_reasons(unmet: Unmet, words: str) -> None:
    assert WORDS.reason(unmet, START).startswith(words)


def test_a_domain_without_words() -> None:
    world = World("workshop/01")
    assert language_of(world.task) == Language()
    wording = Wording(world, language_of(world.task), "fitter1")
    walk = world.action("walk", "fitter1", "trestle2", "anvil1")
    assert wording.action(walk, world.initial) == "walk from the trestle to the anvil"
    (unmet,) = world.unmet(world.initial, world.action("grab", "fitter1", "offcut1", "booth1"))
    received = wording.reason(unmet, world.initial)
    assert received == "needs: the fitter works at the booth"


def test_templates_with_unknown_fields_are_ignored() -> None:
    actions = {"cut": "cut {zucchini}", "cook": "cook {i1", "fry": {"do": "fry {0}"}}
    predicates = {"nothing": {"needed": "{3} needs empty hands"}}
    language = Language.model_validate({"actions": actions, "predicates": predicates})
    wording = Wording(KITCHEN, language, "robot1")
    cut = KITCHEN.action("cut", "robot1", "onion1", "board1")
    assert wording.action(cut, START) == "make a cut in the onion at the board"
    cook = KITCHEN.action("cook", "robot1", "onion1", "stove1")
    assert wording.action(cook, START) == "start cooking the onion at the stove"
    received = wording.reason(condition("nothing", "robot1"), START)
    assert received.startswith("needs: ")


@pytest.mark.parametrize("template", ["{i1:>999999999}", "{i1!r}", "{i1.name}", "{i1[0]}"])
def test_templates_with_formats_are_ignored(template: str) -> None:
    """A width of a thousand million letters would fill the memory."""
    language = Language.model_validate({"actions": {"cut": template}})
    cut = KITCHEN.action("cut", "robot1", "onion1", "board1")
    wording = Wording(KITCHEN, language, "robot1")
    assert wording.action(cut, START) == "make a cut in the onion at the board"


def test_place_words_are_replaced_one_by_one() -> None:
    own = Language.model_validate({"places": {"left": "by the door"}, "other": "another {noun}"})
    world = World("multi_agent/01")
    wording = Wording(world, language_of(world.task).with_words(own))
    assert wording.place("table1", world.initial) == "the table by the door"
    assert wording.place("table5", world.initial) == "the right table at the bottom"
    assert wording.thing("bottombun1", world.initial) == "the bottom bun"
    assert wording.language.other == "another {noun}"


def test_an_object_is_taken_from_the_station_with_others_like_it() -> None:
    world = World(load_task("shifts/01_sandwich_bar", seats=1))
    words = Wording(world, language_of(world.task))
    state = world.initial.step("Move robot1 from table1 to crate2").state
    (take,) = (each for each in state.actions(world.players[0]) if each.name == "unstack")
    assert words.action(take, state) == "take the cheese from the crate"


def test_the_language_tells_what_the_stations_of_a_kitchen_are_for() -> None:
    world = World(load_task("shifts/01_sandwich_bar", seats=1))
    told = Wording(world, language_of(world.task)).purposes()
    assert [kind for kind, _ in told] == ["hatch", "crate", "bin", "board", "table"]
    assert Wording(world, Language()).purposes() == ()


@pytest.mark.parametrize(
    ("predicate", "objects"), [("item_on", ()), ("item_on", ("pot1",) * 3), ("sings", ("pot1",))]
)
def test_conditions_that_the_domain_does_not_have_keep_their_text(
    predicate: str, objects: tuple[str, ...]
) -> None:
    assert WORDS.reason(condition(predicate, *objects), START) == "as the domain says it"
