"""What happened besides the steps: pauses, who was in control, and words for it."""

from robotouille import World
from robotouille.episode import Clock, Episode, PauseReason, Rules
from robotouille.replay.recording import Recording
from robotouille.replay.timeline import course, course_text, interludes, note_lines, pauses
from tests.support.games import record


def recording(why: PauseReason = PauseReason.OPERATOR, seconds: float = 4.0) -> Recording:
    """Two steps a second: three of them, seconds of a pause, a word, three more."""
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


def test_a_pause_has_a_place_a_reason_and_a_length() -> None:
    (pause,) = pauses(recording())
    assert (pause.step, pause.holds, pause.seconds) == (3, ("operator",), 4.0)


def test_the_course_as_data() -> None:
    found = course(recording())
    assert found["controllers"].keys() == {"robot1", "robot2"}
    assert [pause["step"] for pause in found["pauses"]] == [3]
    assert found["restarts"] == []


def test_the_course_in_words() -> None:
    text = dict(course_text(recording()))
    assert any("by the operator" in words for words in text.values())


def test_what_a_film_shows_between_steps() -> None:
    ((step, words, _),) = interludes(recording())
    assert step == 3
    assert "operator" in words


def test_notes_in_words() -> None:
    lines = "\n".join(note_lines(recording()))
    assert "ada" in lines
    assert "hello" in lines


def test_what_was_the_players_own_pause_is_told_in_whole_seconds_and_without_a_reason() -> None:
    noted = recording(PauseReason.PLAYER, 21.706)
    assert [each.words for each in interludes(noted)] == ["Paused for 22 s"]
    assert any("by the player" in words for _, words in course_text(noted))
