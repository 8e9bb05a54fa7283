"""The caller of the operator API, what it may do, and why its requests are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus

from robotouille.errors import RobotouilleError
from robotouille_server.auth import RoleGrant, same_episode
from robotouille_server.runtime.logs import AuditLog

CODES = {
    "host/unknown": "the `Host` header is not an allowed name; see the setting `operator_names`",
    "auth/needed": "the token is missing: `Authorization: Bearer …`",
    "auth/forwarded": "the request came through a proxy, but tokens are not checked",
    "auth/episode": "the token is for another episode",
    "request/origin": "the request came from a page of another web site",
    "request/header": "a POST request lacks the header `X-Robotouille-Operator`",
    "request/type": "the body is not `application/json`",
    "request/size": "the body is larger than 16 KiB, or has no length",
    "request/invalid": "a parameter or field is invalid; the message names it",
    "request/unknown": "the path does not exist",
    "request/method": "the path does not support this method",
    "episode/unknown": "no episode has this id or code",
    "episode/ended": "the episode has already ended",
    "episode/handover": "in a cluster, the episode is moving to another node; try again",
    "session/unknown": "the session is not in the episode",
    "recording/unknown": "no recording has this name",
    "recording/unreadable": "the recordings folder or a file in it cannot be read",
    "recording/unshown": "the recording is too large or takes too long to show as a page, or has "
    "no state; the message names the reason",
    "node/keys": "the episode's node signs tokens with other keys, so it refuses yours",
    "node/unavailable": "the episode's node does not answer, or has no operator page",
    "node/size": "the answer is too large to be forwarded; the message names the episode's node",
    "operator/busy": "too many pages are open, or too many requests for recordings or nodes wait",
    "operator/rate": "too many requests with this token, or too many without a token",
    "operator/internal": "internal error; see the server's log",
}
"""Error codes of the operator API and their meanings, without the codes of invalid tokens."""


class RequestRefusedError(RobotouilleError):
    """A request is refused.

    Attributes:
        code: One of CODES, or the code of an invalid token.
        retry_seconds: Seconds after which the request may succeed; None if that is unknown.
        field: The invalid field of the request, or empty.
    """

    def __init__(
        self,
        status: HTTPStatus,
        code: str,
        message: str,
        retry_seconds: int | None = None,
        field: str = "",
    ) -> None:
        self.status = status
        self.code = code
        self.message = message
        self.retry_seconds = retry_seconds
        self.field = field
        super().__init__(f"{code}: {message}")


LOCAL = "local"
"""Name of callers without a token in the audit log."""


def _nothing_to_check() -> None:
    pass


@dataclass(frozen=True, slots=True)
class Principal:
    """Caller of the operator API.

    Attributes:
        grant: Grant of the caller's token; None for a local program without a token.
        check_token: Raises RequestRefusedError if the token has expired or was revoked.
        via: Address of the node that has forwarded the request; empty if none has.
    """

    grant: RoleGrant | None = None
    check_token: Callable[[], object] = field(default=_nothing_to_check, repr=False)
    via: str = ""

    @property
    def name(self) -> str:
        """Name in the audit log."""
        return LOCAL if self.grant is None else self.grant.subject

    @property
    def token_subject(self) -> str | None:
        """Subject of the token; None without a token."""
        return None if self.grant is None else self.grant.subject

    @property
    def token_id(self) -> str:
        """Id of the token; empty if there is no token or the token has no id."""
        return "" if self.grant is None else self.grant.token_id

    @property
    def only_episode(self) -> str:
        """Id or code of the only episode that the token allows; empty for all episodes."""
        return "" if self.grant is None else self.grant.episode

    def may_see(self, *names: str) -> bool:
        """Return whether the token allows an episode with these names (id and code)."""
        return not self.only_episode or any(same_episode(self.only_episode, n) for n in names)

    def require_episode(self, *names: str) -> None:
        """Raise RequestRefusedError unless `may_see` is true."""
        if not self.may_see(*names):
            message = f"your token is valid only for the episode {self.only_episode}"
            raise RequestRefusedError(HTTPStatus.FORBIDDEN, "auth/episode", message)


def note(
    audit: AuditLog,
    principal: Principal,
    what: str,
    episode: str = "",
    result: str = "done",
    **details: str,
) -> None:
    """Note an action of a principal in the audit log."""
    if principal.via:
        details["via"] = principal.via
    audit.note(
        what,
        by=principal.name,
        token=principal.token_id,
        episode=episode,
        result=result,
        details=details,
    )
