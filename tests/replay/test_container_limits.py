"""Limits on the memory that a small recording can make a reader use."""

from __future__ import annotations

import tracemalloc
import zlib

import pytest

from robotouille import RecordingError
from robotouille.replay import container
from robotouille.replay.compression import MAX_RATIO, SMALL, compress, plain, unwrap, zstd
from robotouille.replay.container import (
    MAGIC,
    MAX_FRAME,
    frame_ends,
    frames_with_ends,
    pack_frame,
    read_frames,
)
from robotouille.replay.frame_schema import MAX_ARGUMENTS, MAX_NAME, MAX_TEXT
from robotouille.replay.payloads import MAX_ENTRIES
from robotouille.replay.recording import Recording, recording_of
from tests.support.games import recorded_game
from tests.support.samples import quick_sample

GAME = recorded_game("synchronous/01", seed=1, steps=5)
BEGINNING = GAME[: list(frame_ends(GAME))[-2]]
MIB = 1024 * 1024


def framed(payload: bytes) -> bytes:
    head = len(payload).to_bytes(4, "little") + zlib.crc32(payload).to_bytes(4, "little")
    return head + zlib.crc32(head).to_bytes(4, "little") + payload


def peak(content: bytes) -> tuple[float, str]:
    """Return the peak memory of verifying in MiB, and the result as text."""
    tracemalloc.start()
    try:
        end = str(recording_of(content, "it").verify().ok)
    except RecordingError as error:
        end = str(error)
    finally:
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    return most / MIB, end


NOTES = b"\x82\xa4kind\xa5notes\xa5notes\x90"
BOMBS = {
    "empty lists in an unknown field": b"\x83" + NOTES[1:] + b"\xa1x\xdd" + b"\x00\x03\x0d\x40"
    + b"\x90" * 200_000,
    "lists of lists": b"\x83" + NOTES[1:] + b"\xa1x" + b"\xdc\xff\xff" * 900 + b"\x90" * 100_000,
    "too many values": b"\x82\xa4kind\xa5notes\xa5notes\xdc\x00\x14"
    + (b"\xdd" + (200_000).to_bytes(4, "big") + b"\x90" * 200_000) * 20,
    "announced but missing values": b"\x82\xa4kind\xa5notes\xa5notes"
    + b"\xdd\x00\x03\x0d\x40" * 1000,
}  # fmt: skip


@pytest.mark.parametrize("name", quick_sample(BOMBS, 2))
def test_frame_that_would_become_large_is_refused(name: str) -> None:
    content = compress(BEGINNING + framed(BOMBS[name]) * 20)
    assert len(content) < 100_000
    most, end = peak(content)
    assert "damaged" in end or "frame" in end
    assert most < 3 * 20 * len(BOMBS[name]) / MIB + 40


@pytest.mark.slow
def test_verifying_holds_no_more_than_one_frame() -> None:
    notes = {"kind": "notes", "notes": [{"note": "said", "t": 1, "name": "a", "player": "",
                                         "text": "x"}] * 2000}  # fmt: skip
    stream = BEGINNING + pack_frame(notes) * 20 + GAME[len(BEGINNING) :]
    most, end = peak(compress(stream))
    assert end == "True"
    assert most < 3 * len(stream) / MIB + 12


def test_recording_with_too_many_frames_is_refused_before_it_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(container, "MAX_FRAMES", 1000)
    quota = pack_frame({"kind": "notes", "notes": [{"note": "quota", "t": 0, "player": "robot1"}]})
    stream = BEGINNING + quota * 1000 + GAME[len(BEGINNING) :]
    for content in (compress(stream), stream):
        with pytest.raises(RecordingError, match="more than 1,000 frames"):
            recording_of(content, "bomb")
    with pytest.raises(RecordingError, match="more than 1,000 frames"):
        Recording(stream)
    with pytest.raises(RecordingError, match="more than 1,000 frames"):
        list(frames_with_ends(stream))


def test_recording_with_too_many_notes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    note = {"note": "quota", "t": 0, "player": "robot1"}
    notes = pack_frame({"kind": "notes", "notes": [note] * 100})
    monkeypatch.setattr(container, "MAX_NOTES", 1000 + Recording(BEGINNING).totals.notes)
    assert Recording(BEGINNING + notes * 10).totals.notes == container.MAX_NOTES
    stream = BEGINNING + notes * 11
    with pytest.raises(RecordingError, match=r"more than 1,\d* notes"):
        Recording(stream)
    with pytest.raises(RecordingError, match=r"more than 1,\d* notes"):
        list(frames_with_ends(stream))


def test_recording_with_too_many_reasons_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    why = [{"kind": "condition", "objects": ["table1"] * 80}]
    note = {"note": "rejected", "t": 0, "player": "robot1", "seq": 1, "action": "wait",
            "reasons": ["needs: luck"] * 30, "why": why}  # fmt: skip
    notes = pack_frame({"kind": "notes", "notes": [note] * 10})
    monkeypatch.setattr(container, "MAX_REASONS", 1000)
    assert Recording(BEGINNING + notes * 2).totals.notes > 20
    with pytest.raises(RecordingError, match="more than 1,000 reasons for rejections"):
        Recording(BEGINNING + notes * 3)


@pytest.mark.parametrize(("letter", "most"), [("x", 10), ("é", 2), ("\N{GRINNING FACE}", 2)])
def test_recording_with_too_long_texts_is_refused(
    monkeypatch: pytest.MonkeyPatch, letter: str, most: int
) -> None:
    """One emoji makes every character of a text take four bytes in memory."""
    note = {"note": "announced", "t": 0, "text": letter + "x" * 980}
    notes = pack_frame({"kind": "notes", "notes": [note]})
    monkeypatch.setattr(container, "MAX_TEXTS", 10_000 + Recording(BEGINNING).totals.texts)
    assert Recording(BEGINNING + notes * most).totals.notes > most
    with pytest.raises(RecordingError, match=r"more than 10,\d* bytes of texts in notes"):
        Recording(BEGINNING + notes * (most + 1))


