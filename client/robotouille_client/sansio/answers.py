"""Errors and requests that follow from a server's answers, as functions of values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.join_codes import plain_code
from robotouille_client.errors import ConnectionFailedError, RetryLaterError
from robotouille_client.sansio.client_state import Request, seat_fields
from robotouille_client.sansio.game_replica import GameReplica


def refused_hello(answer: messages.ServerMessage, url: str) -> RobotouilleError:
    """Return the error for an answer to `hello` that does not welcome the client."""
    match answer:
        case messages.Error(code=ErrorCode.SERVER_HANDOVER):
            return RetryLaterError(answer.message)
        case messages.Bye(retry=True):
            return RetryLaterError(answer.reason)
        case messages.Error():
            message = answer.message
            if answer.code == ErrorCode.PROTOCOL_VERSION:
                message = f"{url} has an incompatible version ({message}); update this program"
            return ProtocolError(answer.code, message, answer.field)
        case messages.Bye():
            return ProtocolError(answer.code, answer.reason)
        case _:
            return RetryLaterError(f"unexpected answer {type(answer).__name__} to hello")


def all_failures(failures: Sequence[ConnectionFailedError]) -> ConnectionFailedError:
    """Return one error for the failed attempts at all addresses of a server."""
    if len(failures) == 1:
        return failures[0]
    # One node that will be ready soon is enough to try again.
    later = any(isinstance(each, RetryLaterError) for each in failures)
    kind = RetryLaterError if later else ConnectionFailedError
    return kind("; ".join(dict.fromkeys(map(str, failures))))


def implied_join(game: GameReplica | None) -> messages.Join | None:
    """Return the join that matches an episode entered through a resume token alone."""
    if game is None or game.ended:
        return None
    role: Literal["player", "spectator"] = "player" if game.seat else "spectator"
    view: messages.View = "text"
    if game.has_state:
        view = "state" if game.observation is None else "both"
    return messages.Join(
        episode=game.episode,
        role=role,
        view=view,
        partial=game.hidden is not None,
        **seat_fields(game.own_seats),
    )


def answer_behind(
    request: Request, error: messages.Error, joined: messages.Joined | None, left: str
) -> messages.ServerMessage:
    """Return the lost answer if an error only says that the request was done before.

    Args:
        joined: The last answer to a join.
        left: The id of the last episode.
    """
    # The answer was lost with the previous connection, and the request was sent again.
    if isinstance(request, messages.Leave) and error.code == ErrorCode.EPISODE_NONE:
        return messages.Left(ref=error.ref, episode=left)
    if isinstance(request, messages.Join) and error.code == ErrorCode.EPISODE_JOINED and joined:
        asked = plain_code(request.episode)
        if asked in (joined.episode.upper(), plain_code(joined.code)):
            return joined
    return error
