"""Local games: bots next to a person, bots that think in their own process, and pauses."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import pytest

from robotouille import GroundAction, State, World, load_task
from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.episode import ChatPosted, Clock, Episode, Rules
from robotouille.planning.policies import PlannerOptions, PlannerPolicy, Policy, RandomPolicy
from robotouille.planning.policies.planner_policy import PASSING
from robotouille.planning.policies.policy import Speech
from robotouille.planning.policies.standing import standing_at
from robotouille.planning.solvers import AnytimePlanner
from robotouille.replay.file_names import CLOSED
from robotouille.replay.recording import read_recording
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.presentation.wording import Wording
from robotouille_client.bots.kinds import BotSetup
from robotouille_client.bots.partners import (
    GONE,
    RESTARTED,
    Decision,
    PartnerProcess,
    PromptPartners,
    prompt_partners,
)
from robotouille_client.window.app.game_cards import GameCards
from robotouille_client.window.app.local_game import (
    NO_CERTIFICATE,
    GameSetup,
    LocalGame,
    step_limit,
)
from robotouille_client.window.app.replays_menu import recent_recordings
from robotouille_client.window.drawing.side_panel.seat_cards import status
from robotouille_client.window.sources.blockages import Blockages, TakenStep
from robotouille_client.window.sources.feedback import ChatLog, Feedback
from robotouille_client.window.sources.local import LocalSeats, LocalSource
from robotouille_client.window.view import NEWS, Bubble

RULES = Rules(clock=Clock.REALTIME, step_rate=10.0, max_steps=5, countdown=3.0)


class Timer:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def among(
    episode: Episode, me: str, bots: dict[str, Policy], timer: Timer, words: Language = NO_WORDS
) -> LocalSource:
    """Return a game with bots that decide at once."""
    names = dict.fromkeys(bots, "bot")
    return LocalSource(episode, LocalSeats(me, names), PromptPartners(bots), timer, words=words)


def source(timer: Timer, rules: Rules = RULES) -> LocalSource:
    world = World("multi_agent/02")
    bots = {player: RandomPolicy(player, 1) for player in world.players[1:]}
    return among(Episode(world, rules, timer()), world.players[0], bots, timer)


def test_countdown() -> None:
    timer = Timer()
    game = source(timer)
    assert (game.view().starts_in, game.view().status) == (3.0, "Starting in 3")
    timer.now = 2.5
    assert (game.view().starts_in, game.view().step) == (0.5, 0)
    timer.now = 3.1
    view = game.view()
    assert (view.starts_in, view.status) == (None, "")


def test_bots_plan_during_the_countdown() -> None:
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


def test_running_out_of_steps_is_not_a_win() -> None:
    timer = Timer()
    game = source(timer)
    game.view()
    timer.now = 3.0
    game.view()
    timer.now = 4.0
    view = game.view()
    assert view.outcome == "Time is up after 5 steps"
    assert not view.won


def test_a_refused_chat_message_is_reported() -> None:
    timer = Timer()
    game = source(timer)
    for timer.now in (0.0, 3.0, 4.0):
        game.view()
    game.say("that was close")
    (line,) = game.view().chat[-1:]
    assert line == (NEWS, "the episode has ended")


def test_step_limits_of_local_games() -> None:
    task = load_task("multi_agent/01", timing="people")
    assert step_limit(task, Clock.REALTIME, 10.0) == 1800
    assert step_limit(task, Clock.TURN, 10.0) == 180
    unknown = load_task("examples/pancakes", timing="people")
    assert step_limit(unknown, Clock.REALTIME, 5.0) == NO_CERTIFICATE


@cache
def known_plans(task: str) -> AnytimePlanner:
    """Return a planner that keeps its plans for all bots of these tests."""
    return AnytimePlanner(World(task))


@pytest.mark.parametrize(
    ("words", "place"),
    [
        (NO_WORDS, "table with the bottom bun"),
        pytest.param(
            Language.model_validate({"kinds": {"table": "Tisch"}}),
            "Tisch with the bottom bun",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_bots_ask_an_idle_person_to_move(words: Language, place: str) -> None:
    timer, world, found = Timer(), World("multi_agent/01@3"), known_plans("multi_agent/01@3")
    options = PlannerOptions(expansions=500, words=words)
    bots = {
        player: PlannerPolicy(world, player, options, start=world.initial, anytime=found)
        for player in ("robot2", "robot3")
    }
    rules = Rules(clock=Clock.REALTIME, step_rate=10.0, max_steps=60)
    game = among(Episode(world, rules, timer()), "robot1", bots, timer, words)
    blocked = set()
    while not game.finished:
        timer.now += 0.02
        view = game.view()
        blocked |= {*view.blocked}
    asked = [text for _, text in view.chat if text.startswith("I need")]
    assert {text.partition(" ×")[0] for text in asked} == {f"I need the {place}, please"}
    assert len(asked) <= len(bots)
    assert ("robot2", "table2", "robot1") in blocked
    assert sum(seat.rejected for seat in view.seats) <= 2
    (share,) = (seat for seat in game.outcome["seats"] if seat["player"] == "robot2")
    assert share["waiting"] > 20, "it waited for the place: it did not idle"
    assert share["idle"] < 20


class Asking(RandomPolicy):
    """Bot that asks for some stations, and does nothing."""

    anticipating = False

    def __init__(self, player: str, *stations: str) -> None:
        super().__init__(player)
        self._speeches = [Speech(signal=Signal(Intent.NEED, each)) for each in stations]

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        pass

    def hear(self, player: str, speech: Speech) -> None:
        pass

    def act(self, state: State) -> None:
        return None

    def speak(self) -> list[Speech]:
        said, self._speeches = self._speeches, []
        return said


def test_a_request_for_a_place_that_is_free_again_is_not_made() -> None:
    timer, world = Timer(), World("multi_agent/01")
    me, other = world.players
    here = standing_at(world.initial, me) or ""
    free = next(name for name in world.floor.stations if name.startswith("stove"))
    bots = {other: Asking(other, free, here)}
    game = among(Episode(world, Rules(clock=Clock.LOCKSTEP), timer()), me, bots, timer)
    for timer.now in (0.5, 1.0):
        view = game.view()
    assert len(view.chat) == 1
    assert (me, free) not in {(whom, place) for _, place, whom in view.blocked}
    assert (other, here, me) in view.blocked


@pytest.mark.slow
def test_a_bot_waits_for_the_help_it_asked_for() -> None:
    timer, world = Timer(), World("multi_agent/01")
    me, other = "robot2", "robot1"
    bot = PlannerPolicy(world, other, PlannerOptions(expansions=500), start=world.initial)
    rules = Rules(clock=Clock.REALTIME, step_rate=5.0, max_steps=140)
    game = among(Episode(world, rules, timer()), me, {other: bot}, timer)
    blocked = {}
    while not game.finished:
        timer.now += 0.2
        view = game.view()
        blocked[view.step] = view.blocked
        hoarding = [("pick-up-item", "bottombun1"), ("move", "table2")]
        helping = [("place-item", "bottombun1"), ("move", "table3")]
        valid = [
            action
            for name, what in (hoarding if view.step < 100 else helping)
            for action in view.state.actions(me)
            if action.name == name and what == (action.destination or action.arguments[1])
        ]
        for action in valid[:1]:
            game.act(action)
    assert ("bot", "Can you put down the bottom bun?") in view.chat
    marked = [(other, me) in {(w, b) for w, _, b in blocked[step]} for step in range(30, 100)]
    # In between, the bot puts down what it holds, and takes it again.
    assert sum(marked) > 60
    assert (other, "", me) not in blocked[103 + PASSING], "now it needs the place"


def test_a_walk_to_an_occupied_station_shows_who_blocks() -> None:
    timer, world = Timer(), World("multi_agent/02")
    bots = {player: RandomPolicy(player, 1) for player in world.players[1:]}
    lockstep = Rules(clock=Clock.LOCKSTEP)
    game = among(Episode(world, lockstep, 0.0), world.players[0], bots, timer)
    state = game.view().state
    here, there = (standing_at(state, player) or "" for player in world.players[:2])
    game.act(world.action("move", world.players[0], here, there))
    assert game.view().blocked == ((world.players[0], there, world.players[1]),)
    timer.now += 20.0
    assert game.view().blocked == ((world.players[0], there, world.players[1]),), "it is steady"
    timer.now += 11.0
    assert game.view().blocked == ()


def test_a_player_who_does_something_else_is_not_marked_any_more() -> None:
    timer, world = Timer(), World("multi_agent/02")
    one, other = world.players[:2]
    there = standing_at(world.initial, other) or ""
    blockages = Blockages(timer)
    walk = world.action("move", one, standing_at(world.initial, one) or "", there)
    blockages.refused(one, world.unmet(world.initial, walk), world.initial)
    assert blockages.at(world.initial) == ((one, there, other),)
    done = next(action for action in world.initial.actions(one) if action.destination)
    state = world.initial.step(done).state
    wording = Wording(world, NO_WORDS)
    blockages.stepped(TakenStep(world.initial, state, [(one, done, True)]), wording)
    assert blockages.at(state) == ()


def test_an_announcement_is_short_over_its_player() -> None:
    chat = ChatLog(Timer())
    text = "Next: go to the board; cut the lettuce; go to the left table"
    chat.said("Pia", "robot2", text)
    assert [bubble.text for bubble in chat.bubbles] == ["go to the board"]
    assert chat.lines == (), "announcements do not flood the chat"
    chat.said("Pia", "robot2", "I need the board, please")
    assert chat.lines == (("Pia", "I need the board, please"),)


def test_a_repeated_line_is_shown_once_with_how_often_it_was_said() -> None:
    chat = ChatLog(Timer())
    for name, text in [("Pia", "I need the board"), ("Ada", "wait"), ("Pia", "I need the board")]:
        chat.said(name, "robot2", text)
    assert chat.lines == (("Ada", "wait"), ("Pia", "I need the board ×2"))
    chat.said("Ada", "robot1", "I need the board")
    assert chat.lines[-1] == ("Ada", "I need the board"), "other people's lines are their own"
    for number in range(6):
        chat.said("Ada", "robot1", f"line {number}")
    chat.said("Pia", "robot2", "I need the board")
    assert chat.lines[-1] == ("Pia", "I need the board"), "the earlier lines are out of sight"


def test_an_announcement_of_actions_shows_pictures() -> None:
    timer, world = Timer(), World("multi_agent/01")
    wording, chat = Wording(world, language_of(world.task)), ChatLog(timer)
    feedback = Feedback(chat, Blockages(timer))
    text = "Next: cut the lettuce; go to the left table"
    feedback.show_speech(ChatPosted("Pia", "robot2", text, 0.0), "robot2", world.initial, wording)
    assert chat.bubbles == (Bubble("robot2", "", "chat", ("lettuce1",)),)


def test_an_announcement_ends_when_another_player_takes_the_thing() -> None:
    timer, world = Timer(), World("multi_agent/01")
    wording, chat = Wording(world, language_of(world.task)), ChatLog(timer)
    feedback = Feedback(chat, Blockages(timer))
    walk = next(a for a in world.initial.actions("robot1") if a.destination == "table6")
    before = world.initial.step(walk).state
    take = next(a for a in before.actions("robot1") if "lettuce1" in a.arguments)
    said = ChatPosted("Pia", "robot2", "Next: pick up the lettuce", 0.0)
    feedback.show_speech(said, "robot2", before, wording)
    feedback.stepped(TakenStep(world.initial, before), wording)
    assert chat.bubbles
    feedback.stepped(TakenStep(before, before.step(take).state), wording)
    assert chat.bubbles == ()


def test_a_signal_is_shown_with_what_it_points_at() -> None:
    timer, world = Timer(), World("multi_agent/01")
    wording, chat = Wording(world, language_of(world.task)), ChatLog(timer)
    feedback = Feedback(chat, Blockages(timer))
    said = ChatPosted("Pia", "robot2", "I need the stove", 0.0, 1, "need", "stove1")
    feedback.show_speech(said, "robot2", world.initial, wording)
    assert chat.bubbles == (Bubble("robot2", "I need", "chat", ("stove1",), "stove1"),)
    timer.now += 4.0
    assert chat.bubbles, "signals stay longer than other messages"
    timer.now += 2.0
    assert not chat.bubbles


def test_a_request_is_no_longer_shown_once_it_is_met() -> None:
    timer, world = Timer(), World("multi_agent/01")
    wording, chat = Wording(world, language_of(world.task)), ChatLog(timer)
    feedback = Feedback(chat, Blockages(timer))
    start = world.initial
    here = standing_at(start, "robot1") or ""
    leave = next(a for a in start.actions("robot1") if a.destination == "table6")
    after = start.step(leave).state
    need = ChatPosted("Pia", "robot2", "I need it", 0.0, 1, "need", here)
    feedback.show_speech(need, "robot2", start, wording)
    feedback.stepped(TakenStep(start, start), wording)
    assert chat.bubbles, "the station is still occupied"
    feedback.stepped(TakenStep(start, after, [("robot1", leave, True)]), wording)
    assert chat.bubbles == ()
    feedback.show_speech(need, "robot2", after, wording)
    feedback.stepped(TakenStep(after, after), wording)
    assert chat.bubbles, "a player may point at a free station"


def test_an_action_that_somebody_asked_for_is_asked_for_until_it_is_done() -> None:
    timer, world = Timer(), World("multi_agent/01")
    wording, blockages = Wording(world, language_of(world.task)), Blockages(timer)
    walk = next(a for a in world.initial.actions("robot1") if a.destination == "table6")
    before = world.initial.step(walk).state
    take = next(a for a in before.actions("robot1") if "lettuce1" in a.arguments)
    asked = "Can you pick up the lettuce?"
    blockages.said("robot2", asked, None, before, wording)
    assert blockages.at(before) == (("robot2", "", "robot1"),)
    blockages.stepped(TakenStep(before, before, [("robot1", take, False)]), wording)
    assert blockages.at(before), "the action was rejected"
    after = before.step(take).state
    blockages.stepped(TakenStep(before, after, [("robot1", take, True)]), wording)
    assert blockages.at(after) == ()


def test_a_met_request_does_not_come_back_after_other_work() -> None:
    world = World("multi_agent/01")
    wording, blockages = Wording(world, language_of(world.task)), Blockages(Timer())
    walk = next(a for a in world.initial.actions("robot1") if a.destination == "table6")
    before = world.initial.step(walk).state
    take = next(a for a in before.actions("robot1") if "lettuce1" in a.arguments)
    work = next(action for action in world.ground_actions("robot2") if action.destination is None)
    blockages.said("robot2", "Can you pick up the lettuce?", None, before, wording)
    blockages.stepped(TakenStep(before, before, [("robot2", work, True)]), wording)
    after = before.step(take).state
    blockages.stepped(TakenStep(before, after, [("robot1", take, True)]), wording)
    blockages.stepped(TakenStep(after, after, waits=["robot2"]), wording)
    assert blockages.at(after) == ()


def test_the_reason_of_a_rejection_goes_when_the_player_does_something_else() -> None:
    timer, world = Timer(), World("multi_agent/01")
    wording, chat = Wording(world, language_of(world.task)), ChatLog(timer)
    feedback, state = Feedback(chat, Blockages(timer)), world.initial
    walk = next(a for a in state.actions("robot1") if a.destination == "table6")
    taken = next(a for a in world.ground_actions("robot1") if a.destination)
    feedback.show_rejection("robot1", "no", world.unmet(state, taken), state, wording)
    step = TakenStep(state, state.step(walk).state, [("robot1", walk, True)])
    feedback.stepped(step, wording)
    assert chat.bubbles, "nobody can read so quickly"
    timer.now += 1.0
    feedback.stepped(TakenStep(state, state, [("robot1", walk, False)]), wording)
    feedback.stepped(TakenStep(state, state, [("robot2", walk, True)]), wording)
    assert chat.bubbles
    feedback.stepped(step, wording)
    assert chat.bubbles == ()


def test_requests_end_with_the_game_and_thanks_stay() -> None:
    chat = ChatLog(Timer())
    chat.said("Pia", "robot2", "I need it", Signal(Intent.NEED, "stove1"))
    chat.said("Ada", "robot1", "Thanks", Signal(Intent.THANKS))
    chat.ended()
    assert [bubble.player for bubble in chat.bubbles] == ["robot1"]


def test_a_request_for_a_station_lasts_while_standing_still() -> None:
    timer, world = Timer(), World("multi_agent/02")
    one, other = world.players[:2]
    here, there = (standing_at(world.initial, player) or "" for player in (one, other))
    wording = Wording(world, language_of(world.task), None, {})
    blockages = Blockages(timer)
    need = Signal(Intent.NEED, there)
    blockages.said(one, "I need it", need, world.initial, wording)
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
    blockages.said(one, "I need it", need, world.initial, wording)
    timer.now += 31.0
    assert blockages.at(world.initial) == ()


def test_a_request_comes_back_after_short_work_only() -> None:
    timer, world = Timer(), World("multi_agent/02")
    one, other = world.players[:2]
    there = standing_at(world.initial, other) or ""
    wording, blockages = Wording(world, NO_WORDS), Blockages(timer)
    work = next(action for action in world.ground_actions(one) if action.destination is None)
    blockages.said(one, "I need it", Signal(Intent.NEED, there), world.initial, wording)
    for seconds, shown in (10.0, ((one, there, other),)), (31.0, ()):
        worked = TakenStep(world.initial, world.initial, [(one, work, True)])
        blockages.stepped(worked, wording)
        assert blockages.at(world.initial) == ()
        timer.now += seconds
        blockages.stepped(TakenStep(world.initial, world.initial, waits=(one,)), wording)
        assert blockages.at(world.initial) == shown


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
        start: State, setup: BotSetup, players: Sequence[str], step_seconds: float
    ) -> SlowPartners:
        made.append(SlowPartners(prompt_partners(start, setup, players, step_seconds)._policies))
        return made[0]

    return LocalGame(setup, "ada", timer, folder, make), made[0]


@pytest.mark.slow
def test_real_time_continues_while_bots_think() -> None:
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
    assert status(card, view)[0] == "thinking"
    assert sum(seat.actions for seat in view.seats) == 0
    bots.thinking = False
    for _ in range(10):
        timer.now += 0.1
        view = game.source.view()
    assert sum(seat.actions for seat in view.seats) == 1
    assert sum(seat.rejected for seat in view.seats) == 0
    assert view.thinking == ()


@pytest.mark.slow
def test_turns_wait_for_bots_and_show_it() -> None:
    timer = Timer()
    game, bots = slow_game(GameSetup("multi_agent/01", seats=2, clock=Clock.LOCKSTEP), timer)
    view = game.source.view()
    (bot,) = (seat.player for seat in view.seats if seat.player != view.me)
    assert view.waits_for == ()
    timer.now += 1.0
    assert game.source.view().waits_for == (bot,)
    bots.thinking = False
    assert game.source.view().waits_for == ()


def test_the_recording_is_closed_when_the_game_ends(tmp_path: Path) -> None:
    """The window may be killed while it shows the card at the end."""
    timer = Timer()
    setup = GameSetup("synchronous/01", rate=10.0, max_steps=20, countdown=0.0)
    game = LocalGame(setup, "ada", timer, tmp_path)
    while not game.source.finished:
        timer.now += 0.1
        game.source.view()
    (path,) = recent_recordings([tmp_path])
    assert list(tmp_path.iterdir()) == [path]
    assert path.suffix == CLOSED
    assert read_recording(path).verify().ok
    assert game.finish(ended=True) == path


@pytest.mark.slow
def test_real_time_pauses_while_the_player_is_asked(tmp_path: Path) -> None:
    timer = Timer()
    setup = GameSetup("multi_agent/01", seats=2, rate=10.0, max_steps=40, countdown=0.0)
    game, _ = slow_game(setup, timer, tmp_path)
    source = game.source
    cards = GameCards(lambda: None, tuple, source.pause)
    timer.now += 1.0
    step = source.view().step
    cards.leave_card(source.view())
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
    path = game.finish(ended=True)
    assert read_recording(path).verify().ok


@pytest.mark.process
def test_bots_in_a_process_decide_the_same(tmp_path: Path) -> None:
    world = World("multi_agent/02@3")
    state, players = world.initial, world.players[1:]
    words = Language.model_validate({"kinds": {"table": "Tisch", "board": "Brett"}})
    here = prompt_partners(state, BotSetup(words=words), players)
    there = PartnerProcess(state, BotSetup(words=words), players)
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
                # Bots that hear of each other only after a step would plan again from there.
                spoken = sorted(partners.spoken())
                partners.observe([(a.arguments[0], a, True) for a in actions])
                waiting = sorted(player for player, each in found.items() if each.waits)
                course.append((sorted(map(str, actions)), spoken, waiting))
            courses.append(course)
    finally:
        there.close()
    assert courses[0] == courses[1]
    assert "Tisch" in str(courses[0])
    assert "table with" not in str(courses[0])
    with pytest.raises(ProcessLookupError):
        os.kill(there.pid, 0)


@pytest.mark.process
def test_a_thinking_process_is_stopped_at_once() -> None:
    world = World("multi_agent/10@4")
    partners = PartnerProcess(world.initial, BotSetup(), world.players[1:])
    partners.ask(world.players[1], world.initial)
    partners.close()
    assert not partners.answers(), "nobody waited for what it thought"
    with pytest.raises(ProcessLookupError):
        os.kill(partners.pid, 0)


@pytest.mark.process
def test_a_crashed_process_restarts_once() -> None:
    timer, made = Timer(), []

    def make(
        start: State, setup: BotSetup, players: Sequence[str], step_seconds: float
    ) -> PartnerProcess:
        made.append(PartnerProcess(start, setup, players, step_seconds))
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
        game.finish(ended=False)
    with pytest.raises(ProcessLookupError):
        os.kill(bots.pid, 0)
