"""Rows of the operator API for rooms, participants and the server's figures."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from prometheus_client import Counter, Gauge

from robotouille.episode import Activity, Clock, Episode, Outcome, PauseReason, Phase, Seat
from robotouille.protocol.states import StateWriter
from robotouille_server.app import Server
from robotouille_server.operator.models import (
    EpisodeDetail,
    EpisodeResult,
    EpisodeRow,
    KitchenLook,
    KitchenTables,
    Lateness,
    LogLine,
    ParticipantRow,
    PauseState,
    Rates,
    RecordingState,
    SeatRow,
)
from robotouille_server.operator.principal import Principal
from robotouille_server.rooms.lobby import Lobby
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.metrics import BUCKETS, Metrics
from robotouille_server.runtime.task_folder import TaskAssets

KEPT_SECONDS = 60
SMOOTHED_SECONDS = 5
FORGOTTEN_AFTER = 30.0
"""Seconds after which the counters of a room that is not shown are dropped."""


@dataclass(frozen=True, slots=True)
class RateSample:
    """Counters at one moment. `late` counts steps per bucket of lateness."""

    at: float
    steps: float
    sent_bytes: float
    received: float
    late: tuple[int, ...]


class MetricsHistory:
    """Counters of the last minute, with one sample per second."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        # 60 differences need 61 samples.
        self._samples: deque[RateSample] = deque(maxlen=KEPT_SECONDS + 1)

    def sample(self, now: float) -> None:
        """Take a sample. Call this about once per second."""
        metrics = self._metrics
        late = tuple(metrics.lateness.counts)
        self._samples.append(
            RateSample(now, metrics.steps, metrics.sent_bytes, metrics.received, late)
        )

    def rate(self, of: Callable[[RateSample], float]) -> float:
        """Return a counter's growth per second, averaged over the last few seconds."""
        recent = list(self._samples)[-SMOOTHED_SECONDS - 1 :]
        return round(_growth(recent[0], recent[-1], of), 1) if len(recent) > 1 else 0.0

    def seconds(self, of: Callable[[RateSample], float]) -> list[float]:
        """Return a counter's growth in each of the last 60 seconds, oldest first."""
        return [round(_growth(a, b, of), 1) for a, b in pairwise(self._samples)]

    def lateness(self) -> Lateness:
        """Return how late the steps of the last minute were."""
        if len(self._samples) < 2:
            return Lateness(steps=0, p50=None, p99=None, p999=None)
        first, last = self._samples[0].late, self._samples[-1].late
        counts = [after - before for before, after in zip(first, last, strict=True)]
        return Lateness(
            steps=sum(counts),
            p50=_bound(counts, 0.5),
            p99=_bound(counts, 0.99),
            p999=_bound(counts, 0.999),
        )


def _bound(counts: list[int], share: float) -> float | None:
    """Return the bound that at most `1 - share` of the steps exceed; None beyond the buckets."""
    total, seen = sum(counts), 0
    for bound, count in zip(BUCKETS, counts, strict=False):
        seen += count
        if total and seen >= share * total:
            return bound * 1000
    return None


class RateMeter:
    """Growth per second of named counters; None until it has been measured."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[float, float, float | None]] = {}

    def __call__(self, name: str, count: float, now: float) -> float | None:
        """Return the rate of a counter that is now at `count`, measured over at least a second."""
        at, before, rate = self._seen.get(name, (now, count, None))
        # Several pages can ask in one second. Shorter intervals would give rates that jump.
        if now - at >= 1.0:
            rate = round(max(0.0, count - before) / (now - at), 1)
            at, before = now, count
        self._seen[name] = at, before, rate
        return rate

    def forget(self, now: float) -> None:
        """Drop counters that were not read in the last 30 seconds."""
        self._seen = {
            name: seen for name, seen in self._seen.items() if now - seen[0] < FORGOTTEN_AFTER
        }


def by_label(counter: Counter) -> dict[str, int]:
    """Return a counter's values above 0 by its only label, largest first."""
    found = {
        next(iter(sample.labels.values())): int(sample.value)
        for family in counter.collect()
        for sample in family.samples
        if sample.name.endswith("_total") and sample.value
    }
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def gauge(value: Gauge) -> int:
    """Return the value of a gauge."""
    return int(next(sample.value for family in value.collect() for sample in family.samples))


def _growth(first: RateSample, last: RateSample, of: Callable[[RateSample], float]) -> float:
    return (of(last) - of(first)) / max(last.at - first.at, 1e-9)


DEFAULT_PORT = 8765


def phase_of(room: Room) -> str:
    """Return `waiting`, `running`, `paused` or `ended`."""
    return room.episode.phase.value


def shown_code(code: str) -> str:
    """Return a join code as it is shown to people: XXXXX-XXXXX."""
    return f"{code[:5]}-{code[5:]}" if len(code) == 10 else code


def search_text(code: str, task: str, names: Iterable[str], labels: Mapping[str, str]) -> str:
    """Return the text of an episode or a recording that a search reads, in lower case."""
    pairs = (f"{name}={value}" for name, value in labels.items())
    return " ".join([code, shown_code(code), task, *names, *pairs]).lower()


