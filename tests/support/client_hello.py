"""First message of a TLS 1.3 client that offers one slow group, made by hand."""

from __future__ import annotations

__all__ = ["slow_hello"]

FFDHE8192 = 0x0104
KEY_BYTES = 1024


def slow_hello() -> bytes:
    """Return a ClientHello with a key share of ffdhe8192 (RFC 8446, section 4.1.2)."""
    group = FFDHE8192.to_bytes(2, "big")
    share = group + _sized(b"\0" * 8 + b"\x5a" * (KEY_BYTES - 8), 2)
    extensions = (
        _extension(43, _sized(b"\x03\x04", 1))  # TLS 1.3
        + _extension(10, _sized(group, 2))
        + _extension(13, _sized(b"\x04\x03\x08\x04\x04\x01", 2))  # Signature algorithms.
        + _extension(51, _sized(share, 2))
    )
    body = b"\x03\x03" + bytes(32) + b"\0" + _sized(b"\x13\x01\x13\x02", 2) + b"\x01\0"
    message = b"\x01" + _sized(body + _sized(extensions, 2), 3)
    return b"\x16\x03\x01" + _sized(message, 2)


def _extension(number: int, content: bytes) -> bytes:
    return number.to_bytes(2, "big") + _sized(content, 2)


def _sized(content: bytes, size: int) -> bytes:
    return len(content).to_bytes(size, "big") + content