def test_deeply_nested_notes_are_refused() -> None:
    notes: list[object] = []
    for _ in range(500):
        notes = [notes]
    with pytest.raises(RecordingError, match="notes"):
        Recording(BEGINNING + pack_frame({"kind": "notes", "notes": notes}))


def test_recording_with_too_many_changes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(container, "MAX_CHANGES", 1000)
    changes = {"add": [1] * 100, "remove": [2] * 100}
    steps = [
        pack_frame({"kind": "step", "step": number, "t": 0, "moves": [], **changes})
        for number in range(6, 12)
    ]
    assert Recording(BEGINNING + b"".join(steps[:4])).length == 9
    with pytest.raises(RecordingError, match="more than 1,000 changes of facts"):
        Recording(BEGINNING + b"".join(steps))


def test_recording_with_too_many_created_objects_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(container, "MAX_CREATED", 30)
    created = {"objects": [["x", "y", "z"]] * 5, "atoms": [[1]] * 5}
    steps = [
        pack_frame({"kind": "step", "step": number, "t": 0, "moves": [], **created})
        for number in range(6, 10)
    ]
    assert Recording(BEGINNING + b"".join(steps[:3])).length == 8
    with pytest.raises(RecordingError, match="more than 30 created objects and facts"):
        Recording(BEGINNING + b"".join(steps))


@pytest.mark.parametrize(
    "move",
    [
        {"player": "x" * (MAX_NAME + 1), "action": ["wait"]},
        {"player": "robot1", "action": ["wait", "x" * (MAX_NAME + 1)]},
        {"player": "robot1", "action": ["wait"] * (MAX_ARGUMENTS + 1)},
    ],
)
def test_long_names_in_moves_are_refused(move: dict[str, object]) -> None:
    step = {"kind": "step", "step": 6, "t": 0, "moves": [{**move, "seq": 0, "ms": 0}]}
    with pytest.raises(RecordingError, match="should have at most"):
        Recording(BEGINNING + pack_frame(step))


def test_decompressed_stream_is_in_memory_once() -> None:
    note = {"note": "noted", "t": 0, "player": "robot1", "topic": "x", "text": "x" * 8000}
    stream = BEGINNING + pack_frame({"kind": "notes", "notes": [note] * 50}) * 40
    content = compress(stream)
    tracemalloc.start()
    try:
        assert plain(content)[0] == stream
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1.3 * len(stream)


def test_long_text_is_refused() -> None:
    def noted(size: int) -> bytes:
        note = {"note": "noted", "t": 0, "player": "robot1", "topic": "x", "text": "x" * size}
        return pack_frame({"kind": "notes", "notes": [note]})

    assert Recording(BEGINNING + noted(MAX_TEXT)).totals.notes
    with pytest.raises(RecordingError, match=r"noted.text: String should have at most 500000"):
        Recording(BEGINNING + noted(MAX_TEXT + 1))


def test_recording_with_too_many_labels_is_refused() -> None:
    head = next(read_frames(GAME))

    def labelled(count: int) -> bytes:
        labels = {f"label{number}": "x" for number in range(count)}
        return MAGIC + pack_frame({**head, "labels": labels})

    assert len(Recording(labelled(16)).header["labels"]) == 16
    with pytest.raises(RecordingError, match=r"frame 0: header.labels: .* at most 16 items"):
        Recording(labelled(17))


def test_empty_notes_are_refused() -> None:
    with pytest.raises(RecordingError, match="notes: List should have at least 1 item"):
        Recording(BEGINNING + pack_frame({"kind": "notes", "notes": []}))


def test_decompression_bomb_is_noticed_at_once() -> None:
    with pytest.raises(RecordingError, match="not a recording"):
        plain(compress(bytes(8 * MIB))[:40])


def test_small_file_cannot_expand_to_a_large_stream() -> None:
    noted = {"note": "noted", "t": 0, "player": "robot1", "topic": "x", "text": "x" * 8000}
    notes = pack_frame({"kind": "notes", "notes": [noted] * 50})
    stream = BEGINNING + notes * 40 + GAME[len(BEGINNING) :]
    bomb = zstd.compress(stream)
    assert len(stream) > 15 * MIB
    most, end = peak(bomb)
    assert end == f"damaged: {len(bomb):,} bytes that expand to more than {MAX_RATIO * len(bomb):,}"
    assert most < 16
    assert plain(compress(stream)) == (stream, "")


def test_recording_that_compresses_best_is_read() -> None:
    stream = MAGIC + bytes(8 * MIB)
    written = compress(stream)
    assert len(stream) > SMALL
    assert len(stream) <= MAX_RATIO * len(written)
    with pytest.raises(RecordingError, match="expand"):
        unwrap(zstd.compress(stream))


def test_frames_that_readers_refuse_are_not_written() -> None:
    with pytest.raises(RecordingError, match="bytes"):
        pack_frame({"kind": "notes", "notes": ["x" * MAX_FRAME]})
    with pytest.raises(RecordingError, match="cannot be recorded"):
        pack_frame({"kind": "notes", "notes": [[0] * 200_000] * (MAX_ENTRIES // 200_000 + 1)})
    with pytest.raises(RecordingError, match="cannot be recorded"):
        pack_frame({"kind": "notes", "notes": [0] * 200_001})
