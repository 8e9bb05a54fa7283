"""A game in this process: counted down to, and won or not."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import pytest
from tests.support.scripted import BOILING

from robotouille import GroundAction, State, World, load_task
from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.episode import Clock, Episode, Rules
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.policies import PlannerPolicy, Policy, RandomPolicy
from robotouille.planning.policies.standing import seat_out_of_the_way, standing_at
from robotouille.planning.policies.team_talk import request
from robotouille.planning.search.unsolvable import CutOff
from robotouille.world.people.wording import Wording
from robotouille_client.bots.partners import PromptPartners
from robotouille_client.window.hands.controls import Controls
from robotouille_client.window.hands.walking import walks
from robotouille_client.window.shell.games.local_game import NO_CERTIFICATE, step_limit
from robotouille_client.window.sources.blockages import Blockages
from robotouille_client.window.sources.local import LocalSource
from robotouille_client.window.view import NEWS, View

RULES = Rules(clock=Clock.REALTIME, step_rate=10.0, max_steps=5, countdown=3.0)


class Timer:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def among(
    episode: Episode, me: str, bots: dict[str, Policy], timer: Timer, words: Language = NO_WORDS
) -> LocalSource:
    """A game with bots that decide at once."""
    names = dict.fromkeys(bots, "bot")
    return LocalSource(episode, me, names, PromptPartners(bots), timer, words=words)


def source(timer: Timer, rules: Rules = RULES) -> LocalSource:
    world = World("multi_agent/02")
    bots = {player: RandomPolicy(player, 1) for player in world.players[1:]}
    return among(Episode(world, rules, timer()), world.players[0], bots, timer)


def test_it_is_counted_down_to() -> None:
    timer = Timer()
    game = source(timer)
    assert (game.view().starts_in, game.view().status) == (3.0, "Starts in 3")
    timer.now = 2.5
    assert (game.view().starts_in, game.view().step) == (0.5, 0)
    timer.now = 3.1
    view = game.view()
    assert (view.starts_in, view.status) == (None, "")


def test_bots_think_before_the_game_begins() -> None:
    timer, world, asked = Timer(), World("multi_agent/02"), []

    class Bot(RandomPolicy):
        def act(self, state: State) -> GroundAction | None:
            asked.append(timer.now)
            return super().act(state)

    bots = {player: Bot(player, 1) for player in world.players[1:]}
    game = among(Episode(world, RULES, 0.0), world.players[0], bots, timer)
    for timer.now in (0.0, 1.0, 2.0):
        assert game.view().step == 0
    assert len(asked) == len(bots)


def test_out_of_steps_is_not_won() -> None:
    timer = Timer()
    game = source(timer)
    game.view()
    timer.now = 3.0
    game.view()
    timer.now = 4.0
    view = game.view()
    assert view.outcome == "Out of steps after 5 steps"
    assert not view.won


def test_what_cannot_be_said_is_told() -> None:
    timer = Timer()
    game = source(timer)
    for timer.now in (0.0, 3.0, 4.0):
        game.view()
    game.say("that was close")
    (line,) = game.view().chat[-1:]
    assert line == (NEWS, "the episode is over")


def test_the_step_limit_of_a_game_here() -> None:
    task = load_task("multi_agent/01", timing="people")
    assert step_limit(task, Clock.REALTIME, 10.0) == 1800
    assert step_limit(task, Clock.TURN, 10.0) == 210
    unknown = load_task("examples/pancakes", timing="people")
    assert step_limit(unknown, Clock.REALTIME, 5.0) == NO_CERTIFICATE


@cache
def known(task: str) -> AnytimePlanner:
    """The plans of a task, which all bots of these tests share."""
    return AnytimePlanner(World(task))


@pytest.mark.parametrize(
    ("words", "place"),
    [
        (NO_WORDS, "table with the bottom bun"),
        (Language.model_validate({"kinds": {"table": "Tisch"}}), "Tisch with the bottom bun"),
    ],
)
def test_bots_ask_for_what_a_person_stands_at_and_ask_for_nothing_in_vain(
    words: Language, place: str
) -> None:
    """Where no way leads around somebody who does nothing; in the words of the window's owner."""
    timer, world = Timer(), World("multi_agent/01@3")
    bots = {
        player: PlannerPolicy(
            world, player, start=world.initial, expansions=500, anytime=known("multi_agent/01@3"),
            words=words,
        )
        for player in ("robot2", "robot3")
    }  # fmt: skip
    rules = Rules(clock=Clock.REALTIME, step_rate=10.0, max_steps=60)
    game = among(Episode(world, rules, timer()), "robot1", bots, timer, words)
    blocked = set()
    while not game.finished:
        timer.now += 0.02
        view = game.view()
        blocked |= {*view.blocked}
    asked = [text for _, text in game._chat_log._lines if text.startswith("I need")]
    assert asked == [f"I need the {place}, please"]
    assert ("robot2", "table2", "robot1") in blocked
    assert sum(seat.rejected for seat in view.seats) <= 2
    assert game.outcome is not None
    shares = {seat["player"]: seat for seat in game.outcome["seats"]}
    assert shares["robot2"]["waiting"] > 20, "it waited for the place: it did not idle"
    assert shares["robot2"]["idle"] < 20


