"""Access checks in front of every request to the operator port, and headers of every response.

A browser on the operator's machine also runs pages of other web sites. Three rules keep these
pages out:

- A request with a foreign `Host` is refused, which stops DNS rebinding.
- A request that changes something needs a JSON body and a custom header. A foreign page can send
  them only after the browser has asked for permission, which the port refuses.
- No response may be framed or read by other sites.
"""

from __future__ import annotations

import ipaddress
import json
import re
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING

from robotouille.errors import ProtocolError
from robotouille_server.auth import PROXY_HEADERS, RoleGrant
from robotouille_server.operator.load import RequestRates, Turns
from robotouille_server.operator.principal import Principal, RequestRefusedError
from robotouille_server.runtime.budgets import TokenBucket
from robotouille_server.runtime.logs import AuditLog, Details

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from robotouille_server.operator.connections import ConnectionSlot

REFUSED_A_MINUTE = 20
"""Audit log lines about refused tokens. The next line counts the tokens beyond this number."""
REMEMBERED = 256
FORGOTTEN_AFTER = 1800.0
"""Seconds without use after which a token counts as a new login."""


class LoginAudit:
    """Audit log of logins: one line per token in use, and a limited number for refused tokens.

    The limit keeps someone who guesses tokens from filling the disk. `now` returns the loop's
    time. Lines contain addresses only if `addresses` is true.
    """

    def __init__(self, audit: AuditLog, now: Callable[[], float], *, addresses: bool) -> None:
        self._audit = audit
        self._now = now
        self._addresses = addresses
        self._seen: OrderedDict[RoleGrant, float] = OrderedDict()
        self._lines = TokenBucket(REFUSED_A_MINUTE / 60, now(), REFUSED_A_MINUTE)
        self._left_out = 0

    def accepted(self, grant: RoleGrant, address: str) -> None:
        """Note a request with a valid token."""
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
                details=self._address(address),
            )

    def refused(self, code: str, address: str) -> None:
        """Note a request with an invalid token. Its subject is unknown."""
        if not self._lines.take(self._now()):
            self._left_out += 1
            return
        details = {**self._address(address), **self._count_left_out()}
        self._audit.note("login", by="", result=code, details=details)

    def tick(self) -> None:
        """Write the number of omitted lines once the limit allows it. Call this regularly."""
        if self._left_out and self._lines.take(self._now()):
            self.finish()

    def finish(self) -> None:
        """Write the number of omitted lines now."""
        if self._left_out:
            self._audit.note("login", by="", result="refused", details=self._count_left_out())

    def _count_left_out(self) -> Details:
        left_out, self._left_out = self._left_out, 0
        return {"left_out": left_out} if left_out else {}

    def _address(self, address: str) -> Details:
        return {"address": address} if self._addresses and address else {}


HEADER = "x-robotouille-operator"
MAX_BODY = 16 * 1024
_HOST = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([^:@/\[\]]*))(?::\d{1,5})?")
SAFE = frozenset({"GET", "HEAD"})
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
RESPONSE_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}


