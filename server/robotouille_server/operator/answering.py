"""Answers to operators' requests that other nodes of the cluster forward to this one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from robotouille_server.app import Server
from robotouille_server.cluster.bus import BusError
from robotouille_server.cluster.node import ClusterNode
from robotouille_server.operator.forwarding import (
    ANSWER_SECONDS,
    MAX_ANSWER_BYTES,
    PASSED_ON,
    NodeAnswer,
    RequestHeader,
    decode_request,
    encode_answer,
    granted,
    too_large,
)
from robotouille_server.operator.load import Turns
from robotouille_server.operator.models import Problem
from robotouille_server.operator.other_nodes import cluster_node
from robotouille_server.operator.principal import Principal, RequestRefusedError
from robotouille_server.runtime.logs import get_logger

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message

MAX_ANSWERING = 64
"""Requests of other nodes that are answered at a time."""


@asynccontextmanager
async def answering(
    app: ASGIApp, server: Server, turns: Turns, url: str, *, tokens_only: bool
) -> AsyncIterator[None]:
    """Answer the other nodes, if there is a cluster, for the time of an `async with` block.

    Args:
        app: The operator API, without the guard that checks tokens.
        server: The server.
        turns: The turns of the server's operators.
        url: The address of its operator page.
        tokens_only: True if operators of this node always need a token.
    """
    node = cluster_node(server)
    if node is None:
        yield
        return
    answers = Answering(app, server, node, turns, tokens_only=tokens_only)
    async with answers.open(url):
        yield


class Answering:
    """Runs requests of other nodes' operators through this node's operator API."""

    def __init__(
        self,
        app: ASGIApp,
        server: Server,
        node: ClusterNode,
        turns: Turns,
        *,
        tokens_only: bool,
    ) -> None:
        self._app = app
        self._server = server
        self._node = node
        self._turns = turns
        self._tokens_only = tokens_only
        self._answering = 0
        self._open = True

    @asynccontextmanager
    async def open(self, url: str) -> AsyncIterator[None]:
        """Answer requests for the time of an `async with` block.

        Args:
            url: The address of this node's operator page.
        """
        try:
            await self._node.bus.answer(f"operator.{self._node.name}", self.answer)
        except BusError as error:
            get_logger().error(
                "other nodes cannot show the episodes of this node", error=str(error)
            )
        self._tell(url)
        try:
            yield
        finally:
            self._open = False
            self._tell("")

    def _tell(self, url: str) -> None:
        members = self._node.members
        members.own = members.own.model_copy(update={"operator": url})

    async def answer(self, word: str, data: bytes) -> bytes:
        """Return the answer to a message of another node."""
        try:
            answer = await self._answered(data)
        except RequestRefusedError as error:
            problem = Problem(code=error.code, message=error.message)
            headers = {"content-type": "application/json"}
            if error.retry_seconds is not None:
                headers["retry-after"] = str(error.retry_seconds)
            answer = NodeAnswer(int(error.status), headers, problem.model_dump_json().encode())
        return encode_answer(answer)

    async def _answered(self, data: bytes) -> NodeAnswer:
        if not self._open or self._answering >= MAX_ANSWERING:
            message = "the episode's node answers too many requests, or stops"
            raise RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "operator/busy", message, 1)
        try:
            header, body = decode_request(data)
        except ValueError:
            message = "the episode's node cannot read this request"
            raise RequestRefusedError(HTTPStatus.BAD_REQUEST, "request/invalid", message) from None
        principal = self._principal(header)
        self._answering += 1
        try:
            async with asyncio.timeout(ANSWER_SECONDS):
                return await self._run(header, body, principal)
        except TimeoutError:
            message = "the episode's node needs too long for this request"
            status = HTTPStatus.GATEWAY_TIMEOUT
            raise RequestRefusedError(status, "node/unavailable", message) from None
        finally:
            self._answering -= 1

    def _principal(self, header: RequestHeader) -> Principal:
        """Return the operator of a request, who has no more rights here than with a direct one."""
        node = self._node.members.find(header.node)
        if node is None or node is self._node.members.own:
            message = "the episode's node does not know the node that you asked"
            raise RequestRefusedError(HTTPStatus.FORBIDDEN, "node/unavailable", message)
        if header.by == "local":
            if self._tokens_only:
                message = f"{self._url} answers only operators with a token"
                raise RequestRefusedError(HTTPStatus.UNAUTHORIZED, "auth/needed", message)
            return Principal(via=node.url)
        if node.keys != self._node.members.own.keys:
            message = f"{self._url} signs tokens with other keys, so your token is not valid there"
            raise RequestRefusedError(HTTPStatus.FORBIDDEN, "node/keys", message)
        grant, tokens = granted(header.by), self._server.tokens
        for ended, code in (
            (tokens.past(grant.expires), "auth/expired"),
            (bool(grant.token_id) and grant.token_id in tokens.revoked, "auth/revoked"),
        ):
            if ended:
                message = f"your token is no longer valid on {self._url}"
                raise RequestRefusedError(HTTPStatus.UNAUTHORIZED, code, message)
        return Principal(grant, via=node.url)

    @property
    def _url(self) -> str:
        return self._node.members.own.url

    async def _run(self, header: RequestHeader, body: bytes, principal: Principal) -> NodeAnswer:
        if header.path.endswith("/events"):
            message = "event streams are not forwarded"
            raise RequestRefusedError(HTTPStatus.BAD_REQUEST, "request/invalid", message)
        await self._turns.next()
        collected = _Answer(body)
        try:
            await self._app(_scope(header, body, principal), collected.receive, collected.send)
        except Exception:
            # The API has answered that it failed, and logged it; or the answer was too large.
            get_logger().debug("request of another node failed", path=header.path)
        if collected.too_large:
            raise too_large(self._node.members.own)
        return collected.answer()


class _TooLargeError(Exception):
    """The answer does not fit into a message."""


class _Answer:
    """Both ends of a request without a connection.

    Attributes:
        too_large: True if the answer does not fit into a message.
    """

    def __init__(self, body: bytes) -> None:
        self.too_large = False
        self._request: bytes | None = body
        self._status = int(HTTPStatus.INTERNAL_SERVER_ERROR)
        self._headers: dict[str, str] = {}
        self._body = bytearray()

    async def receive(self) -> Message:
        if self._request is None:
            # The other node does not disconnect.
            await asyncio.get_running_loop().create_future()
        body, self._request = self._request, None
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self._status = message["status"]
            given = {k.decode("latin-1"): v.decode("latin-1") for k, v in message["headers"]}
            self._headers = {name: given[name] for name in PASSED_ON if name in given}
            self.too_large = int(given.get("content-length", 0)) > MAX_ANSWER_BYTES
        self._body += message.get("body", b"")
        self.too_large |= len(self._body) > MAX_ANSWER_BYTES
        if self.too_large:
            raise _TooLargeError  # Nothing else ends the answer early.

    def answer(self) -> NodeAnswer:
        return NodeAnswer(self._status, self._headers, bytes(self._body))


def _scope(header: RequestHeader, body: bytes, principal: Principal) -> dict[str, Any]:
    headers = [
        (b"host", b"localhost"),
        (b"content-type", b"application/json"),
        (b"content-length", b"%d" % len(body)),
    ]
    return {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": header.method,
        "scheme": "http",
        "path": header.path,
        "raw_path": quote(header.path).encode(),
        "query_string": header.query.encode(),
        "root_path": "",
        "headers": headers,
        "client": None,
        "server": None,
        "state": {"principal": principal},
    }
