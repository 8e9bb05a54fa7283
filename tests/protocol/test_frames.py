"""WebSocket frames are read and written as by the `websockets` library."""

from collections.abc import Generator
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import PayloadTooBig, ProtocolError
from websockets.frames import Frame
from websockets.streams import StreamReader

from robotouille.protocol.frames import (
    BINARY,
    FIN,
    PING,
    TEXT,
    FrameError,
    FrameReader,
    pack_frame,
)

MAX_SIZE = 70_000
OPCODES = (0, 1, 2, 8, 9, 10)

payloads = st.one_of(
    st.binary(max_size=140),
    st.sampled_from([125, 126, 127, 65_535, 65_536, MAX_SIZE]).map(lambda n: b"\xa5" * n),
)
masks = st.binary(min_size=4, max_size=4)


@st.composite
def frames(draw: st.DrawFn) -> tuple[int, bytes]:
    opcode = draw(st.sampled_from(OPCODES))
    payload = draw(payloads)
    if opcode >= 8:
        return FIN | opcode, payload[:125]
    return draw(st.sampled_from((0, FIN))) | opcode, payload


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


def ours(parts: list[bytes], *, masked: bool) -> tuple[list[tuple[int, bytes]], bool]:
    """Return the frames that this project reads, and whether the stream was refused."""
    reader = FrameReader(masked=masked, max_size=MAX_SIZE)
    found = []
    for part in parts:
        reader.receive(part)
        try:
            while reader.next_frame():
                found.append((reader.first, reader.content))
        except FrameError:
            return found, True
    return found, False


def theirs(parts: list[bytes], *, masked: bool) -> tuple[list[tuple[int, bytes]], bool]:
    """Return the frames that the library reads, and whether it refused the stream."""
    stream = StreamReader()
    found: list[tuple[int, bytes]] = []

    def parse() -> Generator[None, None, None]:
        while True:
            frame: Frame = yield from Frame.parse(stream.read_exact, mask=masked, max_size=MAX_SIZE)
            bits = frame.rsv1 << 6 | frame.rsv2 << 5 | frame.rsv3 << 4
            found.append((frame.fin << 7 | bits | frame.opcode, bytes(frame.data)))

    parser = parse()
    next(parser)
    for part in parts:
        stream.feed_data(part)
        try:
            next(parser)
        except (ProtocolError, PayloadTooBig):
            return found, True
    return found, False


@given(st.lists(frames(), max_size=6), st.lists(st.integers(0, 10**6), max_size=8), masks)
@pytest.mark.parametrize("masked", [True, False])
def test_frames_are_read_as_written(
    masked: bool, sent: list[tuple[int, bytes]], cuts: list[int], mask: bytes
) -> None:
    data = b"".join(pack_frame(f, p, mask if masked else b"") for f, p in sent)
    assert ours(pieces(data, cuts), masked=masked) == (sent, False)
    assert theirs(pieces(data, cuts), masked=masked) == (sent, False)


@given(frames(), masks)
def test_frames_are_written_as_by_the_library(frame: tuple[int, bytes], mask: bytes) -> None:
    first, payload = frame
    made: Any = Frame(first & 0x0F, payload, fin=bool(first & FIN))  # type: ignore[arg-type]
    assert pack_frame(first, payload) == made.serialize(mask=False)


@given(st.binary(max_size=300), st.lists(st.integers(0, 10**6), max_size=8))
@pytest.mark.parametrize("masked", [True, False])
def test_noise_is_read_as_by_the_library(masked: bool, noise: bytes, cuts: list[int]) -> None:
    """Up to the first frame that the library refuses: what ours does not judge (opcodes, reserved
    bits, control frames in parts), the server leaves to it.
    """
    parts = pieces(noise, cuts)
    found, wrong = theirs(parts, masked=masked)
    mine, mine_wrong = ours(parts, masked=masked)
    assert mine[: len(found)] == found
    if not wrong:
        assert mine == found
        assert not mine_wrong


@pytest.mark.parametrize("length", [MAX_SIZE + 1, 2**63, 2**64 - 1])
def test_large_frame_is_refused_before_it_has_arrived(length: int) -> None:
    reader = FrameReader(masked=False, max_size=MAX_SIZE)
    reader.receive(bytes((FIN | BINARY, 127)) + length.to_bytes(8, "big"))
    for _ in range(2):
        with pytest.raises(FrameError, match=str(length)):
            reader.next_frame()


def test_rest_contains_the_bytes_after_the_frame() -> None:
    reader = FrameReader(masked=False, max_size=MAX_SIZE)
    whole, part = pack_frame(FIN | PING, b"a"), pack_frame(FIN | TEXT, b"hello")[:3]
    reader.receive(whole + part)
    assert reader.next_frame()
    assert (reader.raw, reader.size, reader.rest) == (whole, len(whole), part)
    assert not reader.next_frame()
    assert reader.rest == part
    reader.clear()
    assert reader.rest == b""
