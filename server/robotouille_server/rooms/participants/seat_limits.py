"""Limits per room: unique display names, recorded round trips, and changes of seats.

Every change of a seat is recorded, so a client that comes and goes must not fill the recording.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

from robotouille.episode import Chat, Episode
from robotouille.errors import ProtocolError
from robotouille.planning.policies.standing import is_out_of_the_way
from robotouille.protocol import messages
from robotouille.protocol.participant_names import distinct_name, likeness
from robotouille_server.rooms.participants.session import Session
from robotouille_server.runtime.budgets import TokenBucket

MANY = 200
"""Number of equal names above which the search for a free number starts at their count."""


RESERVED_NAMES = frozenset({"operator", "server", "system"})
"""Names that would give a participant's words false authority."""


class DisplayNames:
    """Chooses names that are unique among the participants and spectators of an episode.

    Reserved names and the seats' names count as taken. Otherwise, a participant in one seat could
    pose as another seat, or as the operator.

    Args:
        seats: Returns each player and the name of its participant, which is empty for a free seat.
    """

    __slots__ = ("_alike", "_seats", "_watching")

    def __init__(self, seats: Callable[[], Collection[tuple[str, str]]]) -> None:
        self._seats = seats
        self._watching: set[str] = set()
        self._alike: Counter[str] = Counter()

    def choose(self, name: str, players: Collection[str] = ()) -> str:
        """Return the name, with a number if it is taken; `players` are the participant's seats."""
        seats = self._seats()
        taken = {likeness(name) for _, name in seats if name} | RESERVED_NAMES
        taken |= {likeness(player) for player, _ in seats if player not in players}
        like, alike = likeness(name), self._alike
        alike[like] += 1
        # This bounds the number of counters, because a client could join with ever new names.
        if len(alike) > MANY:
            alike.clear()
        # With thousands of equal names, the search for the first free number would take long.
        first = alike[like] if alike[like] > MANY else 2
        return distinct_name(name, lambda like: like in taken or like in self._watching, first)

    def watch(self, name: str) -> None:
        """Reserve the name of a spectator."""
        self._watching.add(likeness(name))

    def release(self, name: str) -> None:
        """Free the name of a spectator who has left."""
        self._watching.discard(likeness(name))


class FirstNames:
    """First names of participants with tokens for one episode.

    Where chat is limited, they keep these names: everybody reads names, so a participant could
    otherwise write with a new name for each `join`.

    Attributes:
        known: The name of each such participant.
    """

    __slots__ = ("known",)

    def __init__(self, known: Mapping[str, str]) -> None:
        self.known = dict(known)

    def choose(self, session: Session, chat: Chat) -> str:
        """Return the name that a participant may have in an episode with this chat."""
        # Several programs, with names of their own, may share any other token.
        if chat is Chat.FREE or not session.limits.only_episode:
            return session.given_name
        return self.known.setdefault(session.participant, session.given_name)

    def learn(self, names: Mapping[str, str]) -> None:
        """Add the first names that participants have used at another node of the cluster."""
        self.known = {**names, **self.known}


LOOK_SECONDS = 10.0
"""Seconds between two measurements of all round trips."""
MIN_CHANGE, MAX_CHANGE = 0.001, 0.02
"""Least and greatest threshold, in seconds, of the change that records a round trip again."""
SHOWN_MS = 50
"""Shown round trips are multiples of this. Exact ones would change all the time."""


class RoundTrips:
    """Round trips of an episode's seats, as they were recorded last."""

    __slots__ = ("_recorded",)

    def __init__(self) -> None:
        self._recorded: dict[str, float] = {}

    def measure(self, members: Iterable[Session]) -> tuple[bool, list[tuple[str, float]]]:
        """Update the latency that each session shows.

        Returns:
            True if a shown latency has changed, and the round trips to record: player and seconds.
        """
        # The connection's pings (every 20 seconds) already measure the latency.
        measured = [
            (session, session.peer.latency)
            for session in members
            if session.players and session.peer is not None and session.peer.latency > 0
        ]
        before = [session.latency_ms for session, _ in measured]
        for session, seconds in measured:
            session.latency_ms = shown_latency(seconds, session.latency_ms)
        changed = before != [session.latency_ms for session, _ in measured]
        seats = [(player, seconds) for session, seconds in measured for player in session.players]
        return changed, [seat for seat in seats if self.changed(*seat)]

    def changed(self, player: str, seconds: float) -> bool:
        """Return whether a round trip must be recorded, and remember it if so.

        The first round trip is recorded, and each one that differs from the recorded one by more
        than a quarter or 20 ms, and by at least 1 ms.
        """
        before = self._recorded.get(player)
        if before is not None:
            change = abs(seconds - before)
            # Otherwise, an unsteady network would add a note per seat every ten seconds.
            if change < MIN_CHANGE or change <= min(before / 4, MAX_CHANGE):
                return False
        self._recorded[player] = seconds
        return True


