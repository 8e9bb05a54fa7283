"""What the event loop complains of fills no log."""

from __future__ import annotations

import asyncio

from structlog.testing import capture_logs

from robotouille_server.runtime.logs import LINE_SECONDS, LoopErrors


class Counts:
    log_suppressed = 0


def test_a_complaint_of_the_event_loop_is_logged_once_in_a_while() -> None:
    now, counts = 0.0, Counts()
    errors = LoopErrors(lambda: now, counts)
    loop = asyncio.new_event_loop()
    context = {"message": "socket.accept() out of system resource", "exception": OSError(24, "x")}
    with capture_logs() as lines:
        for _ in range(1000):
            errors.handle(loop, context)
        errors.handle(loop, {"message": "another", "exception": ValueError("y")})
        assert [line["message"] for line in lines] == [context["message"], "another"]
        assert counts.log_suppressed == 999
        now += LINE_SECONDS
        errors.handle(loop, context)
    assert lines[-1]["repeated"] == 999
    loop.close()
