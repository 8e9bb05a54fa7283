"""Every flipped bit is noticed or changes nothing that is read; what stands before it is read."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

from robotouille import RecordingError
from robotouille.replay import container
from robotouille.replay.container import compress, frame_ends, intact, pack_frame, plain, unwrap
from robotouille.replay.recording import Recording, read_recording, recording_of
from tests.support.games import recorded_game
from tests.support.samples import first_quickly
from tests.support.thorough import STRIDE


@cache
def game(version: int = 2, steps: int = 40) -> bytes:
    return recorded_game("multi_agent/10@3", seed=5, steps=steps, version=version)


def small_frames(version: int, count: int = 16) -> bytes:
    """A stream of short frames, as for many bits as can be flipped one by one."""
    notes = [{"note": "said", "t": i, "name": "ada", "player": "", "text": "x" * (i % 5)}
             for i in range(count)]  # fmt: skip
    head = container.magic(version)
    return head + b"".join(
        pack_frame({"kind": "notes", "notes": [note]}, version) for note in notes
    )


def flipped(content: bytes, bits: Iterable[int]) -> Iterable[tuple[int, bytes]]:
    for bit in bits:
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        yield bit // 8, bytes(damaged)


def read(stream: bytes) -> tuple[list[object], bool]:
    """The frames that are read, and whether anything was noticed."""
    found: list[object] = []
    try:
        found.extend(container.read_frames(stream))
    except RecordingError:
        return found, True
    return found, False


class TestOpenFiles:
    @pytest.mark.parametrize("version", [1, 2])
    def test_every_bit(self, version: int) -> None:
        """Each flip of the open file's frames is damage, and none is a tear; `make test-all` has
        all of them."""
        stream = small_frames(version)
        ends = [len(container.MAGIC), *frame_ends(stream)]
        whole, _ = read(stream)
        for byte, damaged in flipped(stream, range(0, 8 * len(stream), STRIDE)):
            found, noticed = read(damaged)
            before = sum(end <= byte for end in ends[1:])
            assert noticed, f"byte {byte}"
            assert byte < len(container.MAGIC) or found == whole[:before], f"byte {byte}"

    @pytest.mark.parametrize("version", [1, 2])
    def test_some_bits_of_a_whole_game(self, version: int) -> None:
        stream, chance = game(version), random.Random(7)
        ends = list(frame_ends(stream))
        heads = [8 * start + bit for start in ends[:-1][::9] for bit in range(0, 96, 11)]
        sample = heads + [chance.randrange(8 * len(stream)) for _ in range(40)]
        for byte, damaged in flipped(stream, sample):
            with pytest.raises(RecordingError):
                Recording(damaged)
            if byte >= ends[0]:
                assert Recording(damaged, damaged=True).whole == max(e for e in ends if e <= byte)

    @pytest.mark.parametrize("version", [1, 2])
    def test_a_length_that_says_too_much_is_no_tear(self, version: int) -> None:
        """The rest of the file looks like a frame that was cut off, but frames follow."""
        stream = game(version)
        ends = list(frame_ends(stream))
        for start in ends[:-1]:
            damaged = bytearray(stream)
            damaged[start + 2] ^= 0x10
            with pytest.raises(RecordingError, match=f"damaged at byte {start}"):
                Recording(bytes(damaged))

    @pytest.mark.parametrize("version", [1, 2])
    def test_a_tear_anywhere_is_a_tear(self, version: int) -> None:
        stream = small_frames(version)
        ends = [len(container.MAGIC), *frame_ends(stream)]
        whole, _ = read(stream)
        for size in range(len(container.MAGIC), len(stream)):
            last = max(i for i, end in enumerate(ends) if end <= size)
            assert read(stream[:size]) == (whole[:last], False)
            assert read(stream[: ends[last]] + bytes(size)) == (whole[:last], False)

    def test_zeros_within_a_file_are_damage(self) -> None:
        stream = game()
        start = list(frame_ends(stream))[40]
        holed = stream[:start] + bytes(600) + stream[start + 600 :]
        with pytest.raises(RecordingError, match=f"damaged at byte {start}"):
            Recording(holed)

    @pytest.mark.parametrize("version", [1, 2])
    def test_nothing_follows_the_footer(self, version: int) -> None:
        more = pack_frame({"kind": "notes", "notes": []}, version)
        with pytest.raises(RecordingError, match="behind the footer"):
            Recording(game(version) + more)

    def test_telling_tears_from_damage_takes_no_time(self) -> None:
        """Whoever fills the rest of a file with what looks like frames does not gain by it."""
        lure = (1_000_000).to_bytes(4, "little") + bytes(4) + b"\x81\xa4kind"
        tail = (4_000_000).to_bytes(4, "little") + bytes(4) + lure * 200_000
        with pytest.raises(RecordingError):
            Recording(game(1)[: intact(game(1))] + tail)


class TestClosedFiles:
    @pytest.mark.parametrize("version", first_quickly([2, 1]))
    def test_every_bit(self, version: int, monkeypatch: pytest.MonkeyPatch) -> None:
        """Each flip is noticed or changes nothing, and loses no block before it; `make test-all`
        has all of them."""
        monkeypatch.setattr(container, "BLOCK", 256)
        stream = small_frames(version)
        content = compress(stream)
        readable = _readable(content)
        unnoticed = 0
        for byte, damaged in flipped(content, range(0, 8 * len(content), STRIDE)):
            try:
                found, fault = plain(damaged)
            except RecordingError:
                assert not readable[byte], f"byte {byte}"
                continue
            if not fault:
                assert found == stream, f"byte {byte}"
                unnoticed += 1
            assert found.startswith(stream[: readable[byte]]), f"byte {byte}"
        assert unnoticed < 40, "these are bits of Zstandard's header that say nothing"

    @pytest.mark.parametrize("version", [1, 2])
    def test_some_bits_of_a_whole_game(self, version: int) -> None:
        content, chance, silent = compress(game(version)), random.Random(8), 0
        for byte, damaged in flipped(
            content, (chance.randrange(8 * len(content)) for _ in "x" * 40)
        ):
            with contextlib.suppress(RecordingError):
                assert unwrap(damaged) == game(version), f"byte {byte}"
                silent += 1  # One of Zstandard's bits that say nothing.
                continue
            with pytest.raises(RecordingError):
                recording_of(damaged, "it")
            found = recording_of(damaged, "it", damaged=True) if byte > 20_000 else None
            assert found is None or found.damage
        assert silent <= 1

    @pytest.mark.parametrize("version", [1, 2])
    @pytest.mark.parametrize("more", [b"\0", b"garbage", compress(small_frames(2))])
    def test_nothing_follows_it(self, version: int, more: bytes) -> None:
        with pytest.raises(RecordingError, match="something follows"):
            recording_of(compress(game(version)) + more, "it")

    @pytest.mark.parametrize("version", [1, 2])
    def test_it_has_an_end(self, version: int) -> None:
        stream = game(version)
        ends = list(frame_ends(stream))
        with pytest.raises(RecordingError, match="closed without an end"):
            recording_of(compress(stream[: ends[-2]]), "it")
        with pytest.raises(RecordingError, match="torn frame in a closed file"):
            recording_of(compress(stream[:-3]), "it")

    def test_files_closed_by_earlier_versions_are_read(self) -> None:
        """Without a checksum of all, and in whatever blocks."""
        from tests.support.fuzzing.specimens import recordings

        earlier = recordings()[-1]
        recording = recording_of(earlier, "it")
        assert recording.version == 1
        assert recording.verify().ok
        assert unwrap(earlier) == recording.stream


def _readable(content: bytes) -> list[int]:
    """For each byte of a compressed stream, how much plain text the blocks before it hold."""
    decompressor, found, sizes = container.zstd.ZstdDecompressor(), 0, []
    for at in range(len(content)):
        sizes.append(found)
        found += len(decompressor.decompress(content[at : at + 1]))
    return sizes


def test_what_stands_before_the_damage_can_be_read(tmp_path: Path) -> None:
    content = bytearray(compress(game(steps=400)))
    content[-2000] ^= 1
    path = tmp_path / "a.rbt"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="damaged"):
        read_recording(path)
    recording = read_recording(path, damaged=True)
    assert "damaged" in recording.damage
    whole = Recording(game(steps=400))
    assert recording.steps == whole.steps[: recording.length]
    assert recording.length > 250
    assert recording.outcome is None


def test_a_closed_file_says_how_large_its_content_is() -> None:
    """So that neither writing nor reading makes room for more: six threads that close recordings
    at once took 69 MiB."""
    stream = game(container.FORMAT_VERSION)
    assert container.zstd.get_frame_info(compress(stream)).decompressed_size == len(stream)
