"""Recordings: verification, torn files, and errors that name the first difference."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import RecordingError, RobotouilleError
from robotouille.episode import Clock
from robotouille.replay.compression import compress, unwrap
from robotouille.replay.container import MAGIC, pack_frame, read_frames
from robotouille.replay.controllers import json_lines
from robotouille.replay.recording import Recording, read_recording
from tests.support.games import recorded_game
from tests.support.random_play import random_stream
from tests.support.samples import quick_sample
from tests.support.thorough import thorough

GAME = recorded_game("multi_agent/10@3", seed=5, steps=130)


@pytest.mark.parametrize("clock", list(Clock))
@pytest.mark.parametrize(
    ("task", "timing"),
    quick_sample(
        [
            ("asynchronous/06", "people"),
            ("multi_agent/03@4", "benchmark"),
            ("synchronous/07", "benchmark"),
            ("workshop/02", "benchmark"),
        ],
        2,
    ),
)
def test_game_resimulates_byte_for_byte(task: str, timing: str, clock: Clock) -> None:
    stream = recorded_game(task, seed=1, clock=clock, timing=timing)
    recording = Recording(stream)
    assert recording.verify().ok
    assert recording.resimulate() == stream
    assert recording.outcome is not None
    assert recording.task.timing == timing


def test_recorded_facts_equal_the_resimulated_ones() -> None:
    recording = Recording(GAME)
    fluents = set(recording.world.table.fluents)
    for (step, state), (recorded, facts) in zip(
        recording.states(), recording.recorded_facts(), strict=True
    ):
        assert step == recorded
        assert facts == {name for name in state.fact_names() if name.split("(")[0] in fluents}


@pytest.mark.parametrize("first", [0, 120, 250, 65_530, 2**33])
def test_notes_have_the_number_of_the_step_before_them(first: int) -> None:
    frames, expected, step = [], [], 0
    for frame in read_frames(random_stream(0)):
        if frame["kind"] == "step":
            frame["step"] = step = frame["step"] + first
        expected += [{"step": step, **note} for note in frame.get("notes", ())]
        frames.append(frame)
    recording = Recording(MAGIC + b"".join(map(pack_frame, frames)))
    assert list(recording.notes()) == expected
    assert expected[-1]["step"] > first + 10


@thorough(60)
@given(st.integers(0, len(GAME)))
def test_file_cut_off_anywhere_is_read_up_to_its_last_whole_frame(length: int) -> None:
    cut = GAME[:length]
    try:
        recording = Recording(unwrap(cut))
    except RecordingError as error:
        assert length < 40_000, error
        return
    whole = [f for f in Recording(GAME).frames if f["kind"] == "step"]
    assert recording.steps == whole[: len(recording.steps)]
    assert recording.verify().ok
    if length < len(GAME):
        assert recording.outcome is None or length == len(GAME)


@thorough(100)
@given(st.binary(max_size=300))
def test_arbitrary_bytes_are_refused(content: bytes) -> None:
    for stream in (content, MAGIC + content):
        with pytest.raises(RecordingError):
            Recording(unwrap(stream))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**31), 2**31) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=6,
)


KEYS = (
    "add", "atoms", "busy", "digest", "facts", "hash", "kind", "moves", "notes", "objects",
    "outcome", "remove", "rules", "step", "t", "tables", "task", "timers", "unmet",
)  # fmt: skip


@thorough(150)
@given(
    st.integers(0, 8),
    st.sampled_from(KEYS),
    json_values,
)
def test_invalid_values_in_frames_are_reported_as_errors(
    index: int, key: str, value: object
) -> None:
    frames = list(read_frames(GAME))
    frames[index % len(frames)] = {**frames[index % len(frames)], key: value}
    stream = MAGIC + b"".join(pack_frame(frame) for frame in frames)
    try:
        recording = Recording(stream)
        result = recording.verify()
        list(recording.notes())
        assert result.steps == len(recording.steps)
        list(json_lines(recording))
    except RobotouilleError as error:
        assert str(error)


def test_first_different_step_and_fact_are_named() -> None:
    frames = list(read_frames(GAME))
    step = next(f for f in frames if f["kind"] == "step" and f["step"] == 17)
    initial = Recording(GAME)
    atom = next(i for i in step.get("add", []))
    step["add"] = [i for i in step["add"] if i != atom]
    stream = MAGIC + b"".join(pack_frame(frame) for frame in frames)
    result = Recording(stream).verify()
    name = list(initial.recorded_facts())[17][1] - list(Recording(stream).recorded_facts())[17][1]
    assert not result.ok
    assert result.fault.startswith("step 17: ")
    assert next(iter(name)) in result.fault


@pytest.mark.parametrize("player", ["robot9", "another"])
def test_move_of_another_player_is_refused(player: str) -> None:
    frames = list(read_frames(GAME))
    step = next(f for f in frames if f["kind"] == "step" and f["moves"])
    move = step["moves"][0]
    others = [each for each in Recording(GAME).world.players if each != move["player"]]
    move["player"] = others[0] if player == "another" else player
    changed = Recording(MAGIC + b"".join(pack_frame(frame) for frame in frames))
    result = changed.verify()
    assert not result.ok
    fault = rf"step {step['step']}: .*\) is not an action of '{move['player']}'"
    assert re.search(fault, result.fault)
    for read in (changed.measures, lambda: list(json_lines(changed))):
        with pytest.raises(RecordingError, match=fault):
            read()


def test_missing_step_is_named() -> None:
    frames = [f for f in read_frames(GAME) if f.get("step") != 9 or f["kind"] != "step"]
    result = Recording(MAGIC + b"".join(pack_frame(f) for f in frames)).verify()
    assert "step 9 is missing" in result.fault


def test_open_and_closed_files_have_the_same_frames(tmp_path: Path) -> None:
    open_file, closed_file = tmp_path / "a.rbt.part", tmp_path / "a.rbt"
    open_file.write_bytes(GAME)
    closed_file.write_bytes(compress(GAME))
    assert read_recording(open_file).frames == read_recording(closed_file).frames
    assert closed_file.stat().st_size < open_file.stat().st_size / 3


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not a recording but an empty file"),
        (b"PK\x03\x04", "not a recording but a ZIP archive; .* .rbt files"),
        (b"RBTL", "ends after"),
        (b"RBTL\x01", "format version 1; this software reads only 3: .* record the game again"),
        (
            compress(b"RBTL\x02" + GAME[5:]),
            "format version 2; this software reads only 3: .* again",
        ),
        (b"RBTL\x04" + GAME[5:], "format version 4; this software reads only 3: install the newer"),
        (MAGIC, "the header is missing"),
        (compress(GAME)[:-20], "cut off"),
        (MAGIC + pack_frame({"kind": "header"}), "frame 0: header.software"),
    ],
)
def test_invalid_file_is_named_with_the_reason(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "wrong.rbt"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=reason) as error:
        read_recording(path)
    assert str(path) in str(error.value)
