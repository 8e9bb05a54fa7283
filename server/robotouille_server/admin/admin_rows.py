"""Rooms and sessions as rows of the API. Beside `admin_service`, nothing else knows rooms."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.episode import Clock, Episode, Outcome, PauseReason, Phase, Seat
from robotouille_server.admin.models import (
    AudienceRow,
    EpisodeDetail,
    EpisodeRow,
    Line,
    PauseState,
    Rates,
    RecordingState,
    Result,
    SeatRow,
)
from robotouille_server.admin.rates import RateOf
from robotouille_server.app import Server
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import Session

__all__ = ["PHASES", "RowBuilder", "phase_of", "recording_name", "shown_code"]

DEFAULT_PORT = 8765
PHASES = ("paused", "running", "waiting", "over")
"""Those to look after first."""


def phase_of(room: Room) -> str:
    """`waiting`, `running`, `paused` or `over`."""
    return room.episode.phase.value


def shown_code(code: str) -> str:
    """A join code as people read it: XXXXX-XXXXX."""
    return f"{code[:5]}-{code[5:]}" if len(code) == 10 else code


class RowBuilder:
    """Makes the rows of one server's rooms; remembers counters to tell rates."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._rate = RateOf()

    def forget(self, now: float) -> None:
        """Drop counters of rooms that nobody has looked at lately."""
        self._rate.forget(now)

    def row(self, room: Room, now: float) -> EpisodeRow:
        """What the list shows of a room."""
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
        )

    def detail(self, room: Room, now: float, lines: Iterable[Line]) -> EpisodeDetail:
        """A room with its state in words and who looks on."""
        return EpisodeDetail(
            **dict(self.row(room, now)),
            audience=[self._audience(room, s) for s in room.members if not s.players],
            turn=room.episode.on_turn,
            text=room.episode.state.text(None),
            lines=list(lines),
        )

    def _seat(self, room: Room, seat: Seat, session: Session | None) -> SeatRow:
        return SeatRow(
            player=seat.player,
            name=seat.name,
            kind=seat.kind,
            controller=seat.controller.value,
            shown_as=seat.treatment.shown_as or "",
            delay_ms=seat.treatment.delay_ms,
            present=seat.present,
            ready=seat.ready,
            muted=session is not None and room.mutes(session),
            session=None if session is None else session.id,
            latency_ms=_latency(session),
            received_bytes=0 if session is None else session.received_bytes,
            recorded_bytes=0 if session is None else session.recorded_bytes,
            address=self._address(session),
            acted=seat.tally.acted,
            busy=seat.tally.busy,
            waiting=seat.tally.waiting,
            idle=seat.tally.idle,
            away=seat.tally.away,
            substituted=seat.tally.substituted,
            rejected=seat.tally.rejected,
        )

    def _audience(self, room: Room, session: Session) -> AudienceRow:
        return AudienceRow(
            session=session.id,
            name=session.name,
            kind=session.kind,
            present=session.peer is not None,
            muted=room.mutes(session),
            latency_ms=_latency(session),
            received_bytes=session.received_bytes,
            recorded_bytes=session.recorded_bytes,
            address=self._address(session),
        )

    def _address(self, session: Session | None) -> str | None:
        """Null unless the server is set to keep addresses."""
        if session is None or session.visitor is None:
            return None
        return session.visitor.address if self._server.settings.record_addresses else None

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
    """Why an episode stands still, or will once it has begun."""
    shown = episode.pauses.shown
    if shown is None or not (episode.paused or PauseReason.OPERATOR in episode.pauses):
        return None
    why, until = shown
    return PauseState(reason=why.value, left=None if until is None else max(0.0, until - now))


def recording_name(room: Room) -> str:
    """The file of a room's recording, while it grows and when it is closed; empty if none."""
    if room.recording or room.journal is None:
        return room.recording
    return "" if room.episode.phase is Phase.ENDED and not room.problem else room.journal.name


def _recording(room: Room) -> RecordingState | None:
    name = recording_name(room)
    if not name:
        return None
    size = room.journal.size if room.journal is not None and not room.recording else None
    return RecordingState(name=name, size=size, problem=room.problem)


def _result(outcome: Outcome | None) -> Result | None:
    if outcome is None:
        return None
    return Result(
        reason=outcome.reason.value,
        steps=outcome.steps,
        seconds=outcome.seconds,
        detail=outcome.detail,
    )


def _latency(session: Session | None) -> float | None:
    """Milliseconds of a connection's round trip, once a ping has come back."""
    if session is None or session.peer is None:
        return None
    seconds = session.peer.latency
    return round(seconds * 1000, 1) if seconds > 0 else None
