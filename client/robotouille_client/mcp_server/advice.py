"""What went wrong, and what to do next: errors as a model reads them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mcp.server.mcpserver.exceptions import ToolError

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.program import quoted
from robotouille.protocol.error_codes import ErrorCode
from robotouille_client.console import explain
from robotouille_client.errors import ConnectionFailedError, NotYetError

__all__ = ["explained"]

ASK_FOR_ROLE = "Ask whoever runs the server for a role token, and give it to this MCP server."
ADVICE = {
    ErrorCode.AUTH_REQUIRED: ASK_FOR_ROLE,
    ErrorCode.AUTH_INVALID: ASK_FOR_ROLE,
    ErrorCode.AUTH_EXPIRED: ASK_FOR_ROLE,
    ErrorCode.AUTH_REVOKED: ASK_FOR_ROLE,
    ErrorCode.AUTH_USED: ASK_FOR_ROLE,
    ErrorCode.AUTH_ROLE: "Your role may not do this; ask the user for an episode's code and join.",
    ErrorCode.AUTH_EPISODE: "Your token is for another episode; join that one.",
    ErrorCode.AUTH_SEAT: "Your token is for another seat; join without naming a seat.",
    ErrorCode.EPISODE_UNKNOWN: "Check the code; list_episodes shows those that there are.",
    ErrorCode.EPISODE_FULL: "Join another episode, or join as spectator.",
    ErrorCode.EPISODE_OVER: "Join another episode, or create one.",
    ErrorCode.EPISODE_BANNED: "You were sent out of it; join another episode.",
    ErrorCode.SEAT_TAKEN: "Join without naming a seat, or name a free one.",
    ErrorCode.SEAT_UNKNOWN: "list_episodes names the seats; or join without naming one.",
    ErrorCode.SEAT_NONE: "Spectators only watch; leave, and join as player.",
    ErrorCode.SEAT_MUTED: "The operator has muted you; go on playing.",
    ErrorCode.TASK_UNKNOWN: "The resource robotouille://tasks lists the tasks.",
    ErrorCode.RATE_CODES: "Too many wrong codes; wait a moment before the next.",
    ErrorCode.RATE_CONNECTIONS: "Leave games that you do not need, and try again in a moment.",
    ErrorCode.RATE_EPISODES: "Join an episode that waits instead of creating another.",
    ErrorCode.SERVER_FULL: "Join an episode that waits, or try again later.",
    ErrorCode.SERVER_DRAINING: "The server is about to restart; try again in a minute.",
}


@contextmanager
def explained() -> Iterator[None]:
    """Errors of the game server and of arguments become results that say what to do next."""
    try:
        yield
    except ProtocolError as error:
        next_step = ADVICE.get(ErrorCode(error.code)) if error.code in set(ErrorCode) else None
        words = f"{error.code}: the game server says {quoted(error.message)}"
        raise ToolError(f"{words}. {next_step or 'Change the arguments, or observe.'}") from None
    except NotYetError:
        raise ToolError("The game server is busy; try again in a few seconds.") from None
    except ConnectionFailedError as error:
        raise ToolError(
            f"{quoted(str(error))}. Try again in a moment; if that does not help, tell the user "
            "that the game server is not running or its address is wrong."
        ) from None
    except RobotouilleError as error:
        raise ToolError(str(error)) from None
    except ValueError as error:
        raise ToolError(quoted(explain(error))) from None
