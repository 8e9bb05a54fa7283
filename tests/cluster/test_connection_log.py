"""Log of a node that loses NATS, or does not find it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import structlog
from structlog.testing import capture_logs

from robotouille.errors import RobotouilleError
from robotouille.nats.address import NatsAddress
from robotouille_server.cluster.nats.connection_log import ConnectionLog
from robotouille_server.cluster.nats.nats_bus import nats_bus
from tests.support.virtual_time import virtual

SERVERS = tuple(f"nats://127.0.0.1:{port}" for port in (1, 2, 3))


@pytest.fixture(autouse=True)
def all_levels() -> Iterator[None]:
    """Log warnings, too, which the settings of other tests filter."""
    config = structlog.get_config()
    structlog.reset_defaults()
    yield
    structlog.configure(**config)


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def fail(log: ConnectionLog, clock: Clock, seconds: int) -> None:
    """Try three servers in turn, 16 times a second."""
    for attempt in range(16 * seconds):
        clock.now += 1 / 16
        log.failed(OSError(f"no server {attempt % 3}"))


def test_loss_and_return_are_logged_once_and_attempts_every_ten_seconds() -> None:
    clock = Clock()
    log = ConnectionLog(clock)
    log.connected()
    with capture_logs() as logs:
        for _ in range(2):
            log.lost()
            fail(log, clock, 35)
            log.returned("nats1:4222")
    lines = [(line["event"], line.get("failed_attempts")) for line in logs]
    once = [
        ("connection to NATS lost", None),
        ("NATS cannot be reached", 160),
        ("NATS cannot be reached", 320),
        ("NATS cannot be reached", 480),
        ("connected to NATS again", 560),
    ]
    assert lines == [*once, *once]


def test_short_loss_is_logged_in_two_lines() -> None:
    clock = Clock()
    log = ConnectionLog(clock)
    log.connected()
    with capture_logs() as logs:
        log.lost()
        fail(log, clock, 1)
        log.returned("nats1:4222")
    assert len(logs) == 2
    assert log.reason == ""


def test_different_errors_of_a_connection_are_all_logged() -> None:
    log = ConnectionLog(Clock())
    log.connected()
    with capture_logs() as logs:
        for text in ("a", "a", "b"):
            log.failed(OSError(text))
    assert [line["error"] for line in logs] == ["a", "b"]


@virtual
async def test_node_that_finds_no_server_logs_one_line_and_gives_the_reason() -> None:
    with capture_logs() as logs, pytest.raises(RobotouilleError, match="Connect call failed"):
        async with nats_bus(NatsAddress(SERVERS, "robotouille")):
            pass
    (line,) = logs
    assert (line["event"], line["failed_attempts"]) == ("NATS cannot be reached", 1)
