"""Who has come to the operator's port with a token, good or bad, for the audit log."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from robotouille_server.auth import RoleGrant
from robotouille_server.runtime.audit_log import AuditLog, Details
from robotouille_server.runtime.token_bucket import TokenBucket

__all__ = ["REFUSED_A_MINUTE", "LoginAudit"]

REFUSED_A_MINUTE = 20
"""Lines about refused tokens; what is beyond them is counted in the next line."""
REMEMBERED = 256
FORGOTTEN_AFTER = 1800.0
"""Seconds after which a token that was not used is a new login."""


class LoginAudit:
    """Writes one line for a token that is used, and not too many for tokens that are refused.

    `now` is the loop's time. Addresses are written only where `addresses` says so.
    """

    def __init__(self, audit: AuditLog, now: Callable[[], float], *, addresses: bool) -> None:
        self._audit = audit
        self._now = now
        self._addresses = addresses
        self._seen: OrderedDict[RoleGrant, float] = OrderedDict()
        self._lines = TokenBucket(REFUSED_A_MINUTE / 60, now(), REFUSED_A_MINUTE)
        self._left_out = 0

    def good(self, grant: RoleGrant, address: str) -> None:
        """A request came with a good token."""
        now = self._now()
        used = self._seen.pop(grant, None)
        self._seen[grant] = now
        if len(self._seen) > REMEMBERED:
            self._seen.popitem(last=False)
        if used is None or now - used > FORGOTTEN_AFTER:
            self._audit.note(
                "login",
                by=grant.subject,
                token=grant.token_id,
                episode=grant.episode,
                details=self._shown(address),
            )

    def refused(self, code: str, address: str) -> None:
        """A request came with a token that is not good; whose it is nobody knows."""
        if not self._lines.take(self._now()):
            self._left_out += 1
            return
        details = {**self._shown(address), **self._missing()}
        self._audit.note("login", by="", result=code, details=details)

    def tick(self) -> None:
        """To be called now and then: lines that were left out are counted, when there is room."""
        if self._left_out and self._lines.take(self._now()):
            self.finish()

    def finish(self) -> None:
        """Count what was left out, as nothing more comes."""
        if self._left_out:
            self._audit.note("login", by="", result="refused", details=self._missing())

    def _missing(self) -> Details:
        left_out, self._left_out = self._left_out, 0
        return {"left_out": left_out} if left_out else {}

    def _shown(self, address: str) -> Details:
        return {"address": address} if self._addresses and address else {}
