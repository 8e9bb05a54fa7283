"""Paid calls are kept: nothing is asked twice, whatever happens to the file."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.models import Completion, Message, ModelRequest, Usage
from robotouille_evaluation.runs.journal import OVERFLOW, CallJournal


def request(text: str) -> ModelRequest:
    return ModelRequest((Message("user", text),), parameters={"temperature": 0.7})


def lines(path: Path) -> int:
    return len(path.read_bytes().splitlines())


ANSWER = Completion("Action: wait", Usage(12, 3, 0.001), seconds=1.5, attempts=2)


def test_what_was_answered_is_answered_again(tmp_path: Path) -> None:
    with CallJournal(tmp_path / "calls/a.jsonl") as journal:
        assert journal.answered(request("one")) is None
        journal.keep(request("one"), ANSWER)
        journal.keep(request("two"), None)
    with CallJournal(tmp_path / "calls/a.jsonl") as journal:
        assert journal.answered(request("one")) == ANSWER
        assert journal.answered(request("two")) == OVERFLOW
        assert journal.answered(request("three")) is None


def test_another_course_drops_what_is_behind(tmp_path: Path) -> None:
    with CallJournal(tmp_path / "a.jsonl") as journal:
        for text in ("one", "two", "three"):
            journal.keep(request(text), ANSWER)
    with CallJournal(tmp_path / "a.jsonl") as journal:
        assert journal.answered(request("one")) == ANSWER
        assert journal.answered(request("other")) is None
        journal.keep(request("other"), ANSWER)
    assert lines(tmp_path / "a.jsonl") == 2


def test_a_torn_line_is_cut_off(tmp_path: Path) -> None:
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
def test_a_file_that_is_no_journal_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text(f"{line}\n")
    with pytest.raises(FileError, match=r"a\.jsonl.*line 1"):
        CallJournal(path)


def test_no_prompt_is_in_it(tmp_path: Path) -> None:
    """Requests are kept as hashes: prompts are long, and the pack has them."""
    with CallJournal(tmp_path / "a.jsonl") as journal:
        journal.keep(request("a long prompt"), ANSWER)
    assert "a long prompt" not in (tmp_path / "a.jsonl").read_text()
