"""Whether the simulation would notice what it looks for: faults put into the server on purpose.

The seeds are some of those that find a fault soon. When scenarios are drawn in another way they
stand for other courses; then look for new ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import pytest

from robotouille.episode import Event, Said, Stepped
from robotouille.protocol import messages
from robotouille_server.rooms.broadcast.broadcaster import Broadcaster
from robotouille_server.rooms.publisher import Publisher
from robotouille_server.rooms.recordings.journal import Journal
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.write_ahead import WriteAhead
from tests.programs.simulation.simulation import run_seed
from tests.support.sabotage import told_though_not_written
from tests.support.samples import first_quickly

Plant = Callable[[pytest.MonkeyPatch], None]


@dataclass(frozen=True)
class Fault:
    """What is put in, seeds of which one at least must find it, and words of what it says."""

    plant: Plant
    seeds: tuple[int, ...]
    says: str


# Told before it is written


def told_before_written(patch: pytest.MonkeyPatch) -> None:
    """A room tells first and writes then: nobody notices but when it is killed in between."""
    commit, publish = WriteAhead.commit, Publisher.publish
    published: list[Event] = []

    def hasty(write_ahead: WriteAhead, now: float) -> bool:
        if not write_ahead.failing:
            for event in write_ahead._uncommitted:
                write_ahead._publish(event)
                published.append(event)
        return commit(write_ahead, now)

    def publish_others(publisher: Publisher, event: Event) -> None:
        if not any(event is known for known in published):
            publish(publisher, event)

    patch.setattr(WriteAhead, "commit", hasty)
    patch.setattr(Publisher, "publish", publish_others)


# An action that acts twice


def numbers_not_looked_at(patch: pytest.MonkeyPatch) -> None:
    """Every action is new, whatever its number."""
    act = Room.act

    def forgetful(room: Room, session: Session, request: messages.Act) -> None:
        if session.player is not None:
            seat = room.episode.seat(request.seat or session.player)
            seat.seq = min(seat.seq, request.seq - 1)
        act(room, session, request)

    patch.setattr(Room, "act", forgetful)


def numbers_forgotten_at_a_restart(patch: pytest.MonkeyPatch) -> None:
    """A room that goes on with a recording does not know which actions were heard."""
    init = Room.__init__

    def forgetful(room: Room, *values: Any, **options: Any) -> None:
        init(room, *values, **options)
        for seat in room.episode.seats.values():
            seat.seq = 0

    patch.setattr(Room, "__init__", forgetful)


# Another episode's


def all_broadcasters(patch: pytest.MonkeyPatch) -> list[Broadcaster]:
    """The broadcasters of all rooms from now on."""
    known: list[Broadcaster] = []
    init = Broadcaster.__init__

    def noted(broadcaster: Broadcaster, *values: Any, **options: Any) -> None:
        init(broadcaster, *values, **options)
        known.append(broadcaster)

    patch.setattr(Broadcaster, "__init__", noted)
    return known


def chat_heard_elsewhere(patch: pytest.MonkeyPatch) -> None:
    """What is said in one episode is told in all."""
    broadcasters, publish_said = all_broadcasters(patch), Broadcaster.publish_said

    def tell_all(_: Broadcaster, event: Said) -> None:
        for broadcaster in broadcasters:
            publish_said(broadcaster, event)

    patch.setattr(Broadcaster, "publish_said", tell_all)


def deltas_seen_elsewhere(patch: pytest.MonkeyPatch) -> None:
    """A step's delta goes to the members of all episodes."""
    broadcasters, publish_step = all_broadcasters(patch), Broadcaster.publish_step

    def tell_all(broadcaster: Broadcaster, event: Stepped) -> None:
        members = broadcaster.members
        broadcaster.members = [session for known in broadcasters for session in known.members]
        publish_step(broadcaster, event)
        broadcaster.members = members

    patch.setattr(Broadcaster, "publish_step", tell_all)


# A step that is missing


def delta_not_sent(patch: pytest.MonkeyPatch) -> None:
    """Every fifth step is told nobody. Clients ask for a picture when the next one comes; where
    all wait for it, the game stands still."""
    publish_step = Broadcaster.publish_step

    def sparing(broadcaster: Broadcaster, event: Stepped) -> None:
        members = broadcaster.members
        broadcaster.members = [] if event.step % 5 == 3 else members
        publish_step(broadcaster, event)
        broadcaster.members = members

    patch.setattr(Broadcaster, "publish_step", sparing)


def step_not_recorded(patch: pytest.MonkeyPatch) -> None:
    """The fourth step is told, but not in the recording."""
    add = Journal.add

    def sparing(journal: Journal, events: Iterable[Event]) -> None:
        add(journal, [e for e in events if not (isinstance(e, Stepped) and e.step == 4)])

    patch.setattr(Journal, "add", sparing)


FAULTS = [
    Fault(told_though_not_written, (6, 9, 14), "recorded"),
    Fault(told_before_written, (4, 33), "recorded"),
    Fault(numbers_not_looked_at, (141, 370, 430), "acted twice"),
    Fault(numbers_forgotten_at_a_restart, (20, 112), "acted twice"),
    Fault(chat_heard_elsewhere, (1, 2, 19), "of another episode"),
    Fault(deltas_seen_elsewhere, (7, 15, 36), "is another state than the recorded one"),
    Fault(delta_not_sent, (108, 114, 150), "not over"),
    Fault(step_not_recorded, (0, 1), "recorded"),
]
SEEDS = sorted({seed for fault in FAULTS for seed in fault.seeds})


@pytest.mark.parametrize("fault", first_quickly(FAULTS, 3), ids=lambda fault: fault.plant.__name__)
def test_a_fault_of_the_server_is_found(fault: Fault, monkeypatch: pytest.MonkeyPatch) -> None:
    fault.plant(monkeypatch)
    found: list[str] = []
    for seed in fault.seeds:
        found += run_seed(seed).faults
        if found:
            break
    assert any(fault.says in what for what in found), found or "not found"


@pytest.mark.parametrize("seed", first_quickly(SEEDS))
def test_without_it_the_same_seeds_find_nothing(seed: int) -> None:
    report = run_seed(seed)
    assert report.ok, report.faults
