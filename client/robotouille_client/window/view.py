"""What the window shows, as a value, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.templates import capitalised
from robotouille.world.world import State, World

__all__ = [
    "GLIDE_SECONDS",
    "NEWS",
    "Bubble",
    "FarewellView",
    "LobbyRow",
    "LobbySource",
    "LobbyView",
    "PauseView",
    "SeatView",
    "Source",
    "View",
]

NEWS = "·"
"""Whose line of the chat it is that tells who comes and goes."""
GLIDE_SECONDS = 0.3
"""For how long a step is seen where no clock says how long it takes."""


@dataclass(frozen=True, slots=True)
class SeatView:
    """A seat of the episode: who plays it (`kind`: human, bot, …) and how that goes.

    `stand_in` is the bot that plays it while its participant is away; empty if none does.
    `latency_ms` is how long a message takes to the participant and back, as far as that is known.
    """

    player: str
    name: str
    kind: str = "human"
    connected: bool = True
    actions: int = 0
    rejected: int = 0
    stand_in: str = ""
    latency_ms: int = 0

    @property
    def plate(self) -> str:
        """The name over the player, and whether it is there."""
        if self.stand_in:
            return f"{self.stand_in} for {self.name}" if self.name else self.stand_in
        if self.name and not self.connected:
            return f"{self.name} · away"
        return self.name or self.player

    @property
    def moved_by(self) -> str:
        """Who moves the player, in a few words."""
        if self.stand_in:
            whom = f"for {self.name}" if self.name else "a free seat"
            return f"{self.stand_in} plays {whom}"
        if self.connected:
            return self.kind
        return "connection lost" if self.name else "free"


@dataclass(frozen=True, slots=True)
class PauseView:
    """Why the game stands still and what it waits for; `left` are the seconds until that ends by
    itself (None: nobody knows), `share` what they are of the whole wait."""

    why: str
    detail: str = ""
    left: float | None = None
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class LobbyRow:
    """A seat before the beginning: who has it, and whether they are ready."""

    name: str
    state: Literal["ready", "here", "away", "free"]


@dataclass(frozen=True, slots=True)
class LobbyView:
    """What a game that has not begun waits for. `ready` says whether its owner is, None where
    nobody waits for that; `code` is what others join with."""

    rows: tuple[LobbyRow, ...]
    ready: bool | None = None
    code: str = ""


@dataclass(frozen=True, slots=True)
class FarewellView:
    """Why the window's owner is out of the game, in a title and a sentence."""

    title: str
    text: str


@dataclass(frozen=True, slots=True)
class Bubble:
    """Words over a player: something said, or why its action was rejected."""

    player: str
    text: str
    kind: Literal["rejected", "chat"] = "rejected"

    @classmethod
    def rejection(cls, player: str, why: str) -> Bubble:
        """Why not, or what to do in its place."""
        return cls(player, f"{capitalised(why or 'this cannot be done now')}.")


@dataclass(frozen=True, slots=True)
class View:
    """One moment of an episode.

    `phase` is how much of the current step's period has passed, from 0 to 1; `previous` is the
    state before `state`, from which players are seen walking. `me` is the player that the window's
    owner plays, None for a spectator; `hover` is the object under the mouse. `waits_for` are the
    players whose decision a step has waited for, for a while, and `thinking` the bots that have not
    decided for as long, whether anything waits or not; `watching` counts spectators, of
    whom the first few are called `spectator_names`, and `blocked` tells who waits for which
    station, and who stands there, or, without a station, who waits for whom. `step_seconds` is how
    long a step takes where a clock says so.

    A game that is over has an `outcome` in words, and was `won` or `lost`. `notice` is something
    the operator says to everybody, for a while; `lesson` is what is to be learned next. A game that
    has not begun has a `lobby`; one that begins in `starts_in` seconds is counted down to, and one
    that stands still has a `pause`; `offline` are the seconds since the connection was lost, None
    while there is one; with a `farewell` the owner is out of the game.
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

    @property
    def over(self) -> bool:
        """Whether the owner plays no more: the game is at its end, or they are out of it."""
        return self.me is not None and (bool(self.outcome) or self.farewell is not None)

    @property
    def asks_if_ready(self) -> bool:
        """Whether the game waits for its owner to be ready."""
        return self.lobby is not None and self.lobby.ready is not None and not self.frozen

    @property
    def frozen(self) -> bool:
        """Whether nothing that the owner does would come to anything now."""
        interrupted = any(x is not None for x in (self.pause, self.offline, self.farewell))
        return interrupted or self.over


class Source(Protocol):
    """Where a window's episode comes from: a server, or a game in the same process."""

    def view(self) -> View:
        """The moment to draw now."""

    def act(self, action: GroundAction) -> None:
        """The window's owner wants to act."""

    def say(self, text: str) -> None:
        """The window's owner says something to the others."""

    @property
    def finished(self) -> bool:
        """Whether nothing will change any more."""


@runtime_checkable
class LobbySource(Protocol):
    """A source of games that wait until the window's owner is ready."""

    def be_ready(self, ready: bool) -> None:
        """The owner is ready for the beginning, or is not any more."""
