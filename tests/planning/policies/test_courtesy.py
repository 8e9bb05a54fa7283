"""Favours of planner bots for participants who signal or write to them."""

from __future__ import annotations

import pytest

from robotouille import GroundAction, State, World
from robotouille.domain.rendering import language_of
from robotouille.planning.policies import PlannerPolicy
from robotouille.planning.policies.courtesy import GIVEN, PAUSING, YIELDING
from robotouille.planning.policies.planner_policy import PASSING
from robotouille.planning.policies.policy import Speech
from robotouille.planning.policies.standing import (
    is_out_of_the_way,
    standing_at,
    walks_out_of_the_way,
)
from robotouille.planning.policies.team_talk import INSIST
from robotouille.world.presentation.signals import Intent, Signal, signal_text, understood
from robotouille.world.presentation.wording import Wording
from robotouille.world.scene import scene
from tests.support.samples import quick_sample

ME, PERSON = "robot1", "robot2"


class Kitchen:
    """A planner bot next to a person who stands still, in real time."""

    def __init__(self, task: str = "multi_agent/01@2") -> None:
        self.world = World(task)
        self.state: State = self.world.initial
        self.bot = PlannerPolicy(self.world, ME, start=self.state)
        self.bot.meet({ME: "bot", PERSON: "human"}, "realtime")

    def step(self, other: GroundAction | None = None) -> str:
        """Take a step with the person's action, and return the name of the bot's, if any."""
        action = self.bot.act(self.state)
        step = self.state.step([each for each in (action, other) if each is not None])
        self.bot.observe([(a.action.player or ME, a.action, a.applied) for a in step.attempts])
        self.state = step.state
        return "" if action is None else action.name

    def until_it_holds_something(self) -> str:
        while not (held := self.held()):
            self.step()
        return held

    def held(self) -> str:
        return next((n for n, placed in scene(self.state).items() if placed.host == ME), "")

    @property
    def wording(self) -> Wording:
        return Wording(self.world, language_of(self.world.task))


@pytest.fixture
def kitchen() -> Kitchen:
    return Kitchen()


@pytest.mark.parametrize("by_signal", quick_sample([True, False]))
def test_a_bot_waits_when_asked_to(kitchen: Kitchen, by_signal: bool) -> None:
    kitchen.step()
    signal = Signal(Intent.WAIT) if by_signal else None
    kitchen.bot.hear(PERSON, Speech("wait, please", signal))
    assert {kitchen.step() for _ in range(PAUSING)} == {""}
    assert any(kitchen.step() for _ in range(5))


@pytest.mark.parametrize("by_signal", quick_sample([True, False]))
def test_a_bot_hands_over_what_somebody_needs(kitchen: Kitchen, by_signal: bool) -> None:
    held = kitchen.until_it_holds_something()
    kind = kitchen.wording.kind(kitchen.world.thing(held).kind)
    signal = Signal(Intent.NEED, held) if by_signal else None
    kitchen.bot.hear(PERSON, Speech(f"I need the {kind}", signal))
    for _ in range(6):
        kitchen.step()
    there = scene(kitchen.state)[held].host
    assert there in kitchen.world.floor.stations
    # It leaves the place, and does not take the item back at once.
    assert standing_at(kitchen.state, ME) != there
    for _ in range(GIVEN - 6):
        kitchen.step()
        assert scene(kitchen.state)[held].host == there
    for _ in range(200):
        kitchen.step()
    assert kitchen.state.goal_reached


def test_a_bot_leaves_a_station_that_somebody_needs(kitchen: Kitchen) -> None:
    while is_out_of_the_way(kitchen.state, ME):
        kitchen.step()
    station = standing_at(kitchen.state, ME) or ""
    kitchen.bot.hear(PERSON, Speech("", Signal(Intent.NEED, station)))
    for _ in range(YIELDING):
        kitchen.step()
        assert standing_at(kitchen.state, ME) != station


@pytest.mark.slow
def test_a_bot_leaves_the_station_of_an_item_that_somebody_needs(kitchen: Kitchen) -> None:
    while True:
        kitchen.step()
        station = standing_at(kitchen.state, ME)
        items = [name for name, placed in scene(kitchen.state).items() if placed.host == station]
        if items and station is not None:
            break
    kitchen.bot.hear(PERSON, Speech("", Signal(Intent.NEED, items[0])))
    kitchen.step()
    assert standing_at(kitchen.state, ME) != station


