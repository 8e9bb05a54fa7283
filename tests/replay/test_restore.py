"""Recovery of episodes from recordings that were cut off anywhere."""

from __future__ import annotations

from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import RecordingError, World
from robotouille.episode import (
    Absence,
    ActionRequest,
    Clock,
    Controller,
    Episode,
    Event,
    PauseReason,
    Phase,
    Reason,
    Rules,
)
from robotouille.replay import container
from robotouille.replay.container import MAGIC, pack_frame
from robotouille.replay.recorder import HeaderDetails, Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restoration, Restored, restore
from tests.support.games import outcome, random_choice
from tests.support.samples import quick_sample
from tests.support.thorough import thorough

WORLD = World("multi_agent/02")


class Game:
    """Recorded episode with chat and lost connections."""

    def __init__(self, clock: Clock = Clock.LOCKSTEP, steps: int = 5000) -> None:
        self.rules = Rules(clock=clock, max_steps=steps, step_rate=10.0)
        self.episode = Episode(WORLD, self.rules, 0.0)
        head = header(
            WORLD.task, self.rules, episode="e", details=HeaderDetails("ABCDE-FGHJK", "study")
        )
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
                episode.submit(player, ActionRequest(self.seq, choose(episode, player)), self.now)
                self.flush()
        if self.seq % 9 == 0 and episode.phase is not Phase.ENDED:
            episode.submit(
                "robot1",
                ActionRequest(self.seq + 1, WORLD.action("move", "robot1", "table1", "table1")),
                self.now,
            )
            self.seq += 1
        if self.seq % 7 == 0 and episode.phase is not Phase.ENDED:
            episode.say("ROBOT1", "robot1", f"number {self.seq}", self.now)
        if self.seq % 11 == 0:
            episode.set_present("robot2", False, self.now)
            self.flush()
            episode.set_present("robot2", True, self.now, generation=self.seq)
        if self.seq % 13 == 0 and episode.phase is not Phase.ENDED:
            episode.take_over("robot2", "bot", self.now, session=f"session-{self.seq}")
        episode.tick(self.now)
        self.flush()


def restored(content: bytes, now: float = 1000.0) -> Restored:
    return restore(Recording(content), now, 10.0)


@cache
def played(clock: Clock) -> Game:
    """Return a game that tests must not change."""
    return Game(clock).play(130)


@pytest.mark.parametrize("clock", list(Clock))
def test_restored_episode_equals_the_original(clock: Clock) -> None:
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
    assert len(found.said) == ours.record.said == theirs.record.said > 5
    for player in WORLD.players:
        one, two = ours.seat(player), theirs.seat(player)
        assert one.tally == two.tally
        assert (one.name, one.session, one.generation) == (two.name, two.session, two.generation)
        assert (one.seq, one.answer.reasons) == (two.seq, two.answer.reasons)
        assert not one.present
    assert ours.pauses.shown == (PauseReason.RESTART, 1010.0)


def extended(recording: Recording, stream: bytes) -> Recording:
    """Read the recording of a stream that has more frames."""
    reading = recording.extending(stream)
    while True:
        try:
            next(reading)
        except StopIteration as end:
            assert isinstance(end.value, Recording)
            return end.value


def continued(first: bytes, whole: bytes, *, but_last: int = 2) -> Restored | None:
    """Restore the beginning of a recording, then the rest, or return None if they differ."""
    restoration = Restoration(Recording(first), 900.0)
    for _ in restoration.replay(but_last=but_last):
        pass
    if not restoration.continue_with(extended(restoration.recording, whole)):
        return None
    for _ in restoration.replay():
        pass
    return restoration.finish(1000.0, 10.0)


def facts(found: Restored) -> tuple[object, ...]:
    """Return what is equal in two episodes that were restored from one recording."""
    episode = found.episode
    seats = [
        (seat.name, seat.session, seat.generation, seat.seq, seat.present, seat.away)
        for seat in map(episode.seat, WORLD.players)
    ]
    state = (episode.step, episode.state.digest, episode.on_turn, episode.step_began)
    return (
        found.kept,
        found.missing,
        found.complete,
        found.said,
        state,
        seats,
        episode.pauses.shown,
    )