def is_loopback(host: str) -> bool:
    """Return whether a name or address reaches this machine only."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


Headers = dict[str, list[str]]


@dataclass(frozen=True)
class Access:
    """Rules of access to the operator port.

    Attributes:
        authorize: Returns what an operator's token grants; raises ProtocolError for other tokens.
        always: If true, requests from this machine need a token too.
        hosts: Names allowed in `Host`, besides those of this machine.
        public: Paths that need no token, because they show nothing about the server.
    """

    authorize: Callable[[str], RoleGrant] | None = None
    always: bool = False
    hosts: frozenset[str] = frozenset()
    public: frozenset[str] = frozenset()

    def check(self, scope: Scope) -> Principal:
        """Return who makes a request.

        Raises:
            RequestRefusedError: The request is not allowed.
        """
        headers = _headers(scope)
        self._check_host(scope, headers.get("host", []))
        if scope["path"] not in self.public:
            _check_site(headers)
        _check_length(headers)
        if scope["method"] not in SAFE:
            _check_change(headers)
        if scope["path"] in self.public:
            return Principal()
        return self._principal(headers)

    def _check_host(self, scope: Scope, hosts: list[str]) -> None:
        own = (scope.get("server") or ("", 0))[0]
        names = [_host_name(host) for host in hosts]
        if len(names) == 1 and (is_loopback(names[0]) or names[0] == own or names[0] in self.hosts):
            return
        given = f"the host {', '.join(hosts)} is not allowed" if any(hosts) else "no Host header"
        message = f"{given}; add its name to the setting operator_names"
        raise RequestRefusedError(HTTPStatus.MISDIRECTED_REQUEST, "host/unknown", message)

    def _principal(self, headers: Headers) -> Principal:
        # A proxy on this machine makes everyone look local, so its requests need a token.
        forwarded = any(name.lower() in headers for name in PROXY_HEADERS)
        needed = self.always or forwarded
        if self.authorize is None:
            if not needed:
                return Principal()
            message = "requests through a proxy need a token, but this server does not check tokens"
            raise RequestRefusedError(HTTPStatus.FORBIDDEN, "auth/forwarded", message)
        # An optional token is checked too: it can restrict its owner to one episode.
        if not needed and "authorization" not in headers:
            return Principal()
        scheme, _, token = " ".join(headers.get("authorization", [])).partition(" ")
        if scheme.lower() != "bearer" or not token.strip():
            message = "send an operator token: Authorization: Bearer TOKEN"
            raise RequestRefusedError(HTTPStatus.UNAUTHORIZED, "auth/needed", message)
        check = partial(_grant, self.authorize, token.strip())
        return Principal(check(), check)


def _grant(authorize: Callable[[str], RoleGrant], token: str) -> RoleGrant:
    try:
        return authorize(token)
    except ProtocolError as error:
        raise RequestRefusedError(HTTPStatus.UNAUTHORIZED, error.code, error.message) from None


def _check_length(headers: Headers) -> None:
    """Refuse bodies that are too large. `BoundedRequests` has refused those in chunks."""
    length = "".join(headers.get("content-length", ["0"]))
    if not length.isdecimal() or int(length) > MAX_BODY:
        raise _too_large()


def _too_large() -> RequestRefusedError:
    message = f"send a body of at most {MAX_BODY} bytes with Content-Length, not in chunks"
    return RequestRefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "request/size", message)


def _check_site(headers: Headers) -> None:
    """Refuse what a page of another site requests, such as `<img src="http://localhost:8766/…">`.

    The page learns nothing from the answer, but many requests would use up the operator's rate.
    """
    if any(site in ("cross-site", "same-site") for site in headers.get("sec-fetch-site", [])):
        message = "pages of other sites may not request anything here"
        raise RequestRefusedError(HTTPStatus.FORBIDDEN, "request/origin", message)


def _check_change(headers: Headers) -> None:
    """Refuse a change that a page of another site could have sent."""
    origin = headers.get("origin")
    host = "".join(headers["host"])
    if origin is not None and origin not in ([f"http://{host}"], [f"https://{host}"]):
        message = f"pages of {', '.join(origin)} may not change anything here"
        raise RequestRefusedError(HTTPStatus.FORBIDDEN, "request/origin", message)
    if HEADER not in headers:
        message = "send the header X-Robotouille-Operator: 1"
        raise RequestRefusedError(HTTPStatus.FORBIDDEN, "request/header", message)
    kind = "".join(headers.get("content-type", [])).partition(";")[0].strip().lower()
    if kind != "application/json":
        message = "send Content-Type: application/json"
        raise RequestRefusedError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "request/type", message)
    if "content-length" not in headers:
        raise _too_large()


def _headers(scope: Scope) -> Headers:
    found: Headers = {}
    for name, value in scope["headers"]:
        found.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return found


def _host_name(host: str) -> str:
    """Return the name of a Host header, without its port; empty if it is malformed."""
    parts = _HOST.fullmatch(host)
    return (parts[1] or parts[2]).lower() if parts else ""


class Guard:
    """ASGI middleware that checks requests, audits logins and tells slots how requests proceed.

    It wraps the whole application instead of being one of Starlette's middlewares: the responses
    of Starlette's own error handler need the headers too.

    `refusals` are turns for refused requests. They are not those of operators, whom a stranger
    without a token would otherwise keep waiting.
    """

    def __init__(
        self,
        app: ASGIApp,
        access: Access,
        logins: LoginAudit,
        rates: RequestRates,
        turns: Turns,
        refusals: Turns,
    ) -> None:
        self._app = app
        self._access = access
        self._logins = logins
        self._rates = rates
        self._turns = turns
        self._refusals = refusals

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        slot: ConnectionSlot = scope["state"]["slot"]

        async def receive_watched() -> Message:
            message = await receive()
            if not message.get("more_body"):
                slot.body_received()
            return message

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_missing(message)]
            await send(message)

        slot.request_started(has_body=_has_body(scope))
        try:
            scope["state"]["principal"] = self._admit(scope, slot)
        except RequestRefusedError as error:
            await self._refusals.next()
            await _refuse(send_guarded, error)
        else:
            # Files of the page cost little, and their number is unlimited.
            if scope["path"] not in self._access.public:
                await self._turns.next()
            await self._app(scope, receive_watched, send_guarded)
        finally:
            slot.request_finished()

    def _admit(self, scope: Scope, slot: ConnectionSlot) -> Principal:
        try:
            principal = self._access.check(scope)
        except RequestRefusedError as error:
            if error.status is HTTPStatus.UNAUTHORIZED and error.code != "auth/needed":
                self._logins.refused(error.code, slot.address)
            raise
        if principal.grant is not None:
            slot.authenticated(principal.grant.subject)
            self._logins.accepted(principal.grant, slot.address)
        if scope["path"] not in self._access.public:
            self._rates.charge(principal.token_subject)
        return principal


def _has_body(scope: Scope) -> bool:
    return _headers(scope).get("content-length", ["0"]) != ["0"]


def _missing(message: Message) -> Iterable[tuple[bytes, bytes]]:
    given = {name.lower() for name, _ in message.get("headers", [])}
    for name, value in RESPONSE_HEADERS.items():
        if name.encode() not in given:
            yield name.encode(), value.encode()


async def _refuse(send: Send, error: RequestRefusedError) -> None:
    body = json.dumps({"code": error.code, "message": error.message}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(body))]
    if error.retry_seconds is not None:
        headers.append((b"retry-after", b"%d" % error.retry_seconds))
    if error.status is HTTPStatus.UNAUTHORIZED:
        headers.append((b"www-authenticate", b'Bearer realm="robotouille"'))
    # The request's body has not been read, so the connection cannot be used again.
    headers.append((b"connection", b"close"))
    await send({"type": "http.response.start", "status": int(error.status), "headers": headers})
    await send({"type": "http.response.body", "body": body})
