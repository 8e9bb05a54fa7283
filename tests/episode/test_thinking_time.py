"""Decision time: from the moment a seat may act, while the game runs."""

from __future__ import annotations

from itertools import product

import pytest

from robotouille import World, load_task
from robotouille.episode import Absence, ActionRequest, Clock, Episode, PauseReason, Rules, Stepped
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore

WORLD = World(load_task("multi_agent/02", timing="people"))
ADA, BOB = WORLD.players
REAL = Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99)


class Game:
    """Recorded game of two people."""

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
        self.episode.submit(player, ActionRequest(self.seq, action), now)
        self.flush()

    def tick(self, now: float) -> None:
        self.episode.tick(now)
        self.flush()

    @property
    def took(self) -> list[int]:
        """Return the recorded decision times of the first player."""
        steps = Recording(self.stream).steps
        return [m["ms"] for step in steps for m in step["moves"] if m["player"] == ADA]


def test_steps_without_a_move_do_not_restart_it_in_real_time() -> None:
    game = Game(REAL)
    game.tick(3.0)
    game.episode.submit(ADA, ActionRequest(90, "juggle"), 3.5)  # Refused.
    game.episode.submit(ADA, ActionRequest(91), 4.5)  # Nothing, on purpose.
    game.seq = 91
    game.tick(5.0)
    game.act(6.25, name="move")
    game.tick(7.0)
    assert game.took == [6250]


def test_it_starts_when_the_player_is_not_busy_any_more() -> None:
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


def test_move_that_failed_in_its_step_restarts_it() -> None:
    game = Game(REAL)
    state = game.episode.state
    first, lost = next(
        (theirs, mine)
        for theirs, mine in product(state.actions(BOB), state.actions(ADA))
        if not state.step([theirs, mine]).attempts[1].applied
    )
    game.episode.submit(BOB, ActionRequest(1, first), 0.25)
    game.episode.submit(ADA, ActionRequest(50, lost), 0.5)
    game.seq = 50
    game.tick(1.0)
    game.act(1.75)
    game.tick(2.0)
    assert game.took == [500, 750]


@pytest.mark.parametrize("clock", [Clock.LOCKSTEP, Clock.TURN])
def test_every_step_restarts_it_when_steps_wait(clock: Clock) -> None:
    game = Game(Rules(clock=clock, max_steps=99))
    game.act(2.0)
    game.episode.submit(BOB, ActionRequest(1), 9.0)
    while game.episode.state.busy_steps(ADA) or game.episode.on_turn == BOB:
        game.seq += 1
        game.episode.submit(BOB, ActionRequest(game.seq), 9.0)
    game.act(10.5)
    game.episode.submit(BOB, ActionRequest(game.seq + 1), 11.0)
    game.flush()
    assert game.took == [2000, 1500]


@pytest.mark.parametrize("clock", [Clock.REALTIME, Clock.LOCKSTEP])
def test_pauses_do_not_count(clock: Clock) -> None:
    rules = Rules(clock=clock, step_rate=1 / 64, max_steps=99)
    for submitted, expected in ((105.0, 7_000), (50.0, 3_000)):  # After the pause; during it.
        game = Game(rules)
        game.episode.pause(PauseReason.OPERATOR, 3.0)
        if submitted < 101.0:
            game.act(submitted)
        game.episode.resume(PauseReason.OPERATOR, 101.0)
        if submitted > 101.0:
            game.act(submitted)
        game.episode.submit(BOB, ActionRequest(1), 106.0)
        game.tick(300.0)
        assert game.took == [expected]


def restarted(game: Game, now: float) -> None:
    found = restore(Recording(game.stream), now, 50.0)
    game.stream = game.stream[: found.kept] + found.missing
    game.episode, game.recorder = found.episode, Recorder(found.episode.world)
    game.flush()


@pytest.mark.parametrize("restarts", [0, 1, 2])
def test_restart_does_not_change_it(restarts: int) -> None:
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


def test_absence_during_play_restarts_it() -> None:
    game = Game(Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99, absence=Absence.WAIT))
    game.tick(2.0)
    game.episode.set_present(ADA, False, 2.5)
    game.tick(4.0)
    game.episode.set_present(ADA, True, 4.5)
    game.act(5.0)
    game.tick(6.0)
    assert game.took == [500]


def test_absence_during_a_pause_does_not_restart_it() -> None:
    game = Game(Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99, absence=Absence.PAUSE))
    game.tick(2.0)
    game.episode.set_present(ADA, False, 2.5)
    game.episode.set_present(ADA, True, 20.0)
    game.act(20.25)
    game.tick(21.0)
    assert game.took == [2750]


def test_substitutes_time_starts_when_it_takes_over() -> None:
    game = Game(Rules(clock=Clock.REALTIME, step_rate=1.0, max_steps=99, absence=Absence.BOT))
    game.tick(2.0)
    game.episode.set_present(ADA, False, 2.5)
    game.episode.substitute(ADA, game.episode.state.actions(ADA)[0], 2.75)
    events = game.episode.events()
    game.episode.tick(3.0)
    (step,) = [event for event in game.episode.events() if isinstance(event, Stepped)]
    assert events
    assert (step.moves[0].seq, step.moves[0].latency) == (0, 0.25)
