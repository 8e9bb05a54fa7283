"""How long a move took: from when the seat could act, while the game ran."""

from __future__ import annotations

from itertools import product

import pytest

from robotouille import World, load_task
from robotouille.episode import Absence, Clock, Episode, PauseReason, Rules, Stepped
from robotouille.episode.pauses import Stopwatch
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore

WORLD = World(load_task("multi_agent/02", timing="people"))
ADA, BOB = WORLD.players
REAL = Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99)


class Game:
    """Two people, and the milliseconds of every move of theirs."""

    def __init__(self, rules: Rules) -> None:
        self.episode, self.recorder = Episode(WORLD, rules), Recorder(WORLD)
        self.stream = self.recorder.begin(header(WORLD.task, rules, episode="e"))
        self.seq = 0
        for player in WORLD.players:
            self.episode.join(player, player.upper(), "human", 0.0, session=player)
        self.flush()

    def flush(self) -> None:
        self.stream += self.recorder.record(self.episode.events())

    def act(self, now: float, player: str = ADA, name: str | None = None) -> None:
        actions = self.episode.state.actions(player)
        action = next(a for a in actions if name is None or a.name == name)
        self.seq += 1
        self.episode.submit(player, self.seq, action, now)
        self.flush()

    def tick(self, now: float) -> None:
        self.episode.tick(now)
        self.flush()

    @property
    def took(self) -> list[int]:
        """Of the first one's moves, in the recording."""
        steps = Recording(self.stream).steps
        return [m["ms"] for step in steps for m in step["moves"] if m["player"] == ADA]


def test_in_real_time_steps_without_a_move_do_not_begin_it_anew() -> None:
    game = Game(REAL)
    game.tick(3.0)
    game.episode.submit(ADA, 90, "juggle", 3.5)  # Refused.
    game.episode.submit(ADA, 91, None, 4.5)  # Nothing, on purpose.
    game.seq = 91
    game.tick(5.0)
    game.act(6.25, name="move")
    game.tick(7.0)
    assert game.took == [6250]


def test_it_begins_when_the_seat_is_free_again() -> None:
    game = Game(REAL)
    game.act(0.5, name="move")
    game.tick(1.0)
    free = 1.0
    while game.episode.state.busy_steps(ADA):
        free += 1.0
        game.tick(free)
    assert free > 1.0
    game.tick(free + 2.0)
    game.act(free + 2.25)
    game.tick(free + 3.0)
    assert game.took == [500, 2250]


def test_a_move_that_was_lost_in_its_step_was_one() -> None:
    game = Game(REAL)
    state = game.episode.state
    first, lost = next(
        (theirs, mine)
        for theirs, mine in product(state.actions(BOB), state.actions(ADA))
        if not state.step([theirs, mine]).attempts[1].applied
    )
    game.episode.submit(BOB, 1, first, 0.25)
    game.episode.submit(ADA, 50, lost, 0.5)
    game.seq = 50
    game.tick(1.0)
    game.act(1.75)
    game.tick(2.0)
    assert game.took == [500, 750]


@pytest.mark.parametrize("clock", [Clock.LOCKSTEP, Clock.TURN])
def test_where_steps_wait_everybody_is_asked_anew_in_each(clock: Clock) -> None:
    game = Game(Rules(clock=clock, max_steps=99))
    game.act(2.0)
    game.episode.submit(BOB, 1, None, 9.0)
    while game.episode.state.busy_steps(ADA) or game.episode.on_turn == BOB:
        game.seq += 1
        game.episode.submit(BOB, game.seq, None, 9.0)
    game.act(10.5)
    game.episode.submit(BOB, game.seq + 1, None, 11.0)
    game.flush()
    assert game.took == [2000, 1500]


@pytest.mark.parametrize("clock", [Clock.REALTIME, Clock.LOCKSTEP])
def test_what_the_game_stands_still_does_not_count(clock: Clock) -> None:
    rules = Rules(clock=clock, step_rate=1 / 64, max_steps=99)
    for submitted, expected in ((105.0, 7_000), (50.0, 3_000)):  # Afterwards; meanwhile.
        game = Game(rules)
        game.episode.pause(PauseReason.OPERATOR, 3.0)
        if submitted < 101.0:
            game.act(submitted)
        game.episode.resume(PauseReason.OPERATOR, 101.0)
        if submitted > 101.0:
            game.act(submitted)
        game.episode.submit(BOB, 1, None, 106.0)
        game.tick(300.0)
        assert game.took == [expected]


def restarted(game: Game, now: float) -> None:
    found = restore(Recording(game.stream), now, 50.0)
    game.stream = game.stream[: found.kept] + found.missing
    game.episode, game.recorder = found.episode, Recorder(found.episode.world)
    game.flush()


@pytest.mark.parametrize("restarts", [0, 1, 2])
def test_a_restart_changes_nothing(restarts: int) -> None:
    """As far as the recording knows: the last thing that it has is what time it was."""
    game = Game(Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99, absence=Absence.WAIT))
    game.act(0.5)
    game.tick(12.0)
    game.episode.pause(PauseReason.OPERATOR, 12.5)
    game.episode.resume(PauseReason.OPERATOR, 13.5)
    game.flush()
    now = 13.5
    for _ in range(restarts):
        now += 1000.0
        restarted(game, now)
        game.episode.set_present(ADA, True, now + 3.0)
        game.episode.set_present(BOB, True, now + 4.0)
        game.flush()
        now += 4.0
    free = next(frame["step"] for frame in Recording(game.stream).steps if frame.get("busy") == {})
    game.act(now + 0.75)
    game.tick(now + 1.0)
    expected = (13.5 - free - 1.0) + 0.75
    assert game.took == [500, round(1000 * expected)]


def test_who_was_away_while_the_game_ran_begins_anew() -> None:
    game = Game(Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99, absence=Absence.WAIT))
    game.tick(2.0)
    game.episode.set_present(ADA, False, 2.5)
    game.tick(4.0)
    game.episode.set_present(ADA, True, 4.5)
    game.act(5.0)
    game.tick(6.0)
    assert game.took == [500]


def test_who_was_away_while_it_stood_still_does_not() -> None:
    game = Game(Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99, absence=Absence.PAUSE))
    game.tick(2.0)
    game.episode.set_present(ADA, False, 2.5)
    game.episode.set_present(ADA, True, 20.0)
    game.act(20.25)
    game.tick(21.0)
    assert game.took == [2750]


def test_a_stand_in_begins_when_it_takes_over() -> None:
    game = Game(Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99, absence=Absence.BOT))
    game.tick(2.0)
    game.episode.set_present(ADA, False, 2.5)
    game.episode.substitute(ADA, game.episode.state.actions(ADA)[0], 2.75)
    events = game.episode.events()
    game.episode.tick(3.0)
    (step,) = [event for event in game.episode.events() if isinstance(event, Stepped)]
    assert events
    assert (step.moves[0].seq, step.moves[0].latency) == (0, 0.25)


def test_a_stopwatch() -> None:
    watch = Stopwatch()
    assert watch.read(3.0) == 3.0
    watch.stop(3.0)
    watch.stop(5.0)  # It stands still already.
    assert watch.read(9.0) == 3.0
    watch.go_on(9.0)
    watch.go_on(10.0)  # It runs already.
    assert watch.read(11.0) == 5.0
