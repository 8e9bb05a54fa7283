"""Copying recordings from a program that only pretends to be NATS."""

from __future__ import annotations

import threading
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("nats", reason="needs the extra `cluster`")

from robotouille.nats.address import nats_address
from robotouille_data import cluster_recordings
from robotouille_data.cluster_recordings import ClusterRecordings
from robotouille_data.database import UnavailableError
from tests.support.lying_nats import MIB, endless, hangs_up, lying_nats

STATE = {"messages": 1, "bytes": 1, "first_seq": 1, "last_seq": 1, "consumer_count": 0}
STREAM: dict[str, Any] = {"config": {"name": "S"}, "state": STATE}
CONSUMER = {"stream_name": "S", "name": "c", "created": "2026-01-01T00:00:00Z", "config": {}}


def fetch(url: str, folder: Path) -> str:
    """Return the reason why nothing can be copied."""
    recordings = ClusterRecordings(nats_address(url, "robotouille"), folder)
    with pytest.raises(UnavailableError) as caught:
        recordings.fetch(threading.Event(), lambda: nullcontext(lambda done, total: None))
    return str(caught.value)


@pytest.mark.parametrize(
    "stream",
    [
        None, [], {}, {"error": "x"}, {**STREAM, "created": 5}, {**STREAM, "created": "then"},
        {**STREAM, "state": "x"}, {**STREAM, "state": {**STATE, "last_seq": "x"}},
        b"\xff", b"[" * 100_000,
    ],
)  # fmt: skip
def test_invalid_description_of_the_store_is_reported(stream: Any, tmp_path: Path) -> None:
    with lying_nats({"STREAM.INFO": stream}) as (url, _):
        assert "the server's answer is invalid" in fetch(url, tmp_path)


@pytest.mark.parametrize(
    "answers",
    [
        {"CONSUMER.CREATE": None},
        {"CONSUMER.CREATE": {}},
        {"CONSUMER.CREATE": CONSUMER, "CONSUMER.INFO": None},
        {"CONSUMER.CREATE": CONSUMER, "CONSUMER.INFO": {**CONSUMER, "num_pending": "x"}},
    ],
)
def test_invalid_reader_of_the_store_is_reported(answers: Any, tmp_path: Path) -> None:
    with lying_nats({"STREAM.INFO": STREAM, **answers}) as (url, _):
        assert "the server's answer is invalid" in fetch(url, tmp_path)


@pytest.mark.parametrize("greeting", [None, [], 5])
def test_invalid_greeting_is_reported(greeting: Any, tmp_path: Path) -> None:
    with lying_nats({}, greeting) as (url, _):
        assert f"cannot connect to NATS at {url}" in fetch(url, tmp_path)


def test_server_that_hangs_up_is_not_called_all_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_recordings, "ANSWER_SECONDS", 0.5)
    with lying_nats(hangs_up) as (url, liar):
        assert fetch(url, tmp_path).startswith("NATS: ")
    assert liar.connections < 10


def test_message_without_end_does_not_fill_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_recordings, "ANSWER_SECONDS", 0.5)
    with lying_nats({"STREAM.INFO": endless}) as (url, liar):
        assert fetch(url, tmp_path).startswith("NATS: ")
    assert liar.sent < 50 * MIB
