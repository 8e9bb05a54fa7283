"""What conversations need of the server around them, and what it says when it stops."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from robotouille_server.auth import (
    CodeGuessLimiter,
    ConnectionLimiter,
    Role,
    Tokens,
    UsedTokens,
)
from robotouille_server.rooms.lobby import Lobby
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.sessions import Sessions
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.transport import LoopBudget, Peer

__all__ = ["Services", "ShutdownNotice"]

DAY_SECONDS = 86_400.0


@dataclass(frozen=True, slots=True)
class ShutdownNotice:
    """What a server that stops sends to everybody."""

    reason: str
    hand_over: bool

    def send(self, peer: Peer) -> None:
        """Close a connection: for good, or until the next process is there."""
        if self.hand_over:
            peer.close("server/restart", self.reason, retry=True, status=1012)
        else:
            peer.close("server/stopped", self.reason, status=1001)


@dataclass(frozen=True, slots=True)
class Services:
    """What all connections of a server use. `shutdown_notice` is None while the server goes on."""

    settings: ServerSettings
    metrics: Metrics
    lobby: Lobby
    sessions: Sessions
    tokens: Tokens
    used_tokens: UsedTokens
    connection_limiter: ConnectionLimiter
    code_guesses: CodeGuessLimiter
    loop_budget: LoopBudget
    shutdown_notice: Callable[[], ShutdownNotice | None]

    def seat_tokens(
        self, room: Room, participants: Mapping[str, str], owner: str
    ) -> dict[str, str]:
        """A token for each seat of an episode, good for a day after it may have begun.

        Args:
            participants: Who is to have it, by player, in the owner's words.
            owner: Who has opened the episode.
        """
        seconds = (room.episode.rules.open_for or 0.0) + DAY_SECONDS
        return {
            player: self.tokens.mint_role(
                Role.PLAYER,
                _pseudonym(owner, participants[player])
                if player in participants
                else f"{room.id}-{number}",
                seconds=seconds,
                episode=room.id,
                seat=player,
            )
            for number, player in enumerate(room.world.players, 1)
        }


def _pseudonym(owner: str, participant: str) -> str:
    """Under which somebody is recorded in all episodes of an owner; another one's are others."""
    digest = hashlib.sha256(f"{owner}\0{participant}".encode()).hexdigest()
    return f"participant-{digest[:16]}"
