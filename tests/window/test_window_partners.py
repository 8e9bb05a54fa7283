"""Bots of a local game that think in a process of their own, and a game that stands still."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from tests.support.window_play import Timer

from robotouille import State, World
from robotouille.domain.rendering import Language
from robotouille.episode import Clock
from robotouille.replay.recording import read_recording
from robotouille_client.bots import partner_process
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.partner_process import GONE, RESTARTED, PartnerProcess
from robotouille_client.bots.partners import Decision, PromptPartners, prompt_partners
from robotouille_client.window.drawing.panel.seat_cards import status
from robotouille_client.window.shell.game_cards import GameCards
from robotouille_client.window.shell.games.local_game import GameSetup, LocalGame
from robotouille_client.window.view import NEWS


class SlowPartners(PromptPartners):
    """Bots that answer when the test says so."""

    thinking = True

    def answers(self) -> list[Decision]:
        return [] if self.thinking else super().answers()


def slow_game(
    setup: GameSetup, timer: Timer, folder: Path | None = None
) -> tuple[LocalGame, SlowPartners]:
    made: list[SlowPartners] = []

    def make(
        start: State, kind: BotKind, seed: int, players: Sequence[str], words: Language
    ) -> SlowPartners:
        made.append(SlowPartners(prompt_partners(start, kind, seed, players, words)._policies))
        return made[0]

    return LocalGame(setup, "ada", timer, folder, make), made[0]


def test_in_real_time_the_game_goes_on_while_bots_think() -> None:
    timer = Timer()
    setup = GameSetup("multi_agent/01", seats=2, rate=10.0, countdown=0.0)
    game, bots = slow_game(setup, timer)
    for _ in range(20):
        timer.now += 0.1
        view = game.source.view()
    assert view.step >= 19
    assert view.waits_for == ()
    (bot,) = view.thinking
    card = next(seat for seat in view.seats if seat.player == bot)
    assert status(card, view)[0] == "thinks"
    assert sum(seat.actions for seat in view.seats) == 0
    bots.thinking = False
    for _ in range(5):
        timer.now += 0.1
        view = game.source.view()
    assert sum(seat.actions for seat in view.seats) == 1
    assert sum(seat.rejected for seat in view.seats) == 0
    assert view.thinking == ()


def test_by_turns_the_game_waits_and_says_for_whom() -> None:
    timer = Timer()
    game, bots = slow_game(GameSetup("multi_agent/01", seats=2, clock=Clock.LOCKSTEP), timer)
    view = game.source.view()
    (bot,) = (seat.player for seat in view.seats if seat.player != view.me)
    assert view.waits_for == ()
    timer.now += 1.0
    assert game.source.view().waits_for == (bot,)
    bots.thinking = False
    assert game.source.view().waits_for == ()


def test_a_game_in_real_time_stands_still_while_its_owner_is_asked(tmp_path: Path) -> None:
    timer = Timer()
    setup = GameSetup("multi_agent/01", seats=2, rate=10.0, max_steps=40, countdown=0.0)
    game, _ = slow_game(setup, timer, tmp_path)
    source = game.source
    cards = GameCards(lambda: None, tuple, source.stand_still)
    timer.now += 1.0
    step = source.view().step
    cards.leaving(source.view())
    timer.now += 5.0
    view = source.view()
    assert (view.step, view.frozen) == (step, True)
    cards.stay()
    timer.now += 1.0
    view = source.view()
    assert not view.frozen
    assert step + 9 <= view.step <= step + 11
    while not game.source.finished:
        timer.now += 0.1
        game.source.view()
    path = game.finish(over=True)
    assert path is not None
    assert read_recording(path).verify().ok


@pytest.mark.process
def test_bots_in_a_process_play_as_those_that_decide_at_once(tmp_path: Path) -> None:
    """In lockstep, where a step waits for them: the same decisions and the same words, which are
    those of the window's owner."""
    world = World("multi_agent/02@3")
    state, players = world.initial, world.players[1:]
    words = Language.model_validate({"kinds": {"table": "Tisch", "board": "Brett"}})
    here = prompt_partners(state, BotKind.PLANNER, 0, players, words)
    there = PartnerProcess(state, BotKind.PLANNER, 0, players, words)
    courses: list[list[object]] = []
    try:
        for partners in (here, there):
            kinds = dict.fromkeys(players, "bot") | {world.players[0]: "human"}
            partners.meet(kinds, "lockstep")
            state, course = world.initial, []
            for _ in range(12):
                asked = [player for player in players if not state.busy_steps(player)]
                for player in asked:
                    partners.ask(player, state)
                found: dict[str, Decision] = {}
                while len(found) < len(asked):
                    found.update((each.player, each) for each in partners.answers())
                did = [each.action for each in found.values()]
                actions = [a for a in did if a and world.applicable(state, a)]
                state = state.step(actions).state
                partners.observe([(a.arguments[0], a, True) for a in actions])
                waiting = sorted(player for player, each in found.items() if each.waits)
                course.append((sorted(map(str, actions)), sorted(partners.spoken()), waiting))
            courses.append(course)
    finally:
        there.close()
    assert courses[0] == courses[1]
    assert "Tisch" in str(courses[0])
    assert "table with" not in str(courses[0])
    with pytest.raises(ProcessLookupError):
        os.kill(there.pid, 0)


