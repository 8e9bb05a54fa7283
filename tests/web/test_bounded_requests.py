"""Requests that the HTTP servers refuse while they parse them."""

from __future__ import annotations

import h11
import pytest

from robotouille.web.bounded_requests import MAX_HEAD_BYTES, MAX_HEAD_LINES, BoundedRequests

START = b"POST / HTTP/1.1\r\nHost: localhost\r\n"
END = b"\r\n"


def lines(count: int) -> bytes:
    """Return a head with a number of lines; the last one is empty."""
    return START + b"a:\r\n" * (count - 3) + END


def sized(count: int) -> bytes:
    """Return a head with a number of bytes."""
    return START + b"a: " + b"b" * (count - len(START) - 7) + b"\r\n" + END


def parsed(*pieces: bytes) -> list[object]:
    parser, events = BoundedRequests(), []
    for piece in pieces:
        parser.receive_data(piece)
        while (event := parser.next_event()) not in (h11.NEED_DATA, h11.PAUSED):
            events.append(type(event))
    return events


def in_bytes(data: bytes) -> list[bytes]:
    return [bytes([byte]) for byte in data]


@pytest.mark.parametrize("head", [lines(MAX_HEAD_LINES), sized(MAX_HEAD_BYTES)])
def test_heads_within_the_limits_are_accepted(head: bytes) -> None:
    assert parsed(head) == [h11.Request, h11.EndOfMessage]
    assert parsed(*in_bytes(head)) == [h11.Request, h11.EndOfMessage]


@pytest.mark.parametrize(
    "head",
    [
        lines(MAX_HEAD_LINES + 1),
        pytest.param(lines(10_000), marks=pytest.mark.slow),
        sized(MAX_HEAD_BYTES + 1),
        pytest.param(sized(200_000), marks=pytest.mark.slow),
        b"GET /" + b"x" * MAX_HEAD_BYTES,
        START + b"Transfer-Encoding: chunked\r\n" + END + b"1\r\na\r\n" * 40_000,
        START + b"Content-Length: 2\r\nTRANSFER-ENCODING: chunked\r\n" + END,
    ],
)
def test_long_heads_and_bodies_in_chunks_are_refused(head: bytes) -> None:
    for pieces in ([head], in_bytes(head[: MAX_HEAD_BYTES + 2])):
        with pytest.raises(h11.RemoteProtocolError):
            parsed(*pieces)


def test_long_body_with_a_length_is_accepted() -> None:
    body = b"\n" * 100_000
    head = START + b"Content-Length: 100000\r\n" + END
    assert parsed(head + body) == [h11.Request, h11.Data, h11.EndOfMessage]


def test_second_head_of_a_connection_is_checked_too() -> None:
    parser = BoundedRequests()
    parser.receive_data(lines(3) + lines(MAX_HEAD_LINES + 1))
    assert type(parser.next_event()) is h11.Request
    assert type(parser.next_event()) is h11.EndOfMessage
    parser.send(h11.Response(status_code=200, headers=[("content-length", "0")]))
    parser.send(h11.EndOfMessage())
    parser.start_next_cycle()
    with pytest.raises(h11.RemoteProtocolError, match="lines"):
        parser.next_event()
