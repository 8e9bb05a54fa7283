"""Errors of NATS, in the words of an operator."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from math import inf

from nats.errors import Error as NatsError
from nats.errors import NoRespondersError
from nats.js.errors import APIError, KeyWrongLastSequenceError

from robotouille.errors import RobotouilleError
from robotouille_server.cluster.bus import ConflictError, NoAnswererError, UnavailableError

IN_USE = 10058
NO_MESSAGE = 10037
WRONG_SEQUENCE = (10071, 10164)
"""NATS's error codes for an unexpected last sequence number."""
NO_ACCOUNT = 10039
FULL = (10002, 10023, 10028, 10047, 10077)
"""NATS's error codes for limits of an account, a server or a stream."""
FULL_SECONDS = 10.0
"""Seconds after a refusal because of a limit in which it explains all other failures. Servers that
are full give up the lead of their streams, and then answer only that a leader is missing."""


class NatsErrors:
    """Reasons for the failures of one connection to NATS.

    Args:
        now: Returns the time in seconds.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._full, self._full_at = "", -inf

    def unavailable(self, text: str) -> UnavailableError:
        """Return the error for a failure without an error code."""
        full = self._now() - self._full_at < FULL_SECONDS
        return UnavailableError(self._full if full else text)

    def refused(self, code: int | None, description: str | None) -> UnavailableError:
        """Return the error for a request that JetStream has refused.

        Args:
            code: The error code of NATS (`err_code`).
            description: NATS's own words.
        """
        if code in FULL:
            self._full_at = self._now()
            self._full = (
                f"JetStream is full ({description}); raise max_file_store of the NATS servers, or "
                "delete old recordings"
            )
            return UnavailableError(self._full)
        if code == NO_ACCOUNT:
            text = "the account of this user has no JetStream; add `jetstream: enabled` to it"
            return UnavailableError(text)
        return self.unavailable(f"NATS: {description or f'error {code}'}")

    def of(self, error: Exception) -> UnavailableError:
        """Return the error for one of the library or the network."""
        if isinstance(error, APIError) and (error.err_code or error.description):
            return self.refused(error.err_code, error.description)
        text = (str(error) or type(error).__name__).removeprefix("nats: ")
        return self.unavailable(f"NATS: {text}")

    @asynccontextmanager
    async def translated(self) -> AsyncIterator[None]:
        """Turn errors of the library into `BusError`."""
        try:
            yield
        except KeyWrongLastSequenceError as error:
            raise ConflictError(str(error)) from None
        except NoRespondersError:
            raise NoAnswererError("NATS has no JetStream, or no node answers") from None
        except (NatsError, OSError, TimeoutError) as error:
            raise self.of(error) from None

    @asynccontextmanager
    async def explained(self, replicas: int) -> AsyncIterator[None]:
        """Turn errors of the library while streams are created into errors for the operator."""
        try:
            yield
        except (NatsError, OSError, TimeoutError) as error:
            text = str(self.of(error))
            if text.startswith("NATS: "):
                text = (
                    f"JetStream is not ready ({text}); with several NATS servers it needs "
                    f"{replicas} of them and a leader"
                )
            raise RobotouilleError(f"--cluster: {text}") from None