class RoomRows:
    """Rows of one server's rooms. It remembers counters to compute rates.

    Attributes:
        node: Returns the address of the server's node in a cluster.
    """

    def __init__(self, server: Server, node: Callable[[], str] = str) -> None:
        self.node = node
        self._server = server
        self._rate = RateMeter()

    def forget(self, now: float) -> None:
        """Drop counters of rooms that were not shown lately."""
        self._rate.forget(now)

    def row(self, room: Room, now: float) -> EpisodeRow:
        """Return a room's row in the overview."""
        episode = room.episode
        members = {session.id: session for session in room.members}
        return EpisodeRow(
            episode=room.id,
            code=shown_code(room.code),
            task=room.world.task.name,
            clock=episode.rules.clock.value,
            step_rate=episode.rules.step_rate if episode.rules.clock is Clock.REALTIME else None,
            phase=phase_of(room),
            pause=_pause(episode, now),
            step=episode.step,
            max_steps=episode.rules.max_steps,
            seats=[self._seat(room, s, members.get(s.session)) for s in episode.seats.values()],
            spectators=room.spectators,
            rates=self._rates(room, now),
            recording=_recording(room),
            problem=room.problem,
            outcome=_result(episode.outcome),
            watch=self._watch(room),
            labels=dict(room.labels),
            node=self.node(),
        )

    def detail(self, room: Room, now: float, lines: Iterable[LogLine]) -> EpisodeDetail:
        """Return a room's row with its state as text, its spectators and recent events."""
        return EpisodeDetail(
            **dict(self.row(room, now)),
            audience=[
                *(self._spectator(room, s) for s in room.members if not s.players),
                *(self._spectator(room, guest) for guest in room.guests.values()),
            ],
            turn=room.episode.on_turn,
            state=_state(room),
            text=room.episode.state.text(None),
            lines=list(lines),
        )

    def _seat(self, room: Room, seat: Seat, session: Session | None) -> SeatRow:
        return SeatRow(
            player=seat.player,
            name=seat.name,
            kind=seat.kind,
            present=seat.present,
            controller=seat.controller.value,
            shown_as=seat.treatment.shown_as or "",
            delay_ms=seat.treatment.delay_ms,
            ready=seat.ready,
            rejected=seat.tally.rejected,
            **{activity.value: getattr(seat.tally, activity.value) for activity in Activity},
            **self._session(room, session),
        )

    def _spectator(self, room: Room, session: Session) -> ParticipantRow:
        return ParticipantRow(
            name=session.name,
            kind=session.kind,
            present=session.peer is not None or session.id in room.guests,
            **self._session(room, session),
        )

    def _session(self, room: Room, session: Session | None) -> dict[str, Any]:
        """Return the fields of a row that come from the session."""
        keep_address = self._server.settings.record_addresses
        visitor = session.visitor if session is not None and keep_address else None
        return {
            "session": None if session is None else session.id,
            "muted": session is not None and room.mutes(session),
            "latency_ms": _latency(session),
            "received_bytes": 0 if session is None else session.received_bytes,
            "recorded_bytes": 0 if session is None else session.recorded_bytes,
            "address": None if visitor is None else visitor.address,
        }

    def _rates(self, room: Room, now: float) -> Rates:
        peers = [session.peer for session in room.members if session.peer is not None]
        received = sum(peer.received for peer in peers)
        sent = sum(peer.sent for peer in peers)
        return Rates(
            received=self._rate(f"{room.id} received", received, now),
            sent=self._rate(f"{room.id} sent", sent, now),
        )

    def _watch(self, room: Room) -> str:
        url = "" if self._server.port == DEFAULT_PORT else f" --url {self._server.public_url}"
        return f"robotouille-client {shown_code(room.code)} --watch{url}"


def _pause(episode: Episode, now: float) -> PauseState | None:
    """Return why an episode is paused, or will be paused once it begins."""
    shown = episode.pauses.shown
    if shown is None or not (episode.paused or PauseReason.OPERATOR in episode.pauses):
        return None
    why, until = shown
    return PauseState(reason=why.value, left=None if until is None else max(0.0, until - now))


def recording_name(room: Room) -> str:
    """Return the name of a room's recording file, open or closed, or an empty text."""
    # The room has the final name only once the file is closed: until then it ends with `.part`.
    if room.recording or room.journal is None:
        return room.recording
    return "" if room.episode.phase is Phase.ENDED and not room.problem else room.journal.name


def _recording(room: Room) -> RecordingState | None:
    name = recording_name(room)
    if not name:
        return None
    size = room.journal.size if room.journal is not None and not room.recording else None
    return RecordingState(name=name, size=size, problem=room.problem)


def _result(outcome: Outcome | None) -> EpisodeResult | None:
    if outcome is None:
        return None
    return EpisodeResult(
        reason=outcome.reason.value,
        steps=outcome.steps,
        seconds=outcome.seconds,
        detail=outcome.detail,
    )


def _state(room: Room) -> dict[str, Any]:
    state = room.episode.state
    size = room.world.table_size(state.facts)
    return {"size": size, **StateWriter(room.world).values(state)}


def kitchen_tables(room: Room, assets: TaskAssets | None) -> KitchenTables:
    """Return everything for drawing a room, besides its changing state."""
    state = room.episode.state
    look = KitchenLook()
    if assets is not None:
        look = KitchenLook(
            rendering=dict(assets.rendering),
            bindings=dict(assets.bindings),
            pictures=dict(assets.pictures),
        )
    return KitchenTables(
        task=room.world.task.json,
        look=look,
        size=room.world.table_size(state.facts),
        **StateWriter(room.world).tables(state),
    )


def _latency(session: Session | None) -> float | None:
    """Return the milliseconds of a connection's round trip, once a ping was answered."""
    if session is None or session.peer is None:
        return None
    # The connection reports 0 until the first ping was answered.
    seconds = session.peer.latency
    return round(seconds * 1000, 1) if seconds > 0 else None


def rooms_of(lobby: Lobby, principal: Principal) -> list[Room]:
    """Return the rooms that a principal may see, newest first."""
    rooms = list(lobby.rooms.values())[::-1]
    if not principal.only_episode:
        return rooms
    return [room for room in rooms if principal.may_see(room.id, room.code)]