@pytest.mark.parametrize("clock", quick_sample(reversed(Clock)))
def test_episode_is_restored_while_its_recording_grows(clock: Clock) -> None:
    game = played(clock)
    whole = facts(restored(game.bytes))
    for cut in [len(game.begin), *(size for size, _ in game.marks[3::150]), len(game.bytes) - 3]:
        found = continued(game.bytes[:cut], game.bytes)
        assert found is not None
        assert facts(found) == whole


def test_recording_that_begins_differently_is_not_continued() -> None:
    first, other = Game().play(20), Game().play(21, seed=1)
    assert continued(first.bytes, other.bytes) is None


@thorough(40)
@given(st.data())
def test_recording_that_is_extended_equals_the_whole_one(data: st.DataObject) -> None:
    game = played(data.draw(st.sampled_from(list(Clock))))
    other = data.draw(st.booleans())
    whole = Game().play(21, seed=1).bytes if other else game.bytes
    cut = data.draw(st.integers(len(game.begin), len(game.bytes)))
    first, expected = Recording(game.bytes[:cut]), Recording(whole)
    found = extended(first, whole)
    for name in ("header", "whole", "length", "count", "totals", "outcome"):
        assert getattr(found, name) == getattr(expected, name)
    assert found.frames == expected.frames
    assert first.frames == Recording(game.bytes[:cut]).frames


def test_limits_of_a_recording_count_what_it_had_before_it_was_extended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    game = played(Clock.REALTIME)
    first = Recording(game.bytes)
    monkeypatch.setattr(container, "MAX_NOTES", first.totals.notes)
    note = pack_frame({"kind": "notes", "notes": [{}]})
    with pytest.raises(RecordingError, match="more than"):
        extended(first, game.bytes + note)


@pytest.mark.slow
@thorough(40)
@given(st.data())
def test_episode_goes_on_from_a_recording_cut_off_anywhere(data: st.DataObject) -> None:
    game = played(data.draw(st.sampled_from(list(Clock))))
    begin = len(game.begin)
    cut = data.draw(st.integers(begin, len(game.bytes)))
    torn = data.draw(st.binary(max_size=30)) if cut == len(game.bytes) else b""
    found = restored(game.bytes[:cut] + torn[:7])
    assert found.kept <= cut
    expected = max((step for size, step in game.marks if size <= cut), default=0)
    assert found.episode.step >= expected, "a published step is lost"
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


def test_free_seats_stay_free_and_absent_participants_are_not_awaited() -> None:
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


def test_present_participants_are_awaited_for_the_patience() -> None:
    episode = restored(Game(Clock.REALTIME).play(5).bytes).episode
    step = episode.step
    episode.set_present("robot1", True, 1001.0)
    episode.tick(1005.0)
    assert (episode.paused, episode.step) == (True, step)
    episode.tick(1010.0)
    assert not episode.paused
    episode.tick(1011.0)
    assert episode.step > step


def test_process_killed_between_last_step_and_outcome() -> None:
    game = Game(steps=12).play(30)
    assert game.episode.phase is Phase.ENDED
    frames = Recording(game.bytes).frames
    assert frames[-1]["kind"] == "footer"
    found = restored(game.bytes[: -len(pack_frame(frames[-1]))])
    assert found.episode.phase is Phase.ENDED
    assert found.episode.outcome is not None
    assert found.episode.outcome.to_json()["steps"] == 12
    assert restored(game.bytes).complete


def test_episode_that_has_not_started() -> None:
    game = Game()
    game.episode.join("robot1", "ada", "human", 3.0, session="s")
    game.flush()
    found = restored(game.bytes)
    assert found.episode.phase is Phase.WAITING
    assert found.episode.seat("robot1").taken
    assert found.episode.join(None, "bob", "human", 1001.0) == "robot2"


