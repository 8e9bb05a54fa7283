"""Forged recordings with correct frames and checksums around hostile content."""

from __future__ import annotations

import zlib
from functools import cache
from typing import Any

import msgpack

from robotouille.replay.compression import compress, unwrap
from robotouille.replay.container import MAGIC, read_frames
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.specimens import recordings

__all__ = ["forged", "framed", "recording_bytes"]


def framed(payload: bytes) -> bytes:
    """Return a frame around any bytes, with their length and correct checksums."""
    head = len(payload).to_bytes(4, "little") + zlib.crc32(payload).to_bytes(4, "little")
    return head + zlib.crc32(head).to_bytes(4, "little") + payload


@cache
def _frames(index: int) -> tuple[bytes, ...]:
    """Return the payloads of a specimen's frames."""
    return tuple(msgpack.packb(frame) for frame in read_frames(unwrap(recordings()[index])))


def _game(adversary: Adversary) -> list[bytes]:
    return list(_frames(adversary.random.randrange(len(recordings()))))


def forged(adversary: Adversary) -> bytes:
    """Return a specimen with frames changed, dropped, duplicated, moved or replaced."""
    frames = _game(adversary)
    for _ in range(adversary.random.choice((1, 1, 1, 2, 3))):
        _change(adversary, frames)
    stream = MAGIC + b"".join(map(framed, frames))
    return compress(stream) if adversary.random.random() < 0.05 else stream


def _change(adversary: Adversary, frames: list[bytes]) -> None:
    pick = adversary.random.random()
    place = adversary.random.randrange(len(frames)) if frames else 0
    if adversary.random.random() < 0.3:
        place = min(place, 1)
    if pick < 0.7 and frames:
        frames[place] = _spoilt(adversary, frames[place])
    elif pick < 0.78:
        del frames[place : place + adversary.random.choice((1, 5))]
    elif pick < 0.86:
        frames.insert(place, adversary.random.choice(_game(adversary)))
    elif pick < 0.92:
        frames[place:place] = frames[place : place + 3]
    else:
        frames.insert(place, adversary.packed(adversary.value()))


def _spoilt(adversary: Adversary, payload: bytes) -> bytes:
    try:
        frame: Any = msgpack.unpackb(payload)
    except ValueError:
        return adversary.damaged(payload)
    if isinstance(frame, dict) and adversary.random.random() < 0.2:
        frame = {**frame, str(adversary.value(0)).encode(errors="replace").decode(): 1}
        frame["more"] = adversary.value()
    else:
        frame = adversary.inside(frame)
    return adversary.packed(frame)


def recording_bytes(adversary: Adversary) -> bytes:
    """Return a hostile recording: a damaged specimen or a forged one."""
    if adversary.random.random() < 0.4:
        whole = adversary.random.choice(recordings())
        return adversary.damaged(whole, adversary.random.choice(recordings()))
    return forged(adversary)
