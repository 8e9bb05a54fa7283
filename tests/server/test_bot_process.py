"""Process of the substitutes, request by request."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest

from robotouille.domain.loading import load_task
from robotouille.planning.bot_process import unpacker
from robotouille.world.world import shared_world
from robotouille_server.rooms.bot_worker import COMMAND
from robotouille_server.rooms.bots import (
    DONE,
    FAILED,
    UNKNOWN,
    ask_request,
    learn_request,
    task_request,
)
from tests.support.questions import question

TASK = load_task("training/03_multi_agent@2")
START = shared_world(TASK).initial


def replies(count: int, *requests: bytes) -> list[Any]:
    """Return the first replies of a process to some requests."""
    stream, found = unpacker(), []
    with subprocess.Popen(COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(b"".join(requests))
        process.stdin.flush()
        while len(found) < count:
            stream.feed(process.stdout.read1())
            found.extend(stream)
        process.stdin.close()
        assert process.wait(timeout=30) == 0
    return found


@pytest.mark.process
def test_question_about_known_task_is_answered() -> None:
    asked = ask_request(2, TASK.digest, question(START, kind="random"))
    ((number, how, answer),) = replies(1, task_request(TASK), asked)
    assert (number, how) == (2, DONE)
    assert shared_world(TASK).action(answer[0], *answer[1:])


@pytest.mark.process
@pytest.mark.parametrize(
    "request_bytes",
    [
        learn_request(1, TASK.digest, "robot1"),
        ask_request(1, TASK.digest, question(START, kind="random")),
    ],
    ids=["learn", "ask"],
)
def test_request_about_unknown_task_is_refused(request_bytes: bytes) -> None:
    assert replies(1, request_bytes) == [(1, UNKNOWN, None)]


@pytest.mark.process
def test_failed_request_does_not_end_the_process() -> None:
    nonsense = question(START, player="nobody", kind="random")
    fine = question(START, bot=2, kind="random")
    found = replies(
        2,
        task_request(TASK),
        ask_request(1, TASK.digest, nonsense),
        ask_request(2, TASK.digest, fine),
    )
    assert [(number, how) for number, how, _ in found] == [(1, FAILED), (2, DONE)]
