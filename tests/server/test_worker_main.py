"""The process of the substitute bots, request by request."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import msgpack
import pytest

from robotouille.domain.loading import load_task
from robotouille.world.world import shared_world
from robotouille_server.rooms.substitutes.worker_main import (
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
COMMAND = "from robotouille_server.rooms.substitutes.worker_main import main; main()"


def replies(*requests: bytes) -> list[Any]:
    """What a process answers that is ended then."""
    done = subprocess.run(
        [sys.executable, "-c", COMMAND], input=b"".join(requests), capture_output=True, check=True
    )
    unpacker = msgpack.Unpacker(use_list=False)
    unpacker.feed(done.stdout)
    return list(unpacker)


@pytest.mark.process
def test_a_question_about_a_task_that_was_shown_is_answered() -> None:
    asked = ask_request(2, TASK.digest, question(START, kind="random"))
    ((number, how, answer),) = replies(task_request(TASK), asked)
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
def test_one_about_another_task_is_not(request_bytes: bytes) -> None:
    assert replies(request_bytes) == [(1, UNKNOWN, None)]


@pytest.mark.process
def test_a_request_that_fails_does_not_end_the_process() -> None:
    nonsense = question(START, player="nobody", kind="random")
    fine = question(START, bot=2, kind="random")
    found = replies(
        task_request(TASK),
        ask_request(1, TASK.digest, nonsense),
        ask_request(2, TASK.digest, fine),
    )
    assert [(number, how) for number, how, _ in found] == [(1, FAILED), (2, DONE)]
