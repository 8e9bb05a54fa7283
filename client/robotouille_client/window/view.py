"""Everything the window shows of one moment, and the protocol of the games that provide it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.signals import Signal
from robotouille.world.world import State, World

NEWS = "·"
"""Speaker of the chat lines that report game events, such as a player who joins."""
GLIDE_SECONDS = 0.3
"""Duration of a step's animation in games whose clock has no fixed step time."""


@dataclass(frozen=True, slots=True)
class SeatView:
    """One seat: its participant, connection and action counts.

    Attributes:
        kind: Kind of the participant, such as `human` or `bot`.
        substitute: Kind of the bot that plays while the participant is away; empty if none does.
        latency_ms: Round-trip time to the participant; 0 if unknown.
    """

    player: str
    name: str
    kind: str = "human"
    connected: bool = True
    actions: int = 0
    rejected: int = 0
    substitute: str = ""
    latency_ms: int = 0

    @property
    def plate(self) -> str:
        """Name shown over the player, with a note if the participant is away."""
        if self.substitute:
            return f"{self.substitute} for {self.name}" if self.name else self.substitute
        if self.name and not self.connected:
            return f"{self.name} · away"
        return self.name or self.player

    @property
    def moved_by(self) -> str:
        """Short description of who controls the player."""
        if self.substitute:
            whom = f"for {self.name}" if self.name else "a free seat"
            return f"{self.substitute} plays {whom}"
        if self.connected:
            return "person" if self.kind == "human" else self.kind
        return "connection lost" if self.name else "free"


@dataclass(frozen=True, slots=True)
class PauseView:
    """Reason for a pause, and its countdown.

    Attributes:
        left: Seconds until the pause ends by itself; None if it has no time limit.
        share: Part of the whole wait that is left, from 1 to 0.
    """

    why: str
    detail: str = ""
    left: float | None = None
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class LobbyRow:
    """One seat in the list of a game that has not started."""

    name: str
    state: Literal["ready", "here", "away", "free"]


@dataclass(frozen=True, slots=True)
class LobbyView:
    """Seats and code of a game that has not started.

    Attributes:
        ready: True if the local player is ready; None for a spectator.
        code: Code with which others join.
    """

    rows: tuple[LobbyRow, ...]
    ready: bool | None = None
    code: str = ""


@dataclass(frozen=True, slots=True)
class FarewellView:
    """Reason why the local player was removed from the game."""

    title: str
    text: str


@dataclass(frozen=True, slots=True)
class Bubble:
    """Text over a player: a chat message, or the reason for a rejected action.

    Attributes:
        things: Objects that the message is about. Their pictures stand for words.
        target: Object that a signal points at. It is marked in the kitchen.
    """

    player: str
    text: str
    kind: Literal["rejected", "chat"] = "rejected"
    things: tuple[str, ...] = ()
    target: str = ""

    @classmethod
    def rejection(cls, player: str, why: str) -> Bubble:
        """Return a bubble that shows why an action was rejected."""
        return cls(player, f"{capitalised(why or 'you cannot do that now')}.")


@dataclass(frozen=True, slots=True)
class View:
    """One moment of a game, as the local player sees it.

    Attributes:
        previous: State before `state`, from which movements are animated.
        phase: Part of the current step's time that has passed, from 0 to 1.
        step_seconds: Duration of a step; None if the clock has no fixed one.
        me: Player controlled by the local participant; None for a spectator.
        companion: Player controlled by a second person at the same window.
        hover: Object under the mouse.
        waits_for: Players whose decision the current step has been waiting for.
        thinking: Bots that have been deciding for a while, whether or not a step waits for them.
        watching: Number of spectators.
        spectator_names: Names of the first few spectators.
        blocked: (player, station, occupant) for each player who waits for a station, or
            (player, "", teammate) for each player who waits for a teammate.
        outcome: How the game ended, in words; empty while it runs.
        notice: Announcement shown for a few seconds.
        lesson: Current task of the tutorial.
        starts_in: Seconds of the countdown to the start; None without a countdown.
        offline: Seconds since the connection was lost; None while connected.
        farewell: Why the local player was removed from the game.
        seconds: Time of a clock, for movements between steps; None for still pictures.
        since_end: Seconds since the end of the game; None while it runs, or if unknown.
    """

    world: World
    state: State
    previous: State | None = None
    step: int = 0
    max_steps: int | None = None
    clock: str = ""
    phase: float = 1.0
    seats: tuple[SeatView, ...] = ()
    me: str | None = None
    bubbles: tuple[Bubble, ...] = ()
    chat: tuple[tuple[str, str], ...] = ()
    status: str = ""
    code: str = ""
    outcome: str = ""
    won: bool = False
    lost: bool = False
    hover: str | None = None
    notice: str = ""
    lesson: str = ""
    pause: PauseView | None = None
    offline: float | None = None
    farewell: FarewellView | None = None
    waits_for: tuple[str, ...] = ()
    lobby: LobbyView | None = None
    thinking: tuple[str, ...] = ()
    starts_in: float | None = None
    watching: int = 0
    spectator_names: tuple[str, ...] = ()
    blocked: tuple[tuple[str, str, str], ...] = ()
    step_seconds: float | None = None
    seconds: float | None = None
    since_end: float | None = None
    companion: str | None = None

    @property
    def over(self) -> bool:
        """True if the game has ended for the local player, or they were removed from it."""
        return self.me is not None and (bool(self.outcome) or self.farewell is not None)

    @property
    def asks_if_ready(self) -> bool:
        """True if the game asks the local player to get ready."""
        return self.lobby is not None and self.lobby.ready is not None and not self.frozen

    @property
    def frozen(self) -> bool:
        """True if the game accepts no actions now."""
        interrupted = any(x is not None for x in (self.pause, self.offline, self.farewell))
        return interrupted or self.over


class GameSource(Protocol):
    """Game shown in a window: on a server, in this process, or a replay.

    Sources in which nobody plays, such as replays, inherit `act`, `say`, `signal` and
    `be_ready`, which do nothing.
    """

    def view(self) -> View:
        """Return the moment to draw now."""
        raise NotImplementedError

    def act(self, action: GroundAction) -> None:
        """Submit an action for its player, who must be at this window."""
        return

    def say(self, text: str) -> None:
        """Send a chat message."""
        return

    def signal(self, signal: Signal) -> None:
        """Send a signal."""
        return

    def be_ready(self, ready: bool) -> None:
        """Declare the local player ready for the start, or no longer ready."""
        return

    @property
    def finished(self) -> bool:
        """True if the view will not change any more."""
        raise NotImplementedError
