"""Short role tokens for personal links: `KQXZB-MHTWA.` and about 40 letters.

A link's token is for one seat of one episode, or for a spectator. It has no name and no id of its
own. It is signed like other tokens and needs no storage, so every process with the same keys
accepts it:

    byte 0      length of the seat (bits 0 to 4), form of the subject (5, 6), one session only (7)
    bytes 1-3   end of validity, in hours since 1970
    then        the seat, the subject
    last 12     first bytes of HMAC-SHA256 over `robotouille/link` (for a spectator
                `robotouille/watch`), the code and all bytes before

The length of a seat of more than 31 bytes follows the end of validity, and `robotouille/seat` is
signed.

96 bits of a signature are enough: a guess needs a connection.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import math
import re
from collections.abc import Collection
from dataclasses import dataclass, replace

from robotouille.protocol.join_codes import link_parts, plain_code
from robotouille_server.auth.keys import Key

_PURPOSE, _WATCHING, _LONG = b"robotouille/link\0", b"robotouille/watch\0", b"robotouille/seat\0"
_SIGNATURE = 12
_HOUR = 3600
MAX_SEAT, MAX_SUBJECT = 64, 64
"""Longest parts of a link, in bytes."""
_LENGTH = 31
"""Bits of the first byte that are a seat's length."""
_RAW, _PARTICIPANT, _NUMBERED, _SPECTATOR = range(4)
_PSEUDONYM = re.compile(r"participant-([0-9a-f]{16})")
_ANONYMOUS = re.compile(r"([0-9a-f]{16})-([1-9][0-9]?)")
"""Subjects that the server makes. Without their letters, links are short enough to type."""


@dataclass(frozen=True, slots=True)
class Link:
    """Content of a link's token.

    Attributes:
        code: The code of the episode. A token that was read has it without a dash, because clients
            may write it in several ways.
        seat: The seat, or empty for any.
        subject: The pseudonym of the bearer.
        expires: The end of validity in seconds since 1970, a whole hour.
        once: True if it is good for one session only.
        watch: True if it is for a spectator, who has no seat.
        token_id: The id with which the token can be revoked, once it is signed.
    """

    code: str
    seat: str
    subject: str
    expires: float
    once: bool = False
    watch: bool = False
    token_id: str = ""


def is_link(token: str) -> bool:
    """Return whether a token has the form of a link's token."""
    return link_parts(token) is not None


def pack_link(link: Link, key: Key) -> str:
    """Return the token of a link, signed with a key; raise ValueError for invalid values."""
    seat, hours = link.seat.encode(), math.ceil(link.expires / _HOUR)
    if link.watch and link.seat:
        raise ValueError("seat: a spectator has no seat")
    form, subject = _packed_subject(link)
    for name, part, most in (("seat", seat, MAX_SEAT), ("sub", subject, MAX_SUBJECT)):
        if len(part) > most:
            raise ValueError(f"{name}: a link has room for {most} bytes")
    is_long = len(seat) > _LENGTH
    first = (0 if is_long else len(seat)) | form << 5 | link.once << 7
    length = bytes([len(seat)] if is_long else [])
    content = bytes([first]) + hours.to_bytes(3, "big") + length + seat + subject
    purpose = _LONG if is_long else _purposes(content)[0]
    signed = content + _signature(_signed_part(purpose, link.code, content), key)
    return f"{link.code}.{base64.urlsafe_b64encode(signed).decode().rstrip('=')}"


def read_link(token: str, keys: Collection[Key]) -> Link | None:
    """Return the content of a link's token; None if none of the keys has signed it."""
    parts = link_parts(token)
    if parts is None:
        return None
    code, text = parts
    try:
        signed = base64.b64decode(text + "=" * (-len(text) % 4), "-_", validate=True)
    except binascii.Error:
        return None
    # The decoder ignores the last bits, so one token could be written in several ways.
    if base64.urlsafe_b64encode(signed).decode().rstrip("=") != text:
        return None
    content, signature = signed[:-_SIGNATURE], signed[-_SIGNATURE:]
    for purpose in _purposes(content):
        part = _signed_part(purpose, code, content)
        if any(hmac.compare_digest(_signature(part, key), signature) for key in keys):
            link = _read(code, content, is_long=purpose == _LONG)
            return replace(link, token_id=hashlib.sha256(part).hexdigest()[:16])
    return None


def _read(code: str, content: bytes, *, is_long: bool) -> Link:
    length, rest = (content[4], content[5:]) if is_long else (content[0] & _LENGTH, content[4:])
    return Link(
        code=code,
        seat=rest[:length].decode(),
        subject=_read_subject(_form(content), rest[length:]),
        expires=float(int.from_bytes(content[1:4], "big") * _HOUR),
        once=bool(content[0] >> 7),
        watch=_form(content) == _SPECTATOR,
    )


def _packed_subject(link: Link) -> tuple[int, bytes]:
    subject = link.subject
    if link.watch:
        return _SPECTATOR, subject.encode()
    if known := _PSEUDONYM.fullmatch(subject):
        return _PARTICIPANT, bytes.fromhex(known[1])
    if known := _ANONYMOUS.fullmatch(subject):
        return _NUMBERED, bytes.fromhex(known[1]) + bytes([int(known[2])])
    return _RAW, subject.encode()


def _read_subject(form: int, packed: bytes) -> str:
    if form == _PARTICIPANT:
        return f"participant-{packed.hex()}"
    if form == _NUMBERED:
        return f"{packed[:-1].hex()}-{packed[-1]}"
    return packed.decode()


def _signature(signed_part: bytes, key: Key) -> bytes:
    return hmac.digest(key.secret, signed_part, hashlib.sha256)[:_SIGNATURE]


def _signed_part(purpose: bytes, code: str, content: bytes) -> bytes:
    return purpose + plain_code(code).encode() + b"\0" + content


def _purposes(content: bytes) -> tuple[bytes, ...]:
    # A server that does not know links for spectators would take them for those of players.
    return (_WATCHING,) if _form(content) == _SPECTATOR else (_PURPOSE, _LONG)


def _form(content: bytes) -> int:
    return content[0] >> 5 & 3
