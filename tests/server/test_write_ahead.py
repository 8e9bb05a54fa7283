"""The write-ahead rule by itself: collect, commit, retry, publish, with a log that may fail."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import pytest

from robotouille import World
from robotouille.episode import (
    Clock,
    Ended,
    Episode,
    Event,
    Paused,
    PauseReason,
    Resumed,
    Rules,
    Said,
)
from robotouille.errors import ProtocolError
from robotouille_server.rooms import write_ahead
from robotouille_server.rooms.write_ahead import MAX_DEFERRED, WriteAhead

ONE = World("synchronous/01_cheese_sandwich")


@dataclass
class Log:
    """Keeps what is written, unless the disk is `full`; `attempts` counts writes."""

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
    """An episode that runs, its log, and what was published and reported of it."""

    def __init__(self, log: Log | None) -> None:
        self.episode = Episode(ONE, Rules(clock=Clock.LOCKSTEP), 0.0)
        (player,) = ONE.players
        self.episode.join(player, "Ada", "human", 0.0)
        self.published: list[Event] = []
        self.failing: list[bool] = []
        self.rule = WriteAhead(self.episode, log, self.published.append, self.failing.append)
        self.rule.flush(0.0)
        self.published.clear()

    def say(self, text: str) -> None:
        self.episode.say("Ada", ONE.players[0], text, 1.0)

    def said(self) -> list[str]:
        return [event.text for event in self.published if isinstance(event, Said)]


@pytest.fixture
def log() -> Log:
    return Log()


@pytest.fixture
def table(log: Log) -> Table:
    return Table(log)


def test_all_that_is_published_was_written_before(table: Table, log: Log) -> None:
    written: list[bool] = []

    def publish(event: Event) -> None:
        written.append(any(event is known for known in log.written))

    rule = WriteAhead(table.episode, log, publish, table.failing.append)
    for text in ("one", "two"):
        table.say(text)
        rule.flush(1.0)
    assert written == [True, True]


def test_flush_returns_what_it_has_published(table: Table) -> None:
    table.say("hello")
    assert table.rule.flush(1.0) == table.published
    assert table.rule.flush(1.0) == []


def test_without_a_log_everything_is_published_at_once() -> None:
    table = Table(None)
    table.say("hello")
    table.rule.flush(1.0)
    assert table.said() == ["hello"]


def test_nothing_is_written_where_nothing_has_happened(table: Table, log: Log) -> None:
    before = log.attempts
    table.rule.flush(1.0)
    assert log.attempts == before


class TestAFailingLog:
    @pytest.fixture(autouse=True)
    def fail(self, table: Table, log: Log) -> None:
        log.full = True
        table.say("lost?")
        table.rule.flush(1.0)

    def test_nothing_is_published_and_the_episode_is_paused(self, table: Table) -> None:
        assert table.published == []
        assert PauseReason.STORAGE in table.episode.pauses
        assert table.failing == [True]

    def test_it_is_tried_again_only_when_that_is_asked_for(self, table: Table, log: Log) -> None:
        before = log.attempts
        table.say("more")
        table.rule.flush(1.5)
        assert log.attempts == before
        table.rule.flush(2.0, retry=True)
        assert log.attempts == before + 1
        assert table.failing == [True]

    def test_all_is_published_in_order_once_it_can_be_written(self, table: Table, log: Log) -> None:
        table.say("again")
        log.full = False
        table.rule.flush(2.0, retry=True)
        kinds = [type(event) for event in table.published]
        assert kinds == [Said, Paused, Said, Resumed]
        assert table.said() == ["lost?", "again"]
        assert log.written[-4:] == table.published
        assert table.failing == [True, False]
        assert PauseReason.STORAGE not in table.episode.pauses

    def test_a_log_that_fails_at_the_end_of_the_pause_goes_on_failing(
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
        assert table.rule.failing
        assert PauseReason.STORAGE in table.episode.pauses
        assert table.failing == [True, False, True]

    def test_what_shows_the_state_waits(self, table: Table, log: Log) -> None:
        sent: list[str] = []
        table.rule.when_committed("ada", lambda: sent.append("snapshot"))
        assert sent == []
        log.full = False
        table.rule.flush(2.0, retry=True)
        assert sent == ["snapshot"]
        table.rule.when_committed("ada", lambda: sent.append("another"))
        assert sent == ["snapshot", "another"]

    def test_so_much_waits_for_each_and_nothing_for_who_has_gone(
        self, table: Table, log: Log
    ) -> None:
        sent: list[str] = []
        for _ in range(MAX_DEFERRED + 3):
            table.rule.when_committed("ada", lambda: sent.append("ada"))
            table.rule.when_committed("bob", lambda: sent.append("bob"))
        table.rule.forget("bob")
        log.full = False
        table.rule.flush(2.0, retry=True)
        assert sent == MAX_DEFERRED * ["ada"]

    def test_what_has_to_be_recorded_is_refused(self, table: Table, log: Log) -> None:
        with pytest.raises(ProtocolError, match="no space; try again later"):
            table.rule.check()
        log.full = False
        table.rule.flush(2.0, retry=True)
        table.rule.check()

    def test_coming_back_is_refused_once_too_much_waits(
        self, table: Table, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        table.rule.check_space()
        monkeypatch.setattr(write_ahead, "MAX_UNWRITTEN", 100)
        with pytest.raises(ProtocolError, match="no space"):
            table.rule.check_space()

    def test_an_episode_that_ends_meanwhile_is_published_when_it_is_written(
        self, table: Table, log: Log
    ) -> None:
        table.episode.abort(2.0, "the server stops")
        table.rule.flush(2.0)
        assert table.published == []
        log.full = False
        table.rule.flush(3.0, retry=True)
        assert any(isinstance(event, Ended) for event in table.published)
        assert log.pending == []