def test_recording_that_does_not_resimulate_is_refused() -> None:
    game = Game().play(20)
    frames = Recording(game.bytes).frames
    step = next(f for f in frames if f["kind"] == "step" and f.get("add"))
    step["add"] = []
    forged = MAGIC + b"".join(pack_frame(frame) for frame in frames)
    with pytest.raises(RecordingError, match="step"):
        restored(forged)


def test_countdown_starts_again_once_all_participants_are_back() -> None:
    rules = Rules(clock=Clock.REALTIME, step_rate=10.0, countdown=3.0)
    recorder, episode = Recorder(WORLD), Episode(WORLD, rules)
    content = recorder.begin(header(WORLD.task, rules, episode="e"))
    for player in WORLD.players:
        episode.join(player, player, "human", 5.0, session=player)
    assert episode.starts_at == 8.0
    content += recorder.record(episode.events())
    episode = restored(content, now=100.0).episode
    for now, player in enumerate(WORLD.players, 101):
        assert (episode.in_progress, episode.starts_at) == (False, None)
        episode.set_present(player, True, float(now))
    assert episode.starts_at == 105.0
    episode.tick(105.0)
    assert episode.running


@pytest.mark.parametrize("expected", [True, False])
def test_two_restarts_in_a_row_wait_for_the_same_participants(expected: bool) -> None:
    game = Game(Clock.REALTIME).play(5)
    found = restored(game.bytes, now=100.0)
    game.episode, game.bytes = found.episode, game.bytes[: found.kept] + found.missing
    if expected:
        game.episode.set_present("robot2", True, 100.2)
    game.flush()
    episode = restored(game.bytes, now=100.5).episode
    step = episode.step
    episode.set_present("robot1", True, 101.0)
    episode.tick(104.0)
    assert episode.pauses.shown == (PauseReason.RESTART, 110.5)
    episode.set_present("robot2", True, 105.0)
    episode.tick(106.0)
    assert episode.step > step


def test_operators_pause_outlives_a_restart() -> None:
    game = Game(Clock.REALTIME).play(5)
    game.episode.pause(PauseReason.OPERATOR, game.now)
    game.flush()
    episode = restored(game.bytes, now=100.0).episode
    for player in WORLD.players:
        episode.set_present(player, True, 101.0)
    step = episode.step
    episode.tick(200.0)
    assert (episode.pauses.shown, episode.step) == ((PauseReason.OPERATOR, None), step)
    episode.resume(PauseReason.OPERATOR, 200.0)
    episode.tick(201.0)
    assert episode.step > step


def test_decision_to_do_nothing_is_taken_once() -> None:
    """Clients send a request again if the process stopped before it answered."""
    game = Game(Clock.LOCKSTEP).play(0)
    for player in WORLD.players:
        game.episode.submit(player, ActionRequest(1), 1.0)
    game.flush()
    episode = restored(game.bytes).episode
    for player in WORLD.players:
        episode.set_present(player, True, 1001.0)
    for seq in (1, 2):
        for player in WORLD.players:
            episode.submit(player, ActionRequest(seq), 1002.0)
        assert episode.step == seq


def test_absent_participant_has_the_whole_grace_after_a_restart() -> None:
    rules = Rules(clock=Clock.REALTIME, step_rate=10.0, grace=5.0, absence=Absence.PAUSE)
    recorder, episode = Recorder(WORLD), Episode(WORLD, rules)
    content = recorder.begin(header(WORLD.task, rules, episode="e"))
    for player in WORLD.players:
        episode.join(player, player, "human", 0.0, session=player)
    episode.set_present("robot2", False, 1.0)
    episode = restored(content + recorder.record(episode.events()), now=100.0).episode
    episode.set_present("robot1", True, 107.0)
    episode.tick(107.0)
    assert episode.in_progress
    assert episode.pauses.shown == (PauseReason.ABSENCE, 112.0)
    episode.tick(112.0)
    assert outcome(episode)[0] is Reason.ABANDONED
