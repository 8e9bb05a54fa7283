"""Things, actions and reasons in a person's words."""

from __future__ import annotations

import pytest

from robotouille import World
from robotouille.domain.rendering import Language, language_of
from robotouille.world.people.wording import Wording
from robotouille.world.unmet import Unmet, UnmetKind, only_words
from tests.support.scripted import BOILING, after

KITCHEN = World("asynchronous/09")
WORDS = Wording(KITCHEN, language_of(KITCHEN.task), "robot1")
START = KITCHEN.initial


def condition(predicate: str, *objects: str, expected: bool = True) -> Unmet:
    return Unmet(UnmetKind.CONDITION, "as the domain says it", predicate, objects, expected)


def test_things_are_numbered_only_where_two_sound_alike() -> None:
    assert WORDS.things(["table1", "pot1"], START) == {"table1": "the table", "pot1": "the pot"}
    both = WORDS.things(["table1", "table2"], START)
    assert both == {"table1": "table 1", "table2": "table 2"}
    assert WORDS.place("sink1", START) == "the sink"
    assert WORDS.place("table4", START) == "table 4"


def test_water_with_something_in_it_has_another_name() -> None:
    state = after("asynchronous/09", *BOILING)
    wording = Wording(state.world, language_of(state.world.task), "robot1")
    assert wording.thing("water1", state) == "the water"
    onion = ["move table10", "pick-up-item onion1", "move stove1", "add-to"]
    state = after("asynchronous/09", *BOILING, *onion)
    wording = Wording(state.world, language_of(state.world.task), "robot1")
    assert wording.thing("water1", state) == "the soup"


def test_players_are_you_or_called_by_their_names() -> None:
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
        (condition("iscooking", "chicken1", expected=False), "the chicken is cooking already"),
        (condition("clear", "bread1", expected=False), "not while the bread has nothing on top"),
        (condition("isboiling", "water1"), "needs: the water is boiling hot"),
        (condition("loc", "robot1", "moon"), "go to moon first"),
        (Unmet(UnmetKind.BUSY, "", objects=("robot1",)), "you are still busy"),
        (Unmet(UnmetKind.MISSING, "", objects=("water1",)), "the water is not there"),
        (only_words("too late")[0], "too late"),
    ],
)
def test_reasons(unmet: Unmet, words: str) -> None:
    assert WORDS.reason(unmet, START).startswith(words)


def test_a_domain_without_words_is_readable() -> None:
    world = World("workshop/01")
    assert language_of(world.task) == Language()
    wording = Wording(world, language_of(world.task), "fitter1")
    walk = world.action("walk", "fitter1", "trestle2", "anvil1")
    assert wording.action(walk, world.initial) == "walk from the trestle to the anvil"
    (unmet,) = world.unmet(world.initial, world.action("grab", "fitter1", "offcut1", "booth1"))
    told = wording.reason(unmet, world.initial)
    assert told == "needs: the fitter works at the booth"


def test_words_that_ask_for_what_is_not_there_are_left_out() -> None:
    actions = {"cut": "cut {zucchini}", "cook": "cook {i1", "fry": {"do": "fry {0}"}}
    predicates = {"nothing": {"needed": "{3} needs empty hands"}}
    language = Language.model_validate({"actions": actions, "predicates": predicates})
    wording = Wording(KITCHEN, language, "robot1")
    cut = KITCHEN.action("cut", "robot1", "onion1", "board1")
    assert wording.action(cut, START) == "make a cut in the onion at the board"
    cook = KITCHEN.action("cook", "robot1", "onion1", "stove1")
    assert wording.action(cook, START) == "start cooking the onion at the stove"
    told = wording.reason(condition("nothing", "robot1"), START)
    assert told.startswith("needs: ")
