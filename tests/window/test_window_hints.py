"""What one is told where one is, with what one holds: the nearest thing that leads on."""

from __future__ import annotations

import pytest
from tests.support.golden_hints import GOLDEN, KITCHENS, hints
from tests.support.scripted import after

from robotouille import World
from robotouille.domain.rendering import Language, language_of
from robotouille.world.people.preparation import preparation_of
from robotouille.world.people.wording import Wording
from robotouille_client.window.hands.commands import KeyMap
from robotouille_client.window.hands.controls import Controls
from robotouille_client.window.hands.hands import Hands


@pytest.mark.parametrize("kitchen", KITCHENS)
def test_what_is_said_in_every_place_with_every_thing(kitchen: str) -> None:
    """After a change: `python -m tests.support.golden_hints`, and look at what has changed."""
    assert hints(kitchen) == (GOLDEN / f"{kitchen}.txt").read_text().splitlines()


POTATO_AT_THE_POT = ["move table4", "pick-up-item potato1", "move table2"]


def test_with_something_for_an_empty_pot_one_is_told_to_fill_it() -> None:
    state = after("asynchronous/06", *POTATO_AT_THE_POT)
    controls, me = Controls(state.world), state.world.players[0]
    told = "Fill the pot with water first, at the sink"
    for meaning in (controls.key(state, me, "e"), controls.click(state, me, "table2")):
        assert (meaning.action, meaning.hint, meaning.advice) == (None, told, True)
    hands = Hands(KeyMap(), lambda: 0.0)
    assert hands.hints(controls, state, me) == (("", told),)


def test_the_work_that_a_condition_waits_for_is_told_in_its_place() -> None:
    world = World("asynchronous/04")
    wording = Wording(world, language_of(world.task), "robot1")
    fry = world.action("fry", "robot1", "potato1", "fryer1")
    (unmet,) = (u for u in world.unmet(world.initial, fry) if u.predicate == "isfryable")
    assert wording.reason(unmet, world.initial) == "cut the potato first, at the board"
    patty = world.action("fry", "robot1", "patty1", "fryer1")
    (unmet,) = (u for u in world.unmet(world.initial, patty) if u.predicate == "isfryable")
    assert wording.reason(unmet, world.initial) == "the patty cannot be fried as it is"


def test_work_is_found_in_a_domain_without_words() -> None:
    world = World("workshop/01")
    preparation = preparation_of(world)
    assert preparation.can_become("ispainted", ["gear1"])
    work = preparation.work_for("ispainted", ["gear1"])
    assert work is not None
    assert Wording(world, Language()).first(work, world.initial) == "paint first, at the booth"
    assert preparation.work_for("ispainted", [None]) is None


def test_the_words_for_work_are_a_languages_own() -> None:
    work = {"work": {"first_at": "erst {action}, und zwar {place}"}}
    world = World("asynchronous/06")
    language = language_of(world.task).with_words(Language.model_validate(work))
    found = preparation_of(world).work_for("in", [None, "pot1"])
    assert found is not None
    told = Wording(world, language).first(found, world.initial)
    assert told == "erst fill the pot with water, und zwar the sink"
    assert language.work.under_way == "wait until it is done"
