"""Detection of deliberate server faults by the simulation.

Each fault has a few seeds that find it soon. If the drawing of scenarios changes, the seeds stand
for other courses, and new seeds are needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import pytest

from robotouille.episode import ChatPosted, Event, Stepped
from robotouille.protocol import messages
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.rooms.publishing.publisher import Publisher
from robotouille_server.rooms.recording.journal import Journal
from robotouille_server.rooms.recording.write_ahead import WriteAhead
from robotouille_server.rooms.room import Room
from tests.programs.simulation.simulation import run_seed
from tests.support.deliberate_faults import publish_despite_failed_writes
from tests.support.samples import quick_sample

Plant = Callable[[pytest.MonkeyPatch], None]


@dataclass(frozen=True)
class Fault:
    """A fault, a part of its report, and seeds; at least one seed must find the fault."""

    plant: Plant
    seeds: tuple[int, ...]
    says: str


# Publishing before writing


def publish_before_writing(patch: pytest.MonkeyPatch) -> None:
    """Publish events before writing them, which only shows if the server is killed in between."""
    commit, publish = WriteAhead._commit, Publisher.publish
    published: list[Event] = []

    def hasty(write_ahead: WriteAhead, now: float) -> bool:
        if not write_ahead._gate.failing:
            for event in write_ahead._uncommitted:
                write_ahead._publish(event)
                published.append(event)
        return commit(write_ahead, now)

    def publish_others(publisher: Publisher, event: Event) -> None:
        if not any(event is known for known in published):
            publish(publisher, event)

    patch.setattr(WriteAhead, "_commit", hasty)
    patch.setattr(Publisher, "publish", publish_others)


# Actions that act twice


def ignore_sequence_numbers(patch: pytest.MonkeyPatch) -> None:
    """Accept every action as new, whatever its sequence number."""
    act = Room.act

    def forgetful(room: Room, session: Session, request: messages.Act) -> None:
        if session.player is not None:
            seat = room.episode.seat(request.seat or session.player)
            seat.seq = min(seat.seq, request.seq - 1)
        act(room, session, request)

    patch.setattr(Room, "act", forgetful)


def forget_sequence_numbers_on_restart(patch: pytest.MonkeyPatch) -> None:
    """Forget the sequence numbers of a recording when a room continues it."""
    init = Room.__init__

    def forgetful(room: Room, *values: Any, **options: Any) -> None:
        init(room, *values, **options)
        for seat in room.episode.seats.values():
            seat.seq = 0

    patch.setattr(Room, "__init__", forgetful)


# Messages of another episode


def all_broadcasters(patch: pytest.MonkeyPatch) -> list[Broadcaster]:
    """Collect the broadcasters of all rooms from now on."""
    known: list[Broadcaster] = []
    init = Broadcaster.__init__

    def noted(broadcaster: Broadcaster, *values: Any, **options: Any) -> None:
        init(broadcaster, *values, **options)
        known.append(broadcaster)

    patch.setattr(Broadcaster, "__init__", noted)
    return known


def send_chat_to_other_episodes(patch: pytest.MonkeyPatch) -> None:
    """Send the chat of one episode to all episodes."""
    broadcasters, publish_said = all_broadcasters(patch), Broadcaster.publish_said

    def tell_all(_: Broadcaster, event: ChatPosted) -> None:
        for broadcaster in broadcasters:
            publish_said(broadcaster, event)

    patch.setattr(Broadcaster, "publish_said", tell_all)


def send_deltas_to_other_episodes(patch: pytest.MonkeyPatch) -> None:
    """Send a step's delta to the members of all episodes."""
    broadcasters, publish_step = all_broadcasters(patch), Broadcaster.publish_step

    def tell_all(broadcaster: Broadcaster, event: Stepped) -> None:
        members = broadcaster.members
        broadcaster.members = [session for known in broadcasters for session in known.members]
        publish_step(broadcaster, event)
        broadcaster.members = members

    patch.setattr(Broadcaster, "publish_step", tell_all)


# Missing steps


def drop_deltas(patch: pytest.MonkeyPatch) -> None:
    """Drop the delta of every fifth step. Clients request a snapshot at the next delta; if all wait
    for the dropped one, the episode stands still.
    """
    publish_step = Broadcaster.publish_step

    def sparing(broadcaster: Broadcaster, event: Stepped) -> None:
        members = broadcaster.members
        broadcaster.members = [] if event.step % 5 == 3 else members
        publish_step(broadcaster, event)
        broadcaster.members = members

    patch.setattr(Broadcaster, "publish_step", sparing)


def omit_a_step_from_the_recording(patch: pytest.MonkeyPatch) -> None:
    """Publish the fourth step without recording it."""
    add = Journal.add

    def sparing(journal: Journal, events: Iterable[Event]) -> None:
        add(journal, [e for e in events if not (isinstance(e, Stepped) and e.step == 4)])

    patch.setattr(Journal, "add", sparing)


FAULTS = [
    Fault(publish_despite_failed_writes, (6, 9, 14), "recorded"),
    Fault(publish_before_writing, (4, 33), "recorded"),
    Fault(ignore_sequence_numbers, (247, 325, 359), "acted twice"),
    Fault(forget_sequence_numbers_on_restart, (20, 112), "acted twice"),
    Fault(send_chat_to_other_episodes, (1, 2, 19), "of another episode"),
    Fault(send_deltas_to_other_episodes, (7, 15, 36), "differs from the recorded state"),
    Fault(drop_deltas, (108, 114, 150), "not ended"),
    Fault(omit_a_step_from_the_recording, (0, 1), "recorded"),
]
SEEDS = sorted({seed for fault in FAULTS for seed in fault.seeds})


@pytest.mark.parametrize("fault", quick_sample(FAULTS), ids=lambda fault: fault.plant.__name__)
def test_server_fault_is_found(fault: Fault, monkeypatch: pytest.MonkeyPatch) -> None:
    fault.plant(monkeypatch)
    found: list[str] = []
    for seed in fault.seeds:
        found += run_seed(seed).faults
        if found:
            break
    assert any(fault.says in what for what in found), found or "the fault was not found"


@pytest.mark.parametrize("seed", quick_sample(SEEDS))
def test_same_seeds_find_nothing_without_a_fault(seed: int) -> None:
    report = run_seed(seed)
    assert report.ok, report.faults
