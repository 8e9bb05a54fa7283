"""Frames of recordings: every flipped bit is noticed, and intact frames before it can be read."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

from robotouille import RecordingError
from robotouille.replay import compression, container
from robotouille.replay.compression import compress
from robotouille.replay.container import MAGIC, frame_ends, intact, pack_frame
from robotouille.replay.recording import Recording, read_recording, recording_of
from tests.programs.every_bit import flip_some
from tests.support.games import recorded_game
from tests.support.thorough import STRIDE


@cache
def game(steps: int = 40) -> bytes:
    return recorded_game("multi_agent/10@3", seed=5, steps=steps)


@pytest.fixture(scope="module")
def short_game() -> bytes:
    return recorded_game("training/01_synchronous", seed=5, steps=3)


def small_frames(count: int = 16) -> bytes:
    notes = [{"note": "said", "t": i, "name": "ada", "player": "", "text": "x" * (i % 5)}
             for i in range(count)]  # fmt: skip
    return MAGIC + b"".join(pack_frame({"kind": "notes", "notes": [note]}) for note in notes)


def read(stream: bytes) -> tuple[list[object], bool]:
    """Return the frames that are read, and whether damage was noticed."""
    found: list[object] = []
    try:
        found.extend(container.read_frames(stream))
    except RecordingError:
        return found, True
    return found, False


class TestOpenFiles:
    def test_every_flipped_bit_of_small_frames_is_damage(self) -> None:
        stream = small_frames()
        ends = [len(MAGIC), *frame_ends(stream)]
        whole, _ = read(stream)
        for bit in range(0, 8 * len(stream), STRIDE):
            byte, damaged = bit // 8, bytearray(stream)
            damaged[byte] ^= 1 << bit % 8
            found, noticed = read(bytes(damaged))
            assert noticed, f"byte {byte}"
            before = sum(end <= byte for end in ends[1:])
            assert byte < len(MAGIC) or found == whole[:before], f"byte {byte}"

    @pytest.mark.slow
    def test_flipped_bits_of_a_game_lose_no_earlier_frame(self, short_game: bytes) -> None:
        """The strides are odd, so that they reach every bit of a byte."""
        header, begin = 8 * next(frame_ends(short_game)), 8 * len(MAGIC)
        steps = range(header, 8 * len(short_game), 9)
        bits = [*range(begin), *range(begin, header, 399), *steps]
        counts = flip_some(short_game, bits, closed=False)
        assert set(counts) == {"noticed, in the header", "noticed"}
        assert counts["noticed"] == len(steps)

    def test_too_large_length_is_not_a_tear(self) -> None:
        """The rest of the file looks like a torn frame, but whole frames follow."""
        stream = game()
        for start in list(frame_ends(stream))[:-1]:
            damaged = bytearray(stream)
            damaged[start + 2] ^= 0x10
            with pytest.raises(RecordingError, match=f"damaged at byte {start}"):
                Recording(bytes(damaged))

    def test_tear_at_any_byte_keeps_the_whole_frames(self) -> None:
        stream = small_frames()
        ends = [len(MAGIC), *frame_ends(stream)]
        whole, _ = read(stream)
        for size in range(len(MAGIC), len(stream)):
            last = max(i for i, end in enumerate(ends) if end <= size)
            assert read(stream[:size]) == (whole[:last], False)
            assert read(stream[: ends[last]] + bytes(size)) == (whole[:last], False)
            assert intact(stream[:size]) == ends[last]

    def test_zeros_before_whole_frames_are_damage(self) -> None:
        stream = game()
        start = list(frame_ends(stream))[40]
        holed = stream[:start] + bytes(600) + stream[start + 600 :]
        with pytest.raises(RecordingError, match=f"damaged at byte {start}"):
            Recording(holed)

    def test_no_frame_may_follow_the_footer(self) -> None:
        more = pack_frame({"kind": "notes", "notes": [{"note": "started", "t": 0}]})
        with pytest.raises(RecordingError, match="follows the footer"):
            Recording(game() + more)

    def test_forged_frame_heads_do_not_make_reading_slow(self) -> None:
        lure = (1_000_000).to_bytes(4, "little") + bytes(8) + b"\x81\xa4kind"
        tail = pack_frame({"kind": "notes", "notes": ["x" * 60_000]})[:12] + lure * 200_000
        with pytest.raises(RecordingError):
            Recording(game()[: intact(game())] + tail)


class TestClosedFiles:
    def test_flipped_bits_lose_no_earlier_block(
        self, short_game: bytes, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(compression, "BLOCK", 256)  # A short game then has many blocks.
        end = 8 * len(compress(short_game))
        bits: Iterable[int] = [*range(0, end - 64, 97 * STRIDE), *range(end - 64, end, 17)]
        counts = flip_some(short_game, bits, closed=True)
        assert set(counts) <= {"noticed, in the header", "noticed", "nothing changed"}
        assert counts["noticed"] > 5, "no flip after the header"

    @pytest.mark.parametrize("more", [b"\0", b"garbage", compress(small_frames())])
    def test_nothing_may_follow_the_compressed_stream(self, more: bytes) -> None:
        with pytest.raises(RecordingError, match="data follows"):
            recording_of(compress(game()) + more, "it")

    def test_closed_file_must_be_complete(self) -> None:
        ends = list(frame_ends(game()))
        with pytest.raises(RecordingError, match="a closed file without a footer"):
            recording_of(compress(game()[: ends[-2]]), "it")
        with pytest.raises(RecordingError, match="torn frame in a closed file"):
            recording_of(compress(game()[:-3]), "it")

    def test_recording_can_be_read_up_to_the_damage(self, tmp_path: Path) -> None:
        content = bytearray(compress(game(steps=400)))
        content[-2000] ^= 1
        path = tmp_path / "a.rbt"
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="damaged"):
            read_recording(path)
        recording = read_recording(path, damaged=True)
        assert "damaged" in recording.damage
        assert recording.steps == Recording(game(steps=400)).steps[: recording.length]
        assert recording.length > 250
        assert recording.outcome is None

    def test_closed_file_has_the_size_of_its_content(self) -> None:
        """Without it, six threads that closed recordings at the same time took 69 MiB."""
        closed = compress(game())
        assert compression.zstd.get_frame_info(closed).decompressed_size == len(game())