@pytest.mark.process
def test_a_process_that_thinks_is_ended_at_once() -> None:
    world = World("multi_agent/10@4")
    partners = PartnerProcess(world.initial, BotKind.PLANNER, 0, world.players[1:])
    partners.ask(world.players[1], world.initial)
    partners.close()
    assert not partners.answers(), "nobody waited for what it thought"
    with pytest.raises(ProcessLookupError):
        os.kill(partners.pid, 0)


@pytest.mark.process
def test_a_process_that_ends_begins_anew_once_and_then_the_bots_stand_still() -> None:
    """The game goes on for the person: with the bots first, then without."""
    timer, made = Timer(), []

    def make(
        start: State, kind: BotKind, seed: int, players: Sequence[str], words: Language
    ) -> PartnerProcess:
        made.append(PartnerProcess(start, kind, seed, players, words))
        return made[0]

    setup = GameSetup("multi_agent/01", seats=2, clock=Clock.LOCKSTEP)
    game = LocalGame(setup, "ada", timer, None, make)
    source, (bots,) = game.source, made
    view = source.view()
    (bot,) = (seat.player for seat in view.seats if seat.player != view.me)
    try:
        for notice in ("", RESTARTED, GONE):
            if notice:
                os.kill(bots.pid, 9)
                bots._reader.join()
            done = view.step + 3
            while view.step < done:
                if view.step == source._episode.step and view.me in source._episode.waits_for:
                    source._submit(view.me, None)
                view = source.view()
            assert view.notice == notice
            timer.now += 20.0
        assert [text for name, text in view.chat if name == NEWS] == [RESTARTED, GONE]
        tally = next(seat for seat in view.seats if seat.player == bot)
        assert 3 <= tally.actions <= 6
    finally:
        game.finish(over=False)
    with pytest.raises(ProcessLookupError):
        os.kill(bots.pid, 0)


@pytest.mark.process
def test_bots_beside_a_person_plan_in_plain_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiling would begin with the first plan in which the person has a part, and take a
    minute."""
    tell = (
        "import msgpack, os, sys; "
        "told = 'say', 'robot1', os.environ.get('ROBOTOUILLE_COMPILE'); "
        "sys.stdout.buffer.write(msgpack.packb(told)); sys.stdout.flush(); sys.stdin.read()"
    )
    monkeypatch.delenv("ROBOTOUILLE_COMPILE", raising=False)
    monkeypatch.setattr(partner_process, "COMMAND", (sys.executable, "-c", tell))
    partners = PartnerProcess(World("multi_agent/01").initial, BotKind.PLANNER, 0, ["robot1"])
    try:
        said: list[tuple[str, str]] = []
        while not said:
            assert partners.answers() == []
            said = partners.spoken()
    finally:
        partners.close()
    assert said == [("robot1", "0")]