def answers(kitchen: Kitchen, target: str) -> list[str]:
    """Return what the bot says about a thing that a person leaves to it."""
    kitchen.bot.hear(PERSON, Speech("you take it", Signal(Intent.YOURS, target)))
    kitchen.step()
    return [said.text for said in kitchen.bot.speak() if said.text.startswith("I ")]


def test_a_bot_says_what_it_does_with_a_thing_that_a_person_leaves_to_it(kitchen: Kitchen) -> None:
    kitchen.step()
    kitchen.bot.speak()
    assert answers(kitchen, "lettuce1") == ["I will pick up the lettuce"]
    kitchen.step()
    assert not [said for said in kitchen.bot.speak() if said.text.startswith("I ")]


def test_a_bot_says_when_it_has_no_work_for_a_thing(kitchen: Kitchen) -> None:
    spare = walks_out_of_the_way(kitchen.state, ME)[0].destination or ""
    assert [text.split(" for ")[0] for text in answers(kitchen, spare)] == ["I have no work"]


@pytest.mark.slow
def test_a_bot_asks_once_for_an_item_that_a_person_carries_around() -> None:
    kitchen = Kitchen("multi_agent/01@2")
    place = scene(kitchen.state)["lettuce1"].host
    for wanted in (f"move({PERSON}", "pick-up-item"):
        options = [a for a in kitchen.state.actions(PERSON) if str(a).startswith(wanted)]
        action = next(a for a in options if place in a.arguments[-1:])
        kitchen.state = kitchen.state.step(action).state
    asked = []
    for number in range(INSIST - 10):
        walks = [a for a in kitchen.state.actions(PERSON) if a.destination]
        kitchen.step(walks[number % len(walks)] if number % 7 == 0 else None)
        asked += [said.signal for said in kitchen.bot.speak() if said.signal]
    assert asked == [Signal(Intent.NEED, "lettuce1")]


def test_a_bot_thanks_for_a_place() -> None:
    kitchen = Kitchen("multi_agent/02@2")
    needed = standing_at(kitchen.state, PERSON) or ""
    said: list[Speech] = []
    # Someone who only passes by need not be asked.
    for _ in range(PASSING):
        assert not [each for each in said if each.signal]
        kitchen.step()
        said += kitchen.bot.speak()
    assert Signal(Intent.NEED, needed) in [each.signal for each in said]
    walk = walks_out_of_the_way(kitchen.state, PERSON)[-1]
    kitchen.state = kitchen.state.step(walk).state
    kitchen.bot.observe([(PERSON, walk, True)])
    kitchen.step()
    assert [said.signal for said in kitchen.bot.speak() if said.signal] == [Signal(Intent.THANKS)]


@pytest.mark.parametrize("intent", Intent)
def test_sentences_of_signals_are_understood(kitchen: Kitchen, intent: Intent) -> None:
    for target in ("stove1", "lettuce1"):
        aims = intent in (Intent.NEED, Intent.YOURS)
        signal = Signal(intent, target if aims else "")
        text = signal_text(Signal(intent, target), kitchen.state, kitchen.wording)
        # A signal that only points needs no answer.
        expected = None if intent is Intent.LOOK else signal
        assert understood(text, kitchen.state, kitchen.wording) == expected


@pytest.mark.parametrize(
    "text",
    [
        "I'll wait at the stove", "don't stop, we are nearly there", "You don't need to wait",
        "You need the lettuce", "I don't need the lettuce", "I took the lettuce", "hello",
    ],
)  # fmt: skip
def test_other_sentences_mean_nothing(kitchen: Kitchen, text: str) -> None:
    assert understood(text, kitchen.state, kitchen.wording) is None


def test_a_bot_keeps_what_a_signal_does_not_point_at() -> None:
    kitchen = Kitchen("synchronous/09")
    held = kitchen.until_it_holds_something()
    kind = kitchen.world.thing(held).kind
    other = next(
        name for name in kitchen.world.thing_names
        if name != held and kitchen.world.thing(name).kind == kind
    )  # fmt: skip
    kitchen.bot.hear(PERSON, Speech("", Signal(Intent.NEED, other)))
    action = kitchen.step()
    assert action
    assert not action.startswith("place")
