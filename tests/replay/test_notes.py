"""What was asked for in vain is in the recording, counted, and there after a restart."""

from __future__ import annotations

import json
from typing import Any

import pytest

from robotouille import ProtocolError, RecordingError, World
from robotouille.episode import Controller, Episode, Rules
from robotouille.replay.container import magic, pack_frame
from robotouille.replay.export import json_lines
from robotouille.replay.notes import controller_after, rejections
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore

WORLD = World("synchronous/01")
BAD = "place-item(robot1, cheese1, table1)"


def recorded(*, ended: bool) -> tuple[Episode, bytes]:
    """A model that says seven things, of which one is a valid action."""
    rules = Rules(max_steps=9)
    episode, recorder = Episode(WORLD, rules), Recorder(WORLD)
    stream = recorder.begin(header(WORLD.task, rules, episode="e"))
    episode.join("robot1", "ada", "model", 0.0)
    for seq, text in enumerate(["Boil the sea", BAD, BAD, "", "🍕", "I do not know"], 1):
        episode.submit("robot1", seq, text, float(seq), reasoning=f"thought {seq}")
    episode.reject("robot1", 7, "99", ProtocolError("action/stale", "step 0 is past"), 7.0)
    episode.submit("robot1", 8, WORLD.initial.actions("robot1")[0].sentence, 8.0)
    if ended:
        episode.abort(9.0, "enough")
    return episode, stream + recorder.record(episode.events())


def without_what_is_new(stream: bytes) -> bytes:
    """The recording as an earlier version wrote it."""
    recording = Recording(stream)
    frames: list[dict[str, Any]] = []
    for frame in recording.each_frame():
        if frame["kind"] == "notes":
            known = [note for note in frame["notes"] if "code" not in note]
            new = ("why", "text")
            frame["notes"] = [{k: v for k, v in n.items() if k not in new} for n in known]
        elif frame["kind"] == "footer":
            for seat in frame["outcome"]["seats"]:
                del seat["invalid"], seat["malformed"]
        frames.append(frame)
    packed = (pack_frame(frame, recording.version) for frame in frames)
    return magic(recording.version) + b"".join(packed)


def notes(recording: Recording) -> list[dict[str, Any]]:
    return [note for note in recording.notes() if note["note"] == "rejected"]


def test_every_request_is_recorded_with_its_text_reasoning_and_reasons() -> None:
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


def test_they_are_counted_in_the_outcome_and_the_export() -> None:
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


def test_a_restart_keeps_them() -> None:
    episode, stream = recorded(ended=False)
    seat = episode.seat("robot1")
    found = restore(Recording(stream), 100.0, 10.0).episode.seat("robot1")
    assert found.tally == seat.tally
    assert (found.seq, found.answer, found.quota.used) == (seat.seq, seat.answer, seat.quota.used)


@pytest.mark.parametrize("ended", [True, False])
def test_recordings_of_earlier_versions_are_read_verified_and_continued(ended: bool) -> None:
    old = Recording(without_what_is_new(recorded(ended=ended)[1]))
    assert old.verify().ok
    assert rejections(old) == {"robot1": {"invalid": 2}}
    found = restore(old, 100.0, 10.0)
    if ended:
        assert found.episode.outcome is not None
        assert found.episode.outcome.seats[0].malformed == 0
        return
    found.episode.set_present("robot1", True, 101.0)
    found.episode.submit("robot1", 20, "Boil the sea", 102.0)
    found.episode.abort(103.0, "enough")
    going = Recording(old.stream + found.missing + Recorder(WORLD).record(found.episode.events()))
    assert going.verify().ok
    assert rejections(going) == {"robot1": {"invalid": 2, "malformed": 1}}


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        ({"controller": "stand-in", "present": False}, Controller.STAND_IN),
        ({"controller": "", "present": False, "taken": False}, Controller.FREE),
        ({"present": True}, Controller.MODEL),
        ({"present": False}, Controller.ABSENT),
        ({"present": False, "name": ""}, Controller.FREE),
    ],
)
def test_who_moves_a_seat_also_in_notes_that_do_not_say_it(
    told: dict[str, Any], expected: Controller
) -> None:
    assert controller_after({"name": "ada", "kind": "model", **told}) is expected


def test_who_cannot_move_a_seat() -> None:
    with pytest.raises(RecordingError, match="ghost"):
        controller_after({"name": "ada", "kind": "model", "present": True, "controller": "ghost"})
