"""Who may use the operator's port: checks in front of every request, headers behind every answer.

A browser on the operator's machine runs pages of other web sites. None of them may read or do
anything here: a `Host` that is not ours is refused (DNS rebinding), a request that changes
something needs what a foreign page cannot send (JSON and a header of its own, so that the browser
would have to ask first, which is refused), and no answer may be shown within or read by others.
"""

from __future__ import annotations

import ipaddress
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from robotouille.errors import ProtocolError
from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.http.connection_slots import ConnectionSlot
from robotouille_server.admin.http.logins import LoginAudit
from robotouille_server.admin.principal import Principal
from robotouille_server.auth import PROXY_HEADERS, RoleGrant

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["HEADER", "MAX_BODY", "Access", "Gate", "is_loopback"]

HEADER = "x-robotouille-operator"
MAX_BODY = 16 * 1024
SAFE = frozenset({"GET", "HEAD"})
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
ANSWER_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}


def is_loopback(host: str) -> bool:
    """Whether only this machine is reached by this name or address."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Access:
    """The rules. `authorize` says what an operator's token grants and raises ProtocolError for
    any other; `always` asks for one on loopback, too; `hosts` are names allowed in `Host` beside
    loopback's; `public` are the paths that say nothing about the server and need no token."""

    authorize: Callable[[str], RoleGrant] | None = None
    always: bool = False
    hosts: frozenset[str] = frozenset()
    public: frozenset[str] = frozenset()

    def check(self, scope: Scope) -> Principal:
        """Who makes a request; RequestRefusedError says why it goes no further."""
        headers = _headers(scope)
        self._check_host(scope, headers.get("host", []))
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
        message = f"{', '.join(hosts) or 'no host'} is not a name of this page"
        raise RequestRefusedError(HTTPStatus.MISDIRECTED_REQUEST, "host/unknown", message)

    def _principal(self, headers: dict[str, list[str]]) -> Principal:
        """Where no token is needed one that is given counts, too, and must be good."""
        forwarded = any(name.lower() in headers for name in PROXY_HEADERS)
        needed = self.always or forwarded
        given = "authorization" in headers
        if self.authorize is None:
            if not needed:
                return Principal()
            message = "requests through a proxy need a token, and this server checks none"
            raise RequestRefusedError(HTTPStatus.FORBIDDEN, "auth/forwarded", message)
        if not (needed or given):
            return Principal()
        scheme, _, token = " ".join(headers.get("authorization", [])).partition(" ")
        if scheme.lower() != "bearer" or not token.strip():
            message = "give an operator's token: Authorization: Bearer TOKEN"
            raise RequestRefusedError(HTTPStatus.UNAUTHORIZED, "auth/needed", message)
        judge = partial(_judged, self.authorize, token.strip())
        return Principal(judge(), judge)


def _judged(authorize: Callable[[str], RoleGrant], token: str) -> RoleGrant:
    """What a token grants at this moment; RequestRefusedError if nothing (any longer)."""
    try:
        return authorize(token)
    except ProtocolError as error:
        raise RequestRefusedError(HTTPStatus.UNAUTHORIZED, error.code, error.message) from None


def _check_length(headers: dict[str, list[str]]) -> None:
    """A body says how long it is, whatever the method: one in chunks would have no end."""
    length = "".join(headers.get("content-length", ["0"]))
    if "transfer-encoding" in headers or not length.isdecimal() or int(length) > MAX_BODY:
        raise _too_large()


def _too_large() -> RequestRefusedError:
    message = f"send a body of at most {MAX_BODY} bytes with its Content-Length, not in chunks"
    return RequestRefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "request/size", message)


def _check_change(headers: dict[str, list[str]]) -> None:
    """A request that changes something must be one that no foreign page can make."""
    origin = headers.get("origin")
    host = "".join(headers["host"])
    if origin is not None and origin not in ([f"http://{host}"], [f"https://{host}"]):
        raise RequestRefusedError(
            HTTPStatus.FORBIDDEN, "request/origin", f"{', '.join(origin)} may not do this"
        )
    if HEADER not in headers:
        raise RequestRefusedError(
            HTTPStatus.FORBIDDEN, "request/header", "send the header X-Robotouille-Operator: 1"
        )
    kind = "".join(headers.get("content-type", [])).partition(";")[0].strip().lower()
    if kind != "application/json":
        raise RequestRefusedError(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "request/type", "send Content-Type: application/json"
        )
    if "content-length" not in headers:
        raise _too_large()


def _headers(scope: Scope) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return found


def _host_name(host: str) -> str:
    """The name of a Host header, without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].lower()


class Gate:
    """The checks around an ASGI application."""

    def __init__(self, app: ASGIApp, access: Access, logins: LoginAudit) -> None:
        self._app = app
        self._access = access
        self._logins = logins

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_missing(message)]
            await send(message)

        try:
            self._let_in(scope)
        except RequestRefusedError as error:
            await _refuse(send_guarded, error)
        else:
            await self._app(scope, receive, send_guarded)

    def _let_in(self, scope: Scope) -> None:
        """Leave the principal in the request's state; a valid token keeps the connection's slot."""
        state = scope.setdefault("state", {})
        slot: ConnectionSlot | None = state.get("slot")
        try:
            principal = self._access.check(scope)
        except RequestRefusedError as error:
            if error.status is HTTPStatus.UNAUTHORIZED and error.code != "auth/needed":
                self._logins.refused(error.code, "" if slot is None else slot.address)
            raise
        if principal.grant is not None:
            if slot is not None:
                slot.know(principal.grant.subject)
            self._logins.good(principal.grant, "" if slot is None else slot.address)
        state["principal"] = principal


def _missing(message: Any) -> Iterable[tuple[bytes, bytes]]:
    given = {name.lower() for name, _ in message.get("headers", [])}
    for name, value in ANSWER_HEADERS.items():
        if name.encode() not in given:
            yield name.encode(), value.encode()


async def _refuse(send: Send, error: RequestRefusedError) -> None:
    body = json.dumps({"code": error.code, "message": error.message}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(body))]
    if error.status is HTTPStatus.UNAUTHORIZED:
        headers.append((b"www-authenticate", b'Bearer realm="robotouille"'))
    headers.append((b"connection", b"close"))
    await send({"type": "http.response.start", "status": int(error.status), "headers": headers})
    await send({"type": "http.response.body", "body": body})
