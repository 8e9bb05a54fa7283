"""Journal of paid calls: no call is repeated, whatever happens to the file."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.models import Completion, Message, ModelRequest, Usage
from robotouille_evaluation.runs.journal import CallJournal


def request(text: str) -> ModelRequest:
    return ModelRequest((Message("user", text),), parameters={"temperature": 0.7})


def lines(path: Path) -> int:
    return len(path.read_bytes().splitlines())


ANSWER = Completion("Action: wait", Usage(12, 3, 0.001), seconds=1.5, attempts=2)


def test_different_request_drops_the_rest(tmp_path: Path) -> None:
    with CallJournal(tmp_path / "a.jsonl") as journal:
        for text in ("one", "two", "three"):
            journal.keep(request(text), ANSWER)
    with CallJournal(tmp_path / "a.jsonl") as journal:
        assert journal.answered(request("one")) == ANSWER
        assert journal.answered(request("other")) is None
        journal.keep(request("other"), ANSWER)
    assert lines(tmp_path / "a.jsonl") == 2


@pytest.mark.slow
def test_truncated_line_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    with CallJournal(path) as journal:
        journal.keep(request("one"), ANSWER)
        journal.keep(request("two"), ANSWER)
    whole = path.read_bytes()
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        kept = whole[:size].count(b"\n")
        with CallJournal(path) as journal:
            for text in ("one", "two")[:kept]:
                assert journal.answered(request(text)) == ANSWER
            journal.keep(request("next"), ANSWER)
        assert lines(path) == kept + 1


@pytest.mark.parametrize(
    "line",
    [
        "nonsense",
        "{}",
        "[]",
        "[" * 5000,
        '{"request": 1}',
        '{"request": "x"}',
        '{"request": "x", "completion": {"text": 1}}',
        '{"request": "x", "completion": {"text": "", "usage": []}}',
        '{"request": "x", "completion": {"text": "", "usage": {"prompt_tokens": "many"}}}',
        '{"request": "x", "completion": {"text": "", "usage": {"prompt_tokens": 1e999}}}',
        '{"request": "x", "completion": {"text": "", "usage": {"prompt_tokens": -1}}}',
        '{"request": "x", "completion": {"text": "", "usage": {"cost": 1e999}}}',
        '{"request": "x", "completion": {"text": "", "seconds": NaN}}',
        '{"request": "x", "completion": {"text": "", "attempts": 1%s}}' % ("0" * 5000),
        '{"request": "x", "completion": {"text": ""}, "overflow": true}',
        '{"request": "x", "completion": {"text": "", "other": 1}}',
    ],
)
def test_invalid_journal_is_an_error(tmp_path: Path, line: str) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text(f"{line}\n")
    with CallJournal(path) as journal, pytest.raises(FileError, match=r"a\.jsonl.*line 1"):
        journal.answered(request("one"))


def test_calls_are_read_one_at_a_time(tmp_path: Path) -> None:
    """A received journal of 300 MB of short lines took more than 5 GB of memory."""
    path = tmp_path / "a.jsonl"
    path.write_bytes(b'{"request":"","overflow":true}\n' * 300_000)
    tracemalloc.start()
    with CallJournal(path) as journal:
        assert journal.answered(request("one")) is None
        _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000
    assert path.read_bytes() == b""


def test_too_long_line_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_bytes(b" " * 9_000_000)
    with CallJournal(path) as journal, pytest.raises(FileError, match="longer than 8,388,608"):
        journal.answered(request("one"))


def test_prompts_are_stored_as_hashes(tmp_path: Path) -> None:
    """Prompts are long, and the pack contains them."""
    with CallJournal(tmp_path / "a.jsonl") as journal:
        journal.keep(request("a long prompt"), ANSWER)
    assert "a long prompt" not in (tmp_path / "a.jsonl").read_text()