def shown_latency(seconds: float, shown: int) -> int:
    """Return the latency to show, in milliseconds, for a round trip.

    The value shown before is kept unless the round trip has changed by more than 50 ms and by more
    than a quarter.
    """
    milliseconds = seconds * 1000
    if abs(milliseconds - shown) <= max(SHOWN_MS, shown / 4):
        return shown
    return round(milliseconds / SHOWN_MS) * SHOWN_MS


SEAT_CHANGES, SEAT_CHANGES_AT_ONCE = 20, 40
"""Changes of a seat per minute and in a burst: joining, coming back, becoming ready or unready."""


class SeatTurnover:
    """Budget of changes for each seat."""

    __slots__ = ("_budgets",)

    def __init__(self, players: Iterable[str], now: float) -> None:
        self._budgets = {
            player: TokenBucket(SEAT_CHANGES / 60, now, SEAT_CHANGES_AT_ONCE) for player in players
        }

    def charge(
        self, players: Iterable[str], now: float, too_often: str = "has changed hands"
    ) -> None:
        """Charge a change to all these seats.

        Raises:
            ProtocolError: `rate/seats` if one of the seats has changed too often. None is charged.
        """
        budgets = {player: self._budgets[player] for player in players}
        for player, budget in budgets.items():
            # All seats are checked before any is charged, so a refused request costs nothing.
            if budget.left(now) < 1:
                message = f"{player} {too_often} too often; try again in a minute"
                raise ProtocolError("rate/seats", message, "seat")
        for budget in budgets.values():
            budget.take(now)

    def choose(
        self, episode: Episode, request: messages.Join, now: float, *, idle: bool = False
    ) -> Sequence[str]:
        """Return the seats to join, and charge them.

        These are the requested seats, all free seats, or a free seat that has not changed hands
        too often.

        Args:
            episode: The episode.
            request: The message of the participant.
            now: The current time.
            idle: True if the newcomer may stand still for long. It then gets a seat whose player
                is not in the way of others, if possible.

        Raises:
            ProtocolError: As `Episode.join` does, or `rate/seats`. Nothing is charged then.
        """
        players = self._wanted(episode, request, now, idle=idle)
        episode.record.check_free(players)
        self.charge(players, now)
        return players

    def _wanted(
        self, episode: Episode, request: messages.Join, now: float, *, idle: bool
    ) -> Sequence[str]:
        if request.seat is not None:
            return (request.seat,)
        if request.seats and request.seats != "all":
            return request.seats
        free = episode.record.free_seats()
        if request.seats == "all":
            return free
        # A client that joins and leaves one seat in a loop must not keep others out of the room.
        rested = [one for one in free if self._budgets[one].left(now) >= 1] or list(free[:1])
        aside = (one for one in rested if idle and is_out_of_the_way(episode.state, one))
        return [next(aside, rested[0])]


CHAT_LINES, CHAT_LINES_AT_ONCE = 2.0, 10.0
"""Chat lines of a seat per second and in a burst."""
SPECTATOR_SHARE = 5
"""Number of seats whose budget all spectators share."""


class ChatLimits:
    """Budget of chat lines for each seat, and one for all spectators together.

    Everybody in the room receives each line, and no line is ever skipped, so a line costs the
    server as much as hundreds of other messages.
    """

    __slots__ = ("_seats", "_spectators")

    def __init__(self, players: Iterable[str], now: float) -> None:
        self._seats = {
            player: TokenBucket(CHAT_LINES, now, CHAT_LINES_AT_ONCE) for player in players
        }
        self._spectators = TokenBucket(
            SPECTATOR_SHARE * CHAT_LINES, now, SPECTATOR_SHARE * CHAT_LINES_AT_ONCE
        )

    def charge(self, session: Session, now: float) -> None:
        """Charge a line to the first seat of a participant, or to the spectators.

        Raises:
            ProtocolError: `rate/chat` after too many lines.
        """
        player = session.player
        budget = self._spectators if player is None else self._seats[player]
        if not budget.take(now):
            who = "the spectators have" if player is None else "you have"
            raise ProtocolError(
                "rate/chat", f"{who} written too much at once; wait a second", "text"
            )
