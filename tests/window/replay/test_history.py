"""Recorded history: lanes, states, seats, marks, log and the replay source."""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path
from weakref import WeakSet

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.games import play_through, record, recorded_game
from tests.support.thorough import thorough
from tests.support.window_play import headless_window

from robotouille import World, load_task
from robotouille.certification.certificate import load_certificate
from robotouille.domain.rendering import Language
from robotouille.episode import TEAM_TOPIC, Clock, Episode, Event, Rules
from robotouille.episode.tallies import Activity
from robotouille.planning import read_plan
from robotouille.planning.policies.team_talk import announcement
from robotouille.replay.controllers import seatings
from robotouille.replay.recording import Recording
from robotouille.replay.timeline import Interlude
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.timers import Timers
from robotouille_client.window.replay.histories import history as history_module
from robotouille_client.window.replay.histories import recorded_history, recorded_states
from robotouille_client.window.replay.histories.history import (
    MAX_NOTICE,
    EntryKind,
    History,
    bubbles_at,
    notices_at,
)
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory
from robotouille_client.window.replay.viewer import RecordingViewer, ReplaySource
from robotouille_client.window.replay.viewer_state import Playhead, ViewerState


@pytest.fixture(scope="module")
def history(recording: Recording) -> RecordedHistory:
    return RecordedHistory(recording)


def test_lanes_agree_with_the_outcome(history: RecordedHistory) -> None:
    kinds: set[str] = set()
    for tally in history.outcome["seats"]:
        player = tally["player"]
        steps = range(1, history.length + 1)
        counts = Counter(history.activity(player, step).value for step in steps)
        assert {each.value: counts[each.value] for each in Activity} == {
            each.value: tally[each.value] for each in Activity
        }
        kinds |= set(counts)
        last = history.seats(history.length)[history.world.players.index(player)]
        assert (last.actions, last.rejected) == (tally["acted"], tally["rejected"])
    assert {"acted", "idle", "substituted"} <= kinds


@pytest.mark.parametrize("clock", [Clock.TURN, Clock.LOCKSTEP])
def test_states_equal_those_of_a_simulation(clock: Clock) -> None:
    """Check steps in any order, on and around the full states."""
    recording = Recording(recorded_game("multi_agent/07@3", clock=clock, steps=330))
    history = RecordedHistory(recording)
    states = dict(recording.states())
    assert history.length == 330
    steps = [330, 0, 100, 99, 101, 200, 199, 329, *range(150, 120, -1), 5]
    assert all(history.state(step) == states[step] for step in steps)
    assert [history.state(step) for step in range(331)] == list(states.values())


def test_states_with_created_objects() -> None:
    # Soup is created, so that the tables of later full states have grown.
    recording = Recording(recorded_game("asynchronous/09", steps=400, seed=3))
    history = RecordedHistory(recording)
    for step, state in reversed(list(recording.states())):
        assert history.state(step) == state


