"""Timelines and notes of recordings."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

from robotouille import ProtocolError, RecordingError, World
from robotouille.episode import ActionRequest, Clock, Episode, PauseReason, Rules
from robotouille.replay.controllers import json_lines
from robotouille.replay.frame_schema import MAX_HOLDS
from robotouille.replay.measures import controller_of, rejections
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


class CountedText(str):
    """Text that counts how often it is hashed, and so how often it is compared."""

    hashed = 0

    def __hash__(self) -> int:
        CountedText.hashed += 1
        return super().__hash__()


def test_reasons_of_many_pauses_are_joined_once_and_bounded() -> None:
    holds = [CountedText(number) for number in range(500)]

    class Notes:
        outcome = None

        def notes(self) -> Iterator[dict[str, Any]]:
            for hold in holds:
                yield {"note": "paused", "step": 1, "t": 2, "holds": [hold]}

    CountedText.hashed = 0
    (pause,) = pauses(Notes())
    assert pause.holds == tuple(holds[:MAX_HOLDS])
    assert CountedText.hashed < 10 * len(holds)


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


WORLD = World("synchronous/01")
BAD = "place-item(robot1, cheese1, table1)"


def recorded(*, ended: bool) -> tuple[Episode, bytes]:
    """Record eight requests of a model. Only the last one is a valid action."""
    rules = Rules(max_steps=9)
    episode = Episode(WORLD, rules)
    episode.join("robot1", "ada", "model", 0.0)
    for seq, text in enumerate(["Boil the sea", BAD, BAD, "", "🍕", "I do not know"], 1):
        episode.submit("robot1", ActionRequest(seq, text, reasoning=f"thought {seq}"), float(seq))
    episode.reject(
        "robot1", ActionRequest(7, "99"), ProtocolError("action/stale", "step 0 is past"), 7.0
    )
    episode.submit("robot1", ActionRequest(8, WORLD.initial.actions("robot1")[0].sentence), 8.0)
    if ended:
        episode.abort(9.0, "enough")
    return episode, record(episode, episode.events())


def notes(recording: Recording) -> list[dict[str, Any]]:
    return [note for note in recording.notes() if note["note"] == "rejected"]


def test_rejected_requests_are_recorded_with_text_reasoning_and_reasons() -> None:
    recording = Recording(recorded(ended=True)[1])
    assert recording.verify().ok
    found = notes(recording)
    assert [note.get("text", note["action"]) for note in found] == [
        "Boil the sea", BAD, BAD, "", "🍕", "I do not know", "99",
    ]  # fmt: skip
    assert [note.get("reasoning") for note in found[:6]] == [f"thought {i}" for i in range(1, 7)]
    assert [note.get("code", "") for note in found[::2]] == [
        "action/unknown", "", "action/unknown", "action/stale",
    ]  # fmt: skip
    assert found[1]["action"] == "Put down cheese1 at table1 with robot1"
    why = {"kind": "condition", "predicate": "has_item", "objects": ["robot1", "cheese1"]}
    assert why in found[1]["why"]
    assert len(found[1]["why"]) == len(found[1]["reasons"])
    assert "why" not in found[0]


def test_rejected_requests_are_counted_in_outcome_and_export() -> None:
    recording = Recording(recorded(ended=True)[1])
    assert recording.outcome is not None
    (seat,) = recording.outcome["seats"]
    assert (seat["acted"], seat["rejected"]) == (1, 7)
    assert (seat["invalid"], seat["malformed"]) == (3, 4)
    assert rejections(recording) == {"robot1": {"invalid": 3, "malformed": 4}}
    rows = [json.loads(line) for line in json_lines(recording)]
    kinds = [row["rejection"] for row in rows if "rejection" in row]
    assert kinds.count("invalid") == 3
    assert kinds.count("malformed") == 4


def test_unknown_controller_is_refused() -> None:
    with pytest.raises(RecordingError, match="ghost"):
        controller_of({"controller": "ghost"})
