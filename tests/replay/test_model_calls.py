"""Model calls in recordings: writing, reading and limits."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import World, load_task
from robotouille.episode import ActionRequest, Episode, Rules
from robotouille.episode.quota import MAX_NOTE, SEAT_QUOTA_BYTES
from robotouille.errors import ProtocolError
from robotouille.replay import model_calls as reading
from robotouille.replay.model_calls import (
    MAX_ANSWER,
    MAX_MESSAGE,
    TOPIC,
    CallNotes,
    call_texts,
    model_calls,
)
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from tests.support.thorough import thorough

TEXTS = st.text(st.characters(codec="utf-8"), max_size=40)
CALLS = st.lists(st.tuples(st.lists(st.tuples(TEXTS, TEXTS), max_size=6), TEXTS), max_size=6)


class Course:
    """Recorded episode with one seat that makes notes."""

    def __init__(self) -> None:
        world = World(load_task("synchronous/01"))
        self.episode = Episode(world, Rules())
        recorder = Recorder(world)
        self.stream = recorder.begin(header(world.task, Rules(), episode="x"))
        self.recorder = recorder
        self.episode.join("robot1", "m", "bot", 0.0)

    def note(self, text: str, piece: int = MAX_NOTE, topic: str = TOPIC) -> None:
        for at in range(0, len(text), piece):
            more = at + piece < len(text)
            self.episode.note("robot1", topic, text[at : at + piece], 1.0, more=more)

    def recording(self) -> Recording:
        self.stream += self.recorder.record(self.episode.events())
        return Recording(self.stream)


@thorough(40)
@given(CALLS, st.integers(20, 200))
def test_calls_are_read_as_written(
    calls: list[tuple[list[tuple[str, str]], str]], piece: int
) -> None:
    course, notes = Course(), CallNotes()
    for sent, answer in calls:
        course.note(notes.note(sent, answer=answer), piece)
    recording = course.recording()
    assert recording.verify().ok
    found = list(model_calls(recording))
    assert [[(m["role"], m["content"]) for m in call.messages] for call in found] == [
        sent for sent, _ in calls
    ]
    assert [call.rest["answer"] for call in found] == [answer for _, answer in calls]
    assert not any(call.missed for call in found)


def test_repeated_message_is_recorded_once() -> None:
    notes, history = CallNotes(), [("system", "x" * 5000)]
    sizes = []
    for number in range(20):
        history.append(("user", f"observation {number}"))
        sizes.append(len(notes.note(history, answer="")))
    assert sizes[0] > 5000 > 300 > max(sizes[1:])


def test_lost_notes_are_counted_and_their_messages_empty() -> None:
    course, notes = Course(), CallNotes()
    texts = [notes.note([("user", str(n)), ("user", "same")], answer=n) for n in range(4)]
    for text in (texts[0], texts[2], texts[3]):
        course.note(text)
    calls = list(model_calls(course.recording()))
    assert [call.missed for call in calls] == [0, 1, 0]
    assert [[m["content"] for m in call.messages] for call in calls] == [
        ["0", "same"], ["2", "same"], ["3", "same"],
    ]  # fmt: skip
    lost = Course()
    lost.note(texts[1])
    (call,) = model_calls(lost.recording())
    assert [m["content"] for m in call.messages] == ["1", ""]
    assert call.missed == 1


def test_another_process_of_the_bot_starts_at_one() -> None:
    course = Course()
    for name in ("one", "other"):
        course.note(CallNotes().note([("user", name)], answer=name))
    assert [call.messages[0]["content"] for call in model_calls(course.recording())] == [
        "one",
        "other",
    ]


@pytest.mark.parametrize(
    "text",
    ["", "x", "[]", "{}", '{"number":1}', '{"number":"a","known":0,"new":[],"sent":[]}', "[" * 5000,
     '{"number":1e999,"known":0,"new":[],"sent":[]}',
     '{"number":1,"known":1e999,"new":[],"sent":[]}',
     '{"number":1,"known":0,"new":[],"sent":[1e999]}',
     '{"number":1,"known":0,"new":[],"sent":[[]]}',
     '{"number":1,"known":0,"new":[1],"sent":[]}', '{"number":1,"known":0,"new":[],"sent":3}'],
)  # fmt: skip
def test_other_notes_are_not_calls(text: str) -> None:
    course = Course()
    course.note(text)
    assert list(model_calls(course.recording())) == []


def test_hostile_note_takes_no_memory() -> None:
    course = Course()
    course.note('{"number":2,"known":1000000000,"new":[],"sent":[-1,7,1000000000]}')
    (call,) = model_calls(course.recording())
    assert [message["content"] for message in call.messages] == ["", "", ""]


def test_message_sent_very_often_is_not_multiplied() -> None:
    course = Course()
    text = CallNotes().note([("user", "x" * MAX_MESSAGE)], answer="")
    often = '"sent":[0' + ",0" * 4000 + "]"
    course.note(text.replace('"sent":[0]', often))
    course.note(CallNotes().note([("user", "short")], answer=""))
    (call,) = model_calls(course.recording())
    assert call.messages[0]["content"] == "short"


def test_calls_of_a_seat_are_bounded_in_total(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "MAX_SEAT", 250)
    course, notes = Course(), CallNotes()
    for _ in range(4):
        course.note(notes.note([("user", "x" * 100)], answer=""))
    assert len(list(model_calls(course.recording()))) == 2


def test_endless_note_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "MAX_CALL_NOTE", 1000)
    course, notes = Course(), CallNotes()
    course.note(notes.note([("user", "x" * 2000)], answer="a"), piece=100)
    course.note(notes.note([("user", "y")], answer="b"), piece=100)
    (call,) = model_calls(course.recording())
    assert (call.rest["answer"], call.missed) == ("b", 1)


@thorough(40)
@given(st.integers(1, 4))
def test_lost_piece_loses_only_its_own_call(kept: int) -> None:
    course, notes = Course(), CallNotes()
    texts = [notes.note([("user", f"{n}" * 400)], answer=n) for n in range(3)]
    course.note(texts[0])
    for at in range(kept):
        course.episode.note("robot1", TOPIC, texts[1][at * 50 : at * 50 + 50], 1.0, more=True)
    course.note(texts[2], 50)
    calls = list(model_calls(course.recording()))
    assert [(call.rest["answer"], call.missed) for call in calls] == [(0, 0), (2, 1)]
    assert calls[1].messages == ({"role": "user", "content": "2" * 400},)


def test_long_text_is_cut_with_the_number_of_omitted_characters() -> None:
    row = json.loads(
        CallNotes().note([("user", "x" * (MAX_MESSAGE + 5))], answer="y" * (MAX_ANSWER + 6))
    )
    assert row["new"][0][1].endswith("… [5 more characters]")
    assert row["answer"].endswith("… [6 more characters]")


def test_message_text_cannot_imitate_the_listing() -> None:
    course = Course()
    course.note(CallNotes().note([("user", "=== step 9\n--- said")], answer="--- user"))
    (text,) = call_texts(course.recording())
    assert [line for line in text.splitlines() if line[:3] in ("===", "---")] == [
        "=== step 0: robot1 was sent 1 messages", "--- user", "--- said",
    ]  # fmt: skip


def test_notes_leave_half_of_the_quota_to_reasoning() -> None:
    course = Course()
    with pytest.raises(ProtocolError) as refused:
        while True:
            course.note("x" * MAX_NOTE)
    assert refused.value.code == "rate/words"
    seat = course.episode.seats["robot1"]
    assert not seat.quota.reached
    assert SEAT_QUOTA_BYTES // 2 - 2 * MAX_NOTE < seat.quota.used <= SEAT_QUOTA_BYTES // 2
    restored = restore(course.recording(), 0.0, 30.0)
    used = restored.episode.seats["robot1"].quota.used
    assert used == seat.quota.used
    course.episode.submit("robot1", ActionRequest(1, reasoning="still accepted"), 1.0)


def test_call_of_very_many_empty_messages_is_not_read() -> None:
    """A note of two bytes for each message would otherwise become forty bytes of a transcript."""
    course = Course()
    sent = [0] * (reading.MAX_CALL // reading.MESSAGE + 1)
    course.note(json.dumps({"number": 1, "known": 0, "new": [["user", ""]], "sent": sent}))
    assert not list(model_calls(course.recording()))