def beside_a_person(task: str, max_steps: int, act: Callable[[LocalSource, View], None]) -> Beside:
    """A game in real time of planner bots and a person who does what `act` says."""
    timer, world = Timer(), World(task)
    me = seat_out_of_the_way(world.initial)
    found = known(task)
    bots: dict[str, Policy] = {
        player: PlannerPolicy(world, player, start=world.initial, expansions=500, anytime=found)
        for player in world.players
        if player != me
    }
    rules = Rules(clock=Clock.REALTIME, step_rate=5.0, max_steps=max_steps)
    game = among(Episode(world, rules, timer()), me, bots, timer)
    states = []
    while not game.finished:
        timer.now += 0.2
        view = game.view()
        states.append(view.state)
        act(game, view)
    return Beside(view, [text for _, text in game._chat_log._lines], states)


class Beside(NamedTuple):
    """How it went: the last view, what was said, the states."""

    view: View
    said: list[str]
    states: list[State]


def test_a_bot_never_does_what_it_would_have_to_undo() -> None:
    """A person stands at the only board for a long time, and leaves."""

    def stand_at_the_board(game: LocalSource, view: View) -> None:
        free = walks(view.state, view.me or "")
        at_board = standing_at(view.state, view.me or "") == "board1"
        if view.step < 60 and not at_board and "board1" in free:
            game.act(free["board1"])
        elif view.step >= 60 and at_board:
            game.act(free["table7"])

    blocked = {}

    def act(game: LocalSource, view: View) -> None:
        blocked[view.step] = view.blocked
        stand_at_the_board(game, view)

    game = beside_a_person("multi_agent/01", 150, act)
    assert game.view.won
    first = min(step for step, held_up in blocked.items() if held_up)
    waits = ("robot1", "board1", "robot2")
    assert first < 20
    assert all(blocked[step] == (waits,) for step in range(first, 60)), "as long as it waits"
    assert not any(blocked[step] for step in range(63, max(blocked)))
    assert [text for text in game.said if "need" in text] == ["I need the board, please"]
    for state in game.states:
        facts = {*state.atoms()}
        on_something = any(a[0] == "atop" and a[1] == "lettuce1" for a in facts)
        assert not on_something or ("iscut", "lettuce1") in facts
    assert len(game.said) == len(set(game.said))


def test_bots_win_beside_a_person_who_does_nothing() -> None:
    game = beside_a_person("multi_agent/07@4", 200, lambda game, view: None)
    assert game.view.won
    assert all(seat.rejected == 0 for seat in game.view.seats)
    assert len(game.said) <= 15
    assert len(game.said) == len(set(game.said))


