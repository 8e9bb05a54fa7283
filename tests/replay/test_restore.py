"""An episode goes on from its recording, wherever that was cut off."""

from __future__ import annotations

from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import RecordingError, World
from robotouille.episode import Clock, Controller, Episode, Event, PauseReason, Phase, Rules
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restore
from tests.support.games import random_choice
from tests.support.thorough import thorough

WORLD = World("multi_agent/02")


class Game:
    """An episode that is recorded as a server does it, with people, chat and lost connections."""

    def __init__(self, clock: Clock = Clock.LOCKSTEP, steps: int = 5000) -> None:
        self.rules = Rules(clock=clock, max_steps=steps, step_rate=10.0)
        self.episode = Episode(WORLD, self.rules, 0.0)
        head = header(WORLD.task, self.rules, episode="e", code="ABCDE-FGHJK", owner="study")
        self.recorder = Recorder(WORLD)
        self.bytes = self.begin = self.recorder.begin(head)
        self.now = 0.0
        self.seq = 0
        self.marks: list[tuple[int, int]] = []

    def flush(self) -> list[Event]:
        events = self.episode.events()
        self.bytes += self.recorder.record(events)
        self.marks.append((len(self.bytes), self.episode.step))
        return events

    def play(self, rounds: int, seed: int = 0) -> Game:
        choose = random_choice(seed)
        for player in WORLD.players:
            if not self.episode.seat(player).taken:
                self.episode.join(player, player.upper(), "bot", self.now, session=f"s-{player}")
        self.flush()
        for _ in range(rounds):
            self.round(choose)
        return self

    def round(self, choose) -> None:  # type: ignore[no-untyped-def]
        episode = self.episode
        self.now += 0.1
        self.seq += 1
        for player in WORLD.players:
            asked = episode.on_turn in (None, player) and not episode.state.busy_steps(player)
            if episode.phase is Phase.RUNNING and asked:
                episode.submit(player, self.seq, choose(episode, player), self.now)
                self.flush()
        if self.seq % 9 == 0 and episode.phase is not Phase.ENDED:
            episode.submit(
                "robot1", self.seq + 1, WORLD.action("move", "robot1", "table1", "table1"), self.now
            )
            self.seq += 1
        if self.seq % 7 == 0 and episode.phase is not Phase.ENDED:
            episode.say("ROBOT1", "robot1", f"number {self.seq}", self.now)
        if self.seq % 11 == 0:
            episode.set_present("robot2", False, self.now)
            self.flush()
            episode.set_present("robot2", True, self.now, generation=self.seq)
        episode.tick(self.now)
        self.flush()


def restored(content: bytes, now: float = 1000.0) -> Restored:
    return restore(Recording(content), now, 10.0)


@cache
def played(clock: Clock) -> Game:
    """A game that tests look at, and do not go on with."""
    return Game(clock).play(130)


@pytest.mark.parametrize("clock", list(Clock))
def test_everything_is_as_it_was(clock: Clock) -> None:
    game = played(clock)
    found = restored(game.bytes)
    assert (found.kept, found.missing, found.complete) == (len(game.bytes), b"", False)
    ours, theirs = found.episode, game.episode
    assert (ours.step, ours.state.digest, ours.on_turn) == (
        theirs.step,
        theirs.state.digest,
        theirs.on_turn,
    )
    assert ours.step > 20
    assert len(found.said) == ours.said == theirs.said > 5
    for player in WORLD.players:
        one, two = ours.seat(player), theirs.seat(player)
        assert one.tally == two.tally
        assert (one.name, one.session, one.generation) == (two.name, two.session, two.generation)
        assert one.answer.reasons == two.answer.reasons
        assert not one.present
    assert ours.pauses.shown == (PauseReason.RESTART, 1010.0)


