"""The browser client holds the same conversations as the Python client."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from robotouille.protocol import messages
from robotouille.protocol.codec import JSON
from tests.support.node import node
from tests.web.conversations import Conversation

PROGRAM = Path(__file__).with_name("conversation.mjs")
Row = dict[str, Any]


def answered(events: list[Row]) -> list[Row]:
    """Return what the browser client sends and knows after each event."""
    text = "".join(json.dumps(event) + "\n" for event in events)
    done = subprocess.run([node(), PROGRAM], input=text, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def plain(request: messages.Message) -> messages.Message:
    """Return a request without the fields in which the clients differ on purpose.

    The page does not number joins. It asks for the chat from before its own time, which Python's
    programs receive apart from what is new.
    """
    if isinstance(request, messages.Join):
        return request.model_copy(update={"ref": None})
    if isinstance(request, messages.Hello) and request.seen is not None:
        seen = request.seen.model_copy(update={"said": 0})
        return request.model_copy(update={"seen": seen})
    return request


def compare(seed: int) -> set[str]:
    """Compare the clients in one conversation; return the types of its requests."""
    rows = list(Conversation(seed, 400))
    types: set[str] = set()
    pages = answered([event for event, _ in rows])
    for number, ((event, python), page) in enumerate(zip(rows, pages, strict=True)):
        where = f"seed {seed}, event {number}: {event}"
        sent = [plain(JSON.decode_client(json.dumps(each))) for each in page["sent"]]
        assert sent == [plain(each) for each in python["sent"]], where
        assert page["chat"] == python["chat"], where
        if python["game"] is not None:
            assert page["game"] == python["game"], where
        types |= {each["type"] for each in page["sent"]}
    late = superseded(pages)
    assert results(pages, late) == results([python for _, python in rows], late), f"seed {seed}"
    return types


def results(rows: list[Row], late: set[int]) -> dict[int, bool]:
    """Return which actions were applied, except late ones."""
    answers = (answer for row in rows for answer in row["answers"])
    return {seq: applied for seq, applied, _ in answers if seq not in late}


def superseded(pages: list[Row]) -> set[int]:
    """Return the actions that the page has replaced. Python waits for the server's answer."""
    return {seq for page in pages for seq, _, kind in page["answers"] if kind == "superseded"}


@pytest.mark.process
@pytest.mark.smoke
def test_page_and_python_hold_the_same_conversation() -> None:
    assert compare(2) == {"hello", "join", "act", "say", "resync"}


@pytest.mark.process
@pytest.mark.slow
def test_page_and_python_hold_the_same_conversations() -> None:
    found = set().union(*map(compare, range(10, 34)))
    assert found == {"hello", "join", "act", "say", "resync"}