def test_who_asks_a_person_for_something_waits_until_it_is_done() -> None:
    blocked = {}

    def hold_the_bun(game: LocalSource, view: View) -> None:
        blocked[view.step] = view.blocked
        lines = ["move table2", "pick-up-item bottombun1"] if view.step < 100 else ["place-item"]
        for line in lines[::-1]:
            word, *arguments = line.split()
            for action in view.state.actions(view.me or ""):
                if action.name == word and {*arguments} <= {*action.arguments}:
                    game.act(action)
                    return

    game = beside_a_person("multi_agent/01", 140, hold_the_bun)
    assert "Can you put down the bottom bun?" in game.said
    assert all(("robot1", "", "robot2") in blocked[step] for step in range(30, 100))
    assert blocked[102] == (), "it goes on, and has not asked for anything else yet"


def test_who_walks_to_a_taken_place_and_who_stands_there_are_told() -> None:
    timer, world = Timer(), World("multi_agent/02")
    bots = {player: RandomPolicy(player, 1) for player in world.players[1:]}
    lockstep = Rules(clock=Clock.LOCKSTEP)
    game = among(Episode(world, lockstep, 0.0), world.players[0], bots, timer)
    state = game.view().state
    here, there = (standing_at(state, player) or "" for player in world.players[:2])
    game.act(world.action("move", world.players[0], here, there))
    assert game.view().blocked == ((world.players[0], there, world.players[1]),)
    timer.now += 6.0
    assert game.view().blocked == ()


def test_who_asked_for_a_place_waits_as_long_as_it_stands_still() -> None:
    timer, world = Timer(), World("multi_agent/02")
    one, other = world.players[:2]
    here, there = (standing_at(world.initial, player) or "" for player in (one, other))
    wording = Wording(world, language_of(world.task), None, {})
    blockages = Blockages(timer)
    blockages.said(one, request(there, world.initial, wording), world.initial, wording)
    timer.now += 20.0
    assert blockages.at(world.initial) == ((one, there, other),)
    free = next(
        action.arguments[-1]
        for action in world.initial.actions(other)
        if action.name == "move" and action.arguments[-1] not in (here, there)
    )
    moved = world.initial.step(world.action("move", other, there, free)).state
    assert blockages.at(moved) == ()
    assert blockages.at(world.initial) == (), "once it was free it is asked for anew"
    blockages.said(one, request(there, world.initial, wording), world.initial, wording)
    timer.now += 31.0
    assert blockages.at(world.initial) == ()


def test_the_seat_of_a_person_is_out_of_the_way() -> None:
    for name, expected in (("multi_agent/07@4", "robot2"), ("multi_agent/01@2", "robot2")):
        state = World(name).initial
        player = seat_out_of_the_way(state)
        assert player == expected
        others = [other for other in state.world.players if other != player]
        assert not CutOff(state.world)(state, others)


SOUP_AND_BOWL = [
    *BOILING, "-", "-", "-", "-",
    "move table10", "pick-up-item onion1", "move stove1", "add-to",
    "move table1", "pick-up-container bowl1", "move stove1",
]  # fmt: skip


def test_a_refusal_says_what_to_do_where_the_language_does() -> None:
    """By key, by click or from the list: with the bowl at the soup."""
    world = World("asynchronous/09")
    game = among(Episode(world, Rules(clock=Clock.TURN), 0.0), "robot1", {}, Timer())
    for line in SOUP_AND_BOWL:
        game.act(wanted(game.view().state, line))
    meant = Controls(world).key(game.view().state, "robot1", "e")
    assert meant.action is not None
    game.act(meant.action)
    (bubble,) = game.view().bubbles
    assert bubble.text == "Put the bowl down, and bring the pot to it."


def wanted(state: State, line: str) -> GroundAction:
    """The action of `ACTION ARGUMENT…`; to wait for `-`."""
    word, *arguments = line.replace("-", "wait", 1 if line == "-" else 0).split()
    actions = (a for a in state.actions("robot1") if a.name == word)
    return next(a for a in actions if set(arguments) <= set(a.arguments))