@thorough(40)
@given(st.data())
def test_a_file_that_was_cut_anywhere_goes_on_to_a_whole_recording(data: st.DataObject) -> None:
    game = played(data.draw(st.sampled_from(list(Clock))))
    begin = len(game.begin)
    cut = data.draw(st.integers(begin, len(game.bytes)))
    torn = data.draw(st.binary(max_size=30)) if cut == len(game.bytes) else b""
    found = restored(game.bytes[:cut] + torn[:7])
    assert found.kept <= cut
    told = max((step for size, step in game.marks if size <= cut), default=0)
    assert found.episode.step >= told, "a step that may have been told is lost"
    going = Game(game.rules.clock)
    going.episode, going.now, going.seq = found.episode, 1000.0, 10_000
    going.bytes = game.bytes[: found.kept] + found.missing
    going.flush()
    for player in WORLD.players:
        seat = going.episode.seat(player)
        if seat.taken:
            going.episode.set_present(player, True, 1001.0)
    going.now = 1002.0
    going.play(40, seed=5)
    going.episode.abort(2000.0, "the end")
    going.flush()
    recording = Recording(going.bytes)
    verification = recording.verify()
    assert verification.ok, verification.fault
    assert verification.complete
    times = [frame["t"] for frame in recording.steps]
    assert times == sorted(times)


def test_seats_that_were_free_are_free_and_who_was_absent_is_not_waited_for() -> None:
    game = Game(Clock.REALTIME).play(5)
    game.episode.set_present("robot2", False, game.now)
    game.flush()
    found = restored(game.bytes)
    found.episode.set_present("robot1", True, 1003.0)
    assert not found.episode.paused
    assert found.episode.seat("robot2").controller is Controller.ABSENT
    game.episode.leave("robot2", game.now)
    game.flush()
    assert not restored(game.bytes).episode.seat("robot2").taken


def test_all_who_were_there_are_waited_for_but_not_for_ever() -> None:
    episode = restored(Game(Clock.REALTIME).play(5).bytes).episode
    step = episode.step
    episode.set_present("robot1", True, 1001.0)
    episode.tick(1005.0)
    assert (episode.paused, episode.step) == (True, step)
    episode.tick(1010.0)
    assert not episode.paused
    episode.tick(1011.0)
    assert episode.step > step


def test_killed_between_the_last_step_and_the_outcome() -> None:
    game = Game(steps=12).play(30)
    assert game.episode.phase is Phase.ENDED
    frames = Recording(game.bytes).frames
    assert frames[-1]["kind"] == "footer"
    from robotouille.replay.container import pack_frame

    found = restored(game.bytes[: -len(pack_frame(frames[-1]))])
    assert found.episode.phase is Phase.ENDED
    assert found.episode.outcome is not None
    assert found.episode.outcome.to_json()["steps"] == 12
    assert restored(game.bytes).complete


def test_before_the_game_begins() -> None:
    game = Game()
    game.episode.join("robot1", "ada", "human", 3.0, session="s")
    game.flush()
    found = restored(game.bytes)
    assert found.episode.phase is Phase.WAITING
    assert found.episode.seat("robot1").taken
    assert found.episode.join(None, "bob", "human", 1001.0) == "robot2"


def test_a_recording_that_does_not_resimulate_is_refused() -> None:
    game = Game().play(20)
    frames = Recording(game.bytes).frames
    from robotouille.replay.container import MAGIC, pack_frame

    step = next(f for f in frames if f["kind"] == "step" and f.get("add"))
    step["add"] = []
    forged = MAGIC + b"".join(pack_frame(frame) for frame in frames)
    with pytest.raises(RecordingError, match="step"):
        restored(forged)


def test_zeros_behind_the_last_frame_are_cut_off_and_other_damage_is_not() -> None:
    from robotouille.replay.container import intact

    stream = Game().play(5).bytes
    assert intact(stream) == intact(stream + b"\0" * 5000) == len(stream)
    assert intact(stream[:-1]) < len(stream) - 1
    with pytest.raises(RecordingError, match="damaged"):
        restored(stream + b"\xff\x00\x00\x00 not a frame " + b"x" * 300)
