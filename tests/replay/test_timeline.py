"""Pauses, controllers and notes of a recording as data and as text."""

from robotouille import World
from robotouille.episode import Clock, Episode, PauseReason, Rules
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.timeline import course, course_text, interludes, note_lines, pauses
from tests.support.games import record


def recording(why: PauseReason = PauseReason.OPERATOR, seconds: float = 4.0) -> Recording:
    """Record three steps, a pause, a chat message and three more steps."""
    episode = Episode(World("multi_agent/01"), Rules(clock=Clock.REALTIME, step_rate=2.0))
    episode.join("robot1", "ada", "human", 0.0)
    episode.join("robot2", "bob", "model", 0.0)
    for step in range(1, 4):
        episode.tick(step / 2)
    episode.pause(why, 1.5)
    again = 1.5 + seconds
    episode.resume(why, again)
    episode.say("ada", "robot1", "hello", again)
    for step in range(1, 4):
        episode.tick(again + step / 2)
    episode.abort(again + 1.5, "enough")
    return Recording(record(episode, episode.events()))


def test_pause_has_step_reasons_and_length() -> None:
    (pause,) = pauses(recording())
    assert (pause.step, pause.holds, pause.seconds) == (3, ("operator",), 4.0)


def test_course_as_data() -> None:
    found = course(recording())
    assert found["controllers"].keys() == {"robot1", "robot2"}
    assert [pause["step"] for pause in found["pauses"]] == [3]
    assert found["restarts"] == []


def test_interlude_of_a_pause() -> None:
    ((step, words, _),) = interludes(recording())
    assert step == 3
    assert "operator" in words


def test_notes_as_text() -> None:
    lines = "\n".join(note_lines(recording()))
    assert "ada" in lines
    assert "hello" in lines


def test_players_own_pause_is_shown_without_a_reason() -> None:
    noted = recording(PauseReason.PLAYER, 21.706)
    assert [each.words for each in interludes(noted)] == ["Paused for 22 s"]
    assert any("by the player" in words for _, words in course_text(noted))


def test_countdown_is_recorded_with_the_time_of_day_and_shown_as_text() -> None:
    world = World("multi_agent/01")
    rules = Rules(clock=Clock.REALTIME, step_rate=10.0, countdown=3.0)
    recorder, episode = Recorder(world, wall=lambda: 1000.0), Episode(world, rules)
    content = recorder.begin(header(world.task, rules, episode="e"))
    episode.join("robot1", "ada", "human", 5.0)
    episode.join("robot2", "bob", "human", 5.0)
    episode.set_present("robot2", False, 6.0)
    episode.set_present("robot2", True, 7.0)
    episode.tick(10.5)
    recording = Recording(content + recorder.record(episode.events()))
    notes = [note for note in recording.notes() if note["note"] == "countdown"]
    found = [(note.get("ms"), note["t"], note["utc_ms"]) for note in notes]
    assert found == [(3000, 0, 1_000_000), (None, 0, 1_000_000), (3000, 0, 1_000_000)]
    text = "\n".join(note_lines(recording))
    assert "the game starts in 3 s" in text
    assert text.index("the countdown stops") < text.rindex("the game starts")
