"""Write-ahead rule with a log that may fail."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import pytest

from robotouille import World
from robotouille.episode import (
    ChatPosted,
    Clock,
    Episode,
    Event,
    PauseReason,
    Rules,
)
from robotouille_server.rooms.recording.write_ahead import MAX_DEFERRED, CommitGate, WriteAhead

ONE = World("synchronous/01_cheese_sandwich")


@dataclass
class Log:
    """Log that keeps events, unless the disk is `full`; `attempts` counts writes."""

    full: bool = False
    attempts: int = 0
    pending: list[Event] = field(default_factory=list)
    written: list[Event] = field(default_factory=list)

    @property
    def waiting(self) -> int:
        return 100 * len(self.pending)

    @property
    def problem(self) -> str:
        return "no space" if self.full else ""

    def add(self, events: Iterable[Event]) -> None:
        self.pending += events

    def write(self) -> bool:
        self.attempts += 1
        if self.full:
            return False
        self.written += self.pending
        self.pending = []
        return True


class Table:
    """Running episode with its log, and the published events."""

    def __init__(self, log: Log | None) -> None:
        self.episode = Episode(ONE, Rules(clock=Clock.LOCKSTEP), 0.0)
        (player,) = ONE.players
        self.episode.join(player, "Ada", "human", 0.0)
        self.published: list[Event] = []
        self.failing: list[bool] = []
        self.gate = CommitGate(log)
        self.rule = WriteAhead(
            self.episode, log, self.gate, self.published.append, self.failing.append
        )
        self.rule.flush(0.0)
        self.published.clear()

    def say(self, text: str) -> None:
        self.episode.say("Ada", ONE.players[0], text, 1.0)

    def said(self) -> list[str]:
        return [event.text for event in self.published if isinstance(event, ChatPosted)]


@pytest.fixture
def log() -> Log:
    return Log()


@pytest.fixture
def table(log: Log) -> Table:
    return Table(log)


def test_events_are_written_before_they_are_published(table: Table, log: Log) -> None:
    written: list[bool] = []

    def publish(event: Event) -> None:
        written.append(any(event is known for known in log.written))

    rule = WriteAhead(table.episode, log, table.gate, publish, table.failing.append)
    for text in ("one", "two"):
        table.say(text)
        rule.flush(1.0)
    assert written == [True, True]


class TestFailingLog:
    @pytest.fixture(autouse=True)
    def fail(self, table: Table, log: Log) -> None:
        log.full = True
        table.say("lost?")
        table.rule.flush(1.0)

    def test_writing_is_retried_only_on_request(self, table: Table, log: Log) -> None:
        before = log.attempts
        table.say("more")
        table.rule.flush(1.5)
        assert log.attempts == before
        table.rule.flush(2.0, retry=True)
        assert log.attempts == before + 1
        assert table.failing == [True]

    def test_log_may_fail_at_the_end_of_the_pause(
        self, table: Table, log: Log, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        log.full = False
        write = log.write

        def once() -> bool:
            done = write()
            log.full = True
            return done

        monkeypatch.setattr(log, "write", once)
        table.rule.flush(2.0, retry=True)
        assert table.published == []
        assert table.gate.failing
        assert PauseReason.STORAGE in table.episode.pauses
        assert table.failing == [True, False, True]

    def test_deferred_answers_are_bounded_and_can_be_dropped(self, table: Table, log: Log) -> None:
        sent: list[str] = []
        for _ in range(MAX_DEFERRED + 3):
            table.gate.when_committed("ada", lambda: sent.append("ada"))
            table.gate.when_committed("bob", lambda: sent.append("bob"))
        table.gate.forget("bob")
        log.full = False
        table.rule.flush(2.0, retry=True)
        assert sent == MAX_DEFERRED * ["ada"]
