"""Limits on commands. Refused commands do not count towards the limit of accepted ones."""

from __future__ import annotations

import re
from collections.abc import Callable

from robotouille.errors import ProtocolError
from robotouille_server.auth import Role, Tokens
from robotouille_server.runtime.budgets import TokenBucket

COMMANDS_A_SECOND, COMMANDS_BURST = 10.0, 50.0
"""Limit of accepted commands, and of commands that are refused with the reason."""
BRIEF_A_SECOND, BRIEF_BURST = 100.0, 50.0
"""Limit of further refusals, whose reason is only `rate/limited`. Refused commands beyond it get no
reply: replies to a flood would fill the queue of messages, and accepted commands would wait."""
LARGE_BYTES = 8 * 1024
"""Size above which a command without a valid token is read only while refusals are within their
limit. Reading 64 KiB takes up to 25 ms, checking a token 0.2 ms."""

_TOKEN = re.compile(rb'"token"\s*:\s*"([^"\\]{1,2000})"')


class CommandLimits:
    """Limits on accepted commands, and separate limits on refused ones.

    Args:
        tokens: The tokens of the server.
        now: Returns the event loop's time.
    """

    def __init__(self, tokens: Tokens, now: Callable[[], float]) -> None:
        self._tokens = tokens
        self._now = now
        self._accepted = TokenBucket(COMMANDS_A_SECOND, now(), COMMANDS_BURST)
        self._refused = TokenBucket(COMMANDS_A_SECOND, now(), COMMANDS_BURST)
        self._brief = TokenBucket(BRIEF_A_SECOND, now(), BRIEF_BURST)

    def check_size(self, payload: bytes) -> None:
        """Check that a payload may be read.

        Raises:
            ProtocolError: `rate/limited`: the payload is large and has no valid token, and too many
                commands were refused.
        """
        size = len(payload)
        if size <= LARGE_BYTES or self._refused.left(self._now()) >= _cost(size):
            return
        if not has_host_token(self._tokens, payload):
            raise _too_many("refused commands")

    def accept(self, cost: float) -> None:
        """Count a command that its token permits.

        Raises:
            ProtocolError: `rate/limited`.
        """
        if not self._accepted.take(self._now()):
            raise _too_many("commands")
        self._accepted.owe(self._now(), cost - 1)

    def refuse(self, size: int, reason: ProtocolError) -> ProtocolError | None:
        """Count a refused command of `size` bytes.

        Returns:
            The error to send: `reason`, `rate/limited`, or None to send no reply.
        """
        if self._refused.take(self._now(), _cost(size)):
            return reason
        if self._brief.take(self._now()):
            return _too_many("refused commands")
        return None


def has_host_token(tokens: Tokens, payload: bytes) -> bool:
    """Return whether the first text that looks like a token is one of a host or operator."""
    # Reading the whole command would cost what this check saves.
    found = _TOKEN.search(payload)
    try:
        token = found[1].decode() if found else ""
        return tokens.check_role(token).role.includes(Role.HOST)
    except (ProtocolError, UnicodeDecodeError):
        return False


def _too_many(what: str) -> ProtocolError:
    return ProtocolError("rate/limited", f"more than {COMMANDS_A_SECOND:g} {what} per second")


def _cost(size: int) -> float:
    return 1 + min(size, 8 * LARGE_BYTES) // LARGE_BYTES