def test_only_few_large_states_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hostile recording makes large states of small frames, and 512 of them were kept."""
    monkeypatch.setattr(recorded_states, "MAX_KEPT_BYTES", 1_500)
    task = "asynchronous/10"
    text = "\n".join(load_certificate(load_task(task)).plan or ())
    actions = (action for (action,) in read_plan(text, World(task)))
    rules = Rules(max_steps=100)
    history = RecordedHistory(
        Recording(record(*play_through(task, rules, lambda *_: next(actions))))
    )
    steps = range(history.length + 1)
    digests, timers, seen = dict[int, str](), WeakSet[Timers](), set[str]()
    for step in [*steps, *reversed(steps)]:
        state = history.state(step)
        assert state.digest == digests.setdefault(step, state.digest)
        seen.add(str(state.timers.rows()))
        timers.add(state.timers)
        assert len(timers) <= 6
    assert len(seen) > 15


def test_seats_by_step(history: RecordedHistory, recording: Recording) -> None:
    course = [history.seats(step)[1].moved_by for step in range(history.length + 1)]
    assert course[:8] == ["person"] * 3 + ["random plays for bob"] * 4 + ["person"]
    assert set(course[8:]) == {"person"}
    for step, seats in seatings(recording):
        assert [seat.name for seat in history.seats(step)] == [s.name for s in seats.values()]


def test_marks_and_entries(history: RecordedHistory) -> None:
    marks = {(mark.kind, mark.step, mark.player) for mark in history.marks}
    assert (EntryKind.SAID, 8, "robot1") in marks
    assert (EntryKind.REJECTED, 10, "robot1") in marks
    assert (EntryKind.REASONING, 13, "robot1") in marks
    assert (EntryKind.PAUSED, 20, "") in marks
    assert (EntryKind.ANNOUNCED, 20, "") in marks
    assert (EntryKind.ENDED, history.length, "") in marks
    rejected = [e for e in history.entries(10) if e.kind is EntryKind.REJECTED]
    assert len(rejected) == 1
    assert rejected[0].reasons
    said = [e.words for e in history.entries(8) if e.kind is EntryKind.SAID]
    assert said == ["the bun is yours"]
    assert [e.words for e in history.entries(13)][0] == "this first"
    assert history.entries(history.length)[-1].words == "Time is up after 40 steps"
    assert "bob (robot2) is away, a substitute plays" in [e.words for e in history.entries(2)]


def test_the_log_uses_the_viewers_words(path: Path, recording: Recording) -> None:
    words = Language.model_validate({"kinds": {"table": "Tisch"}})

    def log(history: History) -> str:
        return str([history.entries(step) for step in range(history.length + 1)])

    plain, own = log(RecordedHistory(recording)), log(RecordedHistory(recording, words))
    assert " table" in plain and "Tisch" not in plain
    assert "Tisch" in own
    make = partial(headless_window, (1280, 720))
    viewer = RecordingViewer([(path, recording)], make_window=make, words=words)
    try:
        assert log(viewer.histories[0]) == own
    finally:
        viewer.close()


def test_events_of_a_step_and_marks_are_bounded(
    monkeypatch: pytest.MonkeyPatch, recording: Recording
) -> None:
    monkeypatch.setattr(recorded_history, "MAX_NOTED", 1)
    monkeypatch.setattr(history_module, "MAX_MARKS", 3)
    history = RecordedHistory(recording)
    assert len(history.marks) == 3
    assert len(history.entries(0)) == 1
    monkeypatch.setattr(recorded_history, "MAX_NOTED", 100)
    monkeypatch.setattr(recorded_history, "MAX_WORDS", 3)
    said = [e.words for e in RecordedHistory(recording).entries(8) if e.kind is EntryKind.SAID]
    assert said == ["the"]


def test_interludes_are_bounded(monkeypatch: pytest.MonkeyPatch, recording: Recording) -> None:
    monkeypatch.setattr(recorded_history, "MAX_INTERLUDES", 1)
    assert len(RecordedHistory(recording).interludes) == 1


def test_messages_between_bots_are_hidden() -> None:
    world = World("synchronous/01")
    episode = Episode(world, Rules(clock=Clock.TURN, max_steps=2))
    events: list[Event] = []
    episode.join("robot1", "ada", "human", 0.0)
    episode.say("ada", "robot1", "hello", 0.0)
    episode.note("robot1", TEAM_TOPIC, announcement().text, 0.0)
    events += episode.events()
    history = RecordedHistory(Recording(record(episode, events)))
    said = [entry.words for entry in history.entries(0) if entry.kind is EntryKind.SAID]
    assert said == ["hello"]
    assert [text for _, text in history.chat(0, 6)] == ["hello"]
    assert sum(mark.kind is EntryKind.SAID for mark in history.marks) == 1


def test_announcements_outlast_pauses(history: RecordedHistory) -> None:
    notices = notices_at(history.interludes, 2)
    assert set(notices) == {20, 21}
    assert notices[20] == "Paused for 7 s: by the operator · The operator: lunch"
    assert notices[21] == "The operator: lunch"
    assert notices_at(history.interludes, 0).keys() == {20}


def notices_one_by_one(interludes: list[Interlude], steps: int) -> dict[int, str]:
    """Compute `notices_at` without its bounds."""
    notices: dict[int, str] = {}
    for step, words, lasts in interludes:
        for later in range(step, step + (max(1, steps) if lasts else 1)):
            first = later > step or step not in notices
            notices[later] = words if first else f"{notices[step]} · {words}"
    return notices


@thorough(100)
@given(st.lists(st.tuples(st.integers(0, 12), st.booleans()), max_size=8), st.integers(0, 5))
def test_notices_equal_those_made_one_by_one(told: list[tuple[int, bool]], steps: int) -> None:
    interludes = [Interlude(step, f"n{i}", lasts) for i, (step, lasts) in enumerate(sorted(told))]
    assert notices_at(interludes, steps) == notices_one_by_one(interludes, steps)


def test_notices_of_many_announcements_are_cut() -> None:
    (notice,) = set(notices_at([Interlude(3, "hello")] * 5000, 1).values())
    assert len(notice) == MAX_NOTICE + 1


def test_bubbles_last_three_steps(history: RecordedHistory) -> None:
    assert [bubble.text for bubble in bubbles_at(history, 8)] == ["the bun is yours"]
    assert bubbles_at(history, 10)[0].kind == "rejected"
    assert not bubbles_at(history, 7)
    assert not bubbles_at(history, 30)


def test_the_source_shows_the_step_of_the_playhead(history: RecordedHistory) -> None:
    now = [0.0]
    playhead = Playhead(lambda: history.length, 2.0, lambda: now[0])
    source = ReplaySource(history, playhead, ViewerState(lambda: now[0]))
    now[0] = 2.25
    view = source.view()
    assert (view.step, view.phase) == (5, 0.5)
    assert view.previous == history.state(4)
    assert view.seats[1].substitute == "random"
    playhead.seek(20)
    assert "lunch" in source.view().notice
    now[0] = 1000.0
    assert source.finished
    assert source.view().outcome == "Time is up after 40 steps"
    assert source.view().chat == (("ada", "the bun is yours"), ("", "lunch"))


def test_a_signal_is_framed_in_the_replay() -> None:
    world = World("multi_agent/01@2")
    episode = Episode(world, Rules(clock=Clock.TURN))
    for player in world.players:
        episode.join(player, player, "human", 0.0)
    episode.signal("ada", "robot1", Signal(Intent.NEED, "lettuce1"), 1.0)
    history = RecordedHistory(Recording(record(episode, list(episode.events()))))
    (bubble,) = bubbles_at(history, 0)
    assert (bubble.player, bubble.target) == ("robot1", "lettuce1")
    assert "lettuce" in bubble.text
