"""Any file is read, or refused with an error of the project that states the reason."""

from __future__ import annotations

import os
import random
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import RecordingError, RobotouilleError
from robotouille.domain.json_files import read_json
from robotouille.replay.compression import unwrap
from robotouille.replay.container import MAGIC, read_frames
from robotouille.replay.recording import Recording, read_recording
from robotouille_evaluation.metrics.rows import read_rows
from robotouille_evaluation.metrics.statistics import read_labels
from robotouille_evaluation.runs.journal import CallJournal
from robotouille_server.auth.keys import FileKeyring
from robotouille_server.auth.private_files import read_private
from robotouille_server.auth.revocation import load_revoked
from robotouille_server.transport import ServerTLS
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.forgery import framed
from tests.support.fuzzing.hostile_inputs import HOSTILE_INPUTS
from tests.support.fuzzing.specimens import FILE_KINDS, files, recordings
from tests.support.fuzzing.targets import file_targets
from tests.support.thorough import thorough

KINDS = ("recording", *FILE_KINDS)


def valid(kind: str) -> tuple[bytes, ...]:
    return recordings() if kind == "recording" else files(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_valid_files_are_read(tmp_path: Path, kind: str) -> None:
    outcomes = [file_targets(tmp_path)[kind](content) for content in valid(kind)]
    # Plans of another task are refused because of their header.
    assert outcomes.count("read") == len(outcomes) - (kind == "plan")


@pytest.mark.parametrize("kind", KINDS)
@thorough(150)
@given(chance=st.randoms())
def test_faulty_files_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, kind: str, chance: random.Random
) -> None:
    folder = tmp_path_factory.getbasetemp()
    file_targets(folder)[kind](HOSTILE_INPUTS[kind](Adversary(chance)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_hostile_inputs_are_partly_read_and_partly_refused(tmp_path: Path, kind: str) -> None:
    adversary, read = Adversary(3), file_targets(tmp_path)[kind]
    met = Counter(read(HOSTILE_INPUTS[kind](adversary)) for _ in range(200))
    assert len(met) >= 2, met
    assert met["read"] >= 1


@pytest.mark.parametrize("kind", KINDS)
@thorough(80)
@given(data=st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, kind: str, data: bytes
) -> None:
    folder = tmp_path_factory.getbasetemp()
    assert file_targets(folder)[kind](data) != "read" or kind in ("plan", "rows")


@thorough(60)
@given(one=st.integers(0, 3), other=st.integers(0, 3), at=st.integers(0, 2000))
def test_mixture_of_two_recordings_does_not_verify(one: int, other: int, at: int) -> None:
    """Join the start of one episode's frames with the end of another's."""
    first, second = (list(read_frames(unwrap(recordings()[i]))) for i in (one, other))
    if first == second:
        return
    import msgpack

    place = 1 + at % (len(first) - 1)
    mixed = first[:place] + second[place:]
    stream = MAGIC + b"".join(framed(msgpack.packb(frame)) for frame in mixed)
    try:
        result = Recording(stream).verify()
    except RobotouilleError:
        return
    # A step without moves fits into any episode.
    assert not result.ok or not any(frame.get("moves") for frame in second[place:])


@pytest.mark.parametrize(
    "frame",
    [
        {"kind": "notes", "notes": [{"note": "started", "t": 0}], "more": b"\x00"},
        {"kind": "notes", "notes": [{"note": "started", "t": 0}], "more": float("nan")},
        {"kind": "footer", "outcome": {"reason": "goal", "steps": 1, "seconds": 1.0, "x": b"y"}},
        {"kind": "state", "step": 0, "hash": "", "facts": [10**6], "timers": [], "busy": {}},
    ],
    ids=["bytes", "nan", "bytes-in-outcome", "unknown-fact"],
)
def test_well_formed_frames_with_strange_content_are_read_or_refused(
    tmp_path: Path, frame: object
) -> None:
    import msgpack

    whole = unwrap(recordings()[0])
    outcome = file_targets(tmp_path)["recording"](whole + framed(msgpack.packb(frame)))
    assert outcome in ("read", "RecordingError")


def test_error_names_the_refused_recording(tmp_path: Path) -> None:
    path = tmp_path / "strange.rbt"
    path.write_bytes(MAGIC + framed(b"\xc1"))
    with pytest.raises(RecordingError, match=r"strange\.rbt: damaged at byte 5"):
        read_recording(path)


FILE_READERS: dict[str, Callable[[Path], object]] = {
    "recording": read_recording,
    "json": read_json,
    "private": lambda path: read_private(path, 100),
    "keys": FileKeyring,
    "revoked": load_revoked,
    "labels": read_labels,
    "rows": read_rows,
    "calls": CallJournal,
    "certificate": lambda path: ServerTLS(path, path),
}


@pytest.fixture
def alarm() -> Iterator[None]:
    """Interrupt a reader that waits for a pipe's writer, which would otherwise be for ever."""

    def ring(number: int, frame: FrameType | None) -> None:
        pytest.fail("the reader waits for a writer")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(10)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize("place", ["pipe", "link to a pipe", "/dev/zero"])
@pytest.mark.parametrize("reader", FILE_READERS)
@pytest.mark.usefixtures("alarm")
def test_only_regular_files_are_read(tmp_path: Path, reader: str, place: str) -> None:
    path = tmp_path / "file"
    if place == "pipe":
        os.mkfifo(path, 0o600)
    else:
        os.mkfifo(tmp_path / "pipe", 0o600)
        path.symlink_to("/dev/zero" if place == "/dev/zero" else tmp_path / "pipe")
    with pytest.raises(RobotouilleError, match="not a regular file"):
        FILE_READERS[reader](path)
